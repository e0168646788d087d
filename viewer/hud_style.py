# SPDX-License-Identifier: Apache-2.0
"""Letters and colours of the panels."""

from importlib.resources import as_file, files

from imgui_bundle import ImVec2, ImVec4, imgui

LETTER_PX = 16.0
COLUMN = 104
"""Where values stand beside their names."""
FONT = "assets", "fonts", "Roboto", "Roboto-Regular.ttf"
BRIGHT = ImVec4(0.95, 0.97, 1.0, 1.0)
QUIET = ImVec4(0.66, 0.72, 0.79, 1.0)
ACCENT = ImVec4(0.36, 0.72, 1.0, 1.0)
WARM = ImVec4(1.0, 0.70, 0.28, 1.0)
BACK = ImVec4(0.055, 0.075, 0.10, 0.86)
FIELD = ImVec4(0.16, 0.20, 0.26, 0.95)
OVER = ImVec4(0.22, 0.30, 0.39, 1.0)
PRESSED = ImVec4(0.24, 0.44, 0.62, 1.0)
COLOURS = {
    "text": BRIGHT,
    "text_disabled": QUIET,
    "window_bg": BACK,
    "popup_bg": ImVec4(0.07, 0.09, 0.12, 0.97),
    "border": ImVec4(1.0, 1.0, 1.0, 0.10),
    "frame_bg": FIELD,
    "frame_bg_hovered": OVER,
    "frame_bg_active": PRESSED,
    "button": FIELD,
    "button_hovered": OVER,
    "button_active": PRESSED,
    "header": ImVec4(0.16, 0.20, 0.26, 0.75),
    "header_hovered": OVER,
    "header_active": PRESSED,
    "slider_grab": ACCENT,
    "slider_grab_active": BRIGHT,
    "check_mark": ACCENT,
    "separator": ImVec4(1.0, 1.0, 1.0, 0.10),
    "plot_lines": ACCENT,
    "plot_histogram": ACCENT,
}


def dress(scale: float) -> None:
    """Set fonts, spaces and colours of the current context."""
    style = imgui.get_style()
    imgui.style_colors_dark(style)
    for name, colour in COLOURS.items():
        style.set_color_(getattr(imgui.Col_, name), colour)
    style.window_rounding = style.popup_rounding = 8.0
    style.frame_rounding = style.grab_rounding = 5.0
    style.window_padding, style.frame_padding = ImVec2(14.0, 12.0), ImVec2(9.0, 5.0)
    style.item_spacing, style.item_inner_spacing = ImVec2(9.0, 8.0), ImVec2(7.0, 6.0)
    style.window_border_size = 1.0
    style.scrollbar_size, style.grab_min_size = 11.0, 12.0
    style.scale_all_sizes(scale)
    style.font_scale_dpi = scale
    place = files("imgui_bundle").joinpath(*FONT)
    with as_file(place) as file:
        if file.exists():
            imgui.get_io().fonts.add_font_from_file_ttf(str(file), LETTER_PX)


def text_in(colour: ImVec4, text: str) -> None:
    """Write a line in a colour."""
    imgui.push_style_color(imgui.Col_.text, colour)
    imgui.text_wrapped(text)
    imgui.pop_style_color()


def label(text: str, unit: float) -> None:
    """Write what the next item is, which fills the rest of the line."""
    imgui.align_text_to_frame_padding()
    imgui.text_disabled(text)
    imgui.same_line(COLUMN * unit)
    imgui.set_next_item_width(-1)


def pair(name: str, value: str, column: float) -> None:
    """Write a name and, from a column on, its value."""
    imgui.text_disabled(name)
    imgui.same_line(column)
    imgui.text_wrapped(value)

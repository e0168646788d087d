# SPDX-License-Identifier: Apache-2.0
"""Panel: what was clicked, a measurement, a legend."""

import math
from typing import TYPE_CHECKING

from imgui_bundle import imgui

from viewer.app_search import title_of
from viewer.camera import project
from viewer.hud_look import legend
from viewer.hud_style import ACCENT, BACK, COLUMN, QUIET, WARM, pair, text_in
from viewer.hud_text import length_text, measured_lines, place_text

if TYPE_CHECKING:
    from viewer.app import App

ABOVE = "ellipsoid (GPS) height"


def is_needed(app: "App") -> bool:
    """Say whether there is anything to show."""
    state = app.state
    return bool(state.picked or state.measuring or app.session.styling)


def draw(app: "App", unit: float) -> None:
    """Draw the card's content."""
    state = app.state
    if state.measuring:
        text_in(ACCENT, "Measure")
        for line in measured_lines(state.points):
            imgui.text_unformatted(line)
        if imgui.button("Done (M)"):
            app.do.measure(on=False)
    if state.picked:
        _picked(app, unit)
    if app.session.styling:
        if state.picked or state.measuring:
            imgui.separator()
        shown = app.session.styling.legend
        text_in(ACCENT, f"Buildings by {shown['field']}")
        legend(shown)


def _picked(app: "App", unit: float) -> None:
    found = app.state.picked
    assert found
    one, column = found.get("object"), COLUMN * unit
    if found["kind"] == "proxy":
        text_in(ACCENT, f"{found['count']} buildings, too small to tell apart here")
        text_in(QUIET, "the nearest one:" if one else "fly nearer")
    if one:
        text_in(ACCENT, title_of(one))
        for name, value in one["attributes"].items():
            pair(str(name), str(value), column)
        imgui.separator()
        pair("source", str(one["source"]), column)
        pair("base", f"{length_text(one['base_m'])} {ABOVE}", column)
        pair("height", length_text(one["height_m"]), column)
        pair("size across", length_text(one["dimension_m"]), column)
    elif found["kind"] == "ground":
        text_in(ACCENT, "Ground")
    lon, lat = math.radians(found["lon_deg"]), math.radians(found["lat_deg"])
    pair("place", place_text(lon, lat), column)
    named = "height" if found["kind"] == "ground" else "this point"
    pair(named, f"{length_text(found['height_m'])} {ABOVE}", column)
    if imgui.button("Close"):
        app.do.unpick()


def draw_measurement(app: "App") -> None:
    """Draw the measured points and the line between them over the picture."""
    points, view = app.state.points, app.navigator.view(app.now_s)
    paint = imgui.get_background_draw_list()
    colour = imgui.color_convert_float4_to_u32(WARM)
    seen = [project(view, point) for point in points]
    places = [(float(s[0]), float(s[1])) for s in seen if s[2] > 0]
    for place in places:
        paint.add_circle_filled(place, 5.0, colour)
    if len(places) == 2:
        paint.add_line(places[0], places[1], colour, 2.0)
        middle = (places[0][0] + places[1][0]) / 2 + 8, (places[0][1] + places[1][1]) / 2
        text = measured_lines(points)[0].split("  ")[1]
        size, (x, y) = imgui.calc_text_size(text), middle
        back = imgui.color_convert_float4_to_u32(BACK)
        paint.add_rect_filled((x - 6, y - 3), (x + size.x + 6, y + size.y + 3), back, 5.0)
        paint.add_text(middle, colour, text)

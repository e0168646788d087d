# SPDX-License-Identifier: Apache-2.0
"""Panels: where the eye is, how fast frames come, how fine things are drawn."""

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from imgui_bundle import ImVec2, imgui

from geopage.settings import POLICIES
from geopage.tile_state import State
from tiles.lanes import Lane
from viewer.hud_style import ACCENT, COLUMN, QUIET, WARM, label, pair, text_in
from viewer.hud_text import MIB, length_text, place_text, way_text

if TYPE_CHECKING:
    from viewer.app import App

GRAPH_PX = 64
THRESHOLDS_PX = 0.5, 32.0
RATES_HZ = 30.0, 60.0, 90.0, 120.0
HINT = "H: help"


def draw(app: "App", unit: float) -> None:
    """Draw the detail's and the frame's section."""
    if imgui.collapsing_header("Detail"):
        _detail(app, unit)
    if imgui.collapsing_header("Frame"):
        _graph(app, unit)
        _figures(app, unit)


def bar(app: "App", width: float) -> None:
    """Draw place, height, what is going on, and where the help is."""
    pose = app.navigator.pose
    above_m = pose.height_m - app.ground.below(pose)
    imgui.text_unformatted(place_text(pose.lon_rad, pose.lat_rad))
    imgui.same_line()
    imgui.text_disabled("|")
    imgui.same_line()
    imgui.text_unformatted(f"{length_text(above_m)} above ground")
    imgui.same_line()
    imgui.text_disabled("|")
    imgui.same_line()
    imgui.text_unformatted(way_text(pose))
    if app.loading:
        imgui.same_line()
        imgui.text_disabled("|")
        imgui.same_line()
        imgui.push_style_color(imgui.Col_.text, WARM)
        imgui.text_unformatted(loading_text(app))
        imgui.pop_style_color()
    if app.state.message:
        imgui.same_line(0, 24)
        message(app, width - imgui.get_cursor_pos_x() - 16)
        return
    at = width - imgui.calc_text_size(HINT).x - 16
    imgui.same_line(0, 24)
    if imgui.get_cursor_pos_x() < at:
        imgui.same_line(at)
        imgui.text_disabled(HINT)


def message(app: "App", width: float) -> None:
    """Draw the line that the app says, cut where there is no more room."""
    imgui.push_style_color(imgui.Col_.text, ACCENT)
    imgui.text_unformatted(cut(app.state.message, width))
    imgui.pop_style_color()


def cut(text: str, width: float) -> str:
    """Return a text, or as much of it as is no wider."""
    if imgui.calc_text_size(text).x <= width:
        return text
    while text and imgui.calc_text_size(text + "...").x > width:
        text = text[:-1]
    return text + "..."


def loading_text(app: "App") -> str:
    """Say that not all is there yet, and how many tiles are on their way."""
    _, loading, wanted = tiles(app)
    return f"loading {loading + wanted} tiles" if loading + wanted else "loading"


def tiles(app: "App") -> tuple[int, int, int]:
    """Return how many tiles can be drawn, are on their way, and wait for their turn."""
    count = np.zeros(len(State), np.int64)
    for lane in Lane:
        count += np.bincount(app.session.pager.states(lane), minlength=len(State))
    coming = count[State.LOADING] + count[State.RESIDENT]
    return int(count[State.UPLOADED]), int(coming), int(count[State.QUEUED])


def _graph(app: "App", unit: float) -> None:
    """Draw the last frames' times, and a line at the budget."""
    times = np.array(app.state.frame_ms, np.float32)
    budget_ms = app.state.budget_ms
    if not len(times):
        times = np.zeros(1, np.float32)
    top = max(float(times.max()) * 1.15, budget_ms * 1.6)
    size = ImVec2(imgui.get_content_region_avail().x, GRAPH_PX * unit)
    corner = imgui.get_cursor_screen_pos()
    imgui.plot_lines("##frames", times, 0, None, 0.0, top, size)
    y = corner.y + size.y * (1 - budget_ms / top)
    paint = imgui.get_window_draw_list()
    colour = imgui.color_convert_float4_to_u32(WARM)
    paint.add_line((corner.x, y), (corner.x + size.x, y), colour, 1.0)
    paint.add_text((corner.x + 6, y - 17 * unit), colour, f"{budget_ms:.1f} ms")
    p50, p95 = np.percentile(times, (50, 95))
    text_in(QUIET, f"median {p50:.1f} ms, 95 % {p95:.1f} ms")


def _figures(app: "App", unit: float) -> None:
    pager, column = app.session.pager, COLUMN * unit
    there, loading, wanted = tiles(app)
    pair("Tiles", f"{there} in, {loading} loading, {wanted} wanted", column)
    memory = pager.memory()
    used = sum(memory[f"{k}_bytes"] for k in ("index", "resident", "uploaded", "in_flight"))
    budget = memory["budget_bytes"]
    imgui.align_text_to_frame_padding()
    imgui.text_disabled("Memory")
    imgui.same_line(column)
    text = f"{used / MIB:.0f} of {budget / MIB:.0f} MiB"
    imgui.progress_bar(min(used / budget, 1.0), ImVec2(-1, 0), text)
    if app.stats:
        stats = app.stats
        pair(
            "Drawn",
            f"{stats.triangles / 1e3:.0f} k triangles, {stats.objects:,} buildings",
            column,
        )
    if pager.message:
        text_in(WARM, pager.message)
    if pager.faults:
        text_in(WARM, f"{len(pager.faults)} faults: {pager.faults[-1]}")


def _rate(app: "App", unit: float) -> None:
    fps = app.state.fps
    changed, on = imgui.checkbox("Hold", fps is not None)
    if changed:
        app.do.set_fps(RATES_HZ[1] if on else None)
    imgui.same_line(COLUMN * unit)
    imgui.set_next_item_width(-1)
    imgui.begin_disabled(not on)
    rates = [f"{rate:g} frames a second" for rate in RATES_HZ]
    at = RATES_HZ.index(fps) if fps in RATES_HZ else 1
    moved, at = imgui.combo("##fps", at, rates)
    imgui.end_disabled()
    if moved and on:
        app.do.set_fps(RATES_HZ[at])


def _detail(app: "App", unit: float) -> None:
    state = app.state
    logarithmic = imgui.SliderFlags_.logarithmic
    label("Error up to", unit)
    changed, value = imgui.slider_float(
        "##px", state.threshold_px, *THRESHOLDS_PX, "%.1f px", logarithmic
    )
    if changed:
        app.do.set_threshold(value)
    if app.drawn and abs(app.drawn.threshold_px - state.threshold_px) > 0.05:
        text_in(QUIET, f"now {app.drawn.threshold_px:.1f} px")
    _rate(app, unit)
    label("Paging", unit)
    at = POLICIES.index(state.policy) if state.policy in POLICIES else 0
    changed, at = imgui.combo("##policy", at, list(POLICIES))
    if changed:
        app.do.set_policy(POLICIES[at])
    shown = state.overlay
    for name, what in (
        ("wireframe", "Triangles"),
        ("bounds", "Tile bounds"),
        ("heat", "Error heat map"),
    ):
        changed, on = imgui.checkbox(what, getattr(shown, name))
        if changed:
            change: dict[str, Any] = {name: on}
            state.overlay = replace(state.overlay, **change)
        if name == "wireframe":
            imgui.same_line()
    if shown.heat:
        text_in(QUIET, "blue: finer than asked, orange: coarser")
    changed, on = imgui.checkbox("Freeze selection", state.frozen)
    if changed:
        app.do.freeze(on=on)

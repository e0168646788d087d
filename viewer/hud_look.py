# SPDX-License-Identifier: Apache-2.0
"""Panel: the sun's time, and buildings coloured by an attribute."""

from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Any

from imgui_bundle import ImVec4, imgui

from geopage.palettes import colour_of
from viewer.hud_style import QUIET, label, text_in
from viewer.hud_text import sun_text

if TYPE_CHECKING:
    from viewer.app import App

YEAR, NOON = 2026, 12.0
PLAIN = "plain"


class LookPanel:
    """The panel's own choices."""

    def __init__(self) -> None:
        self._hour, self._day = NOON, 172

    def draw(self, app: "App", unit: float) -> None:
        """Draw the section."""
        if imgui.collapsing_header("Look", imgui.TreeNodeFlags_.default_open):
            self._sun(app, unit)
            _style(app, unit)

    def _sun(self, app: "App", unit: float) -> None:
        state = app.state
        changed, on = imgui.checkbox("Sun at a time of day", state.utc is not None)
        if changed and not on:
            state.utc = None
        if not on:
            return
        hour, day = self._hour, self._day
        label("Hour", unit)
        moved, hour = imgui.slider_float("##hour", hour, 0.0, 23.99, clock_text(hour))
        label("Day", unit)
        turned, day = imgui.slider_int("##day", day, 1, 365, date_text(day))
        if changed or moved or turned:
            self._hour, self._day = hour, day
            state.utc = utc_of(hour, day, app.navigator.pose.lon_rad)
        if state.utc:
            text_in(QUIET, sun_text(state.utc))


def clock_text(hour: float) -> str:
    """Return an hour as clocks show it."""
    minutes = int(hour * 60)
    return f"{minutes // 60:02d}:{minutes % 60:02d} by the sun"


def date_text(day: int) -> str:
    """Return a day of the year as a date."""
    return f"{datetime(YEAR, 1, 1, tzinfo=UTC) + timedelta(days=day - 1):%d %b}"


def utc_of(hour: float, day: int, lon_rad: float) -> datetime:
    """Return the time at which it is so late by the sun at a longitude."""
    start = datetime(YEAR, 1, 1, tzinfo=UTC) + timedelta(days=day - 1)
    return start + timedelta(hours=hour - lon_rad * 12 / 3.141592653589793)


def _style(app: "App", unit: float) -> None:
    if not (fields := app.do.fields()):
        return
    names = [PLAIN, *fields]
    at = names.index(app.state.style) if app.state.style in names else 0
    label("Buildings", unit)
    shown = [f"by {name}" if name != PLAIN else PLAIN for name in names]
    changed, at = imgui.combo("##style", at, shown)
    if changed:
        app.do.set_style("" if at == 0 else names[at])


def legend(legend: dict[str, Any]) -> None:
    """Draw which colour is which."""
    rows = legend.get("categories") or legend["stops"]
    rest = [(key, legend.get(key)) for key in ("other", "missing")]
    ends = (0, len(rows) - 1) if legend.get("quantiles") else ()
    words = dict(zip(ends, ("or less", "or more"), strict=False))
    rows = rows + [row | {"value": key} for key, row in rest if row and row.get("count")]
    for number, row in enumerate(rows):
        red, green, blue = (part / 255 for part in colour_of(row["colour"]))
        flags = imgui.ColorEditFlags_.no_tooltip
        imgui.color_button(f"##{number}", ImVec4(red, green, blue, 1.0), flags)
        imgui.same_line()
        value = row["value"]
        text = f"{value:.4g}" if isinstance(value, float) else str(value)
        text = f"{text} {words[number]}" if number in words else text
        imgui.text_unformatted(f"{text}  ({row['count']:,})" if "count" in row else text)

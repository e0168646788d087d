# SPDX-License-Identifier: Apache-2.0
"""E6: the stall of a fast fly-in behind slow servers, with levels skipped and without.

VGIS (Davis et al., IEEE Visualization 1999, section 4) tells of it and of the cure, an
index tree in memory and skipped levels; nobody has measured it. Ours has such an index
always: what is compared is only the order in which tiles are asked for.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from geopage.draw_list import DrawList
from geopage.settings import MIB, PagerSettings, Throttle
from geopage.view import ViewState
from viewer.experiments.pages import Flyer
from viewer.experiments.rows import Chart, Found, Progress, Row, Series
from viewer.experiments.setting import Setting, sample_flight
from viewer.poses import Flight

KEY = "E6"
SOURCE = "VGIS 1999, section 4"
POLICIES = {
    "vgis-stepwise": "VGIS, every level",
    "vgis": "VGIS, levels skipped",
    "demand": "largest error first",
    "benefit": "geopage",
}
LINES = {
    "disk of 1999": Throttle(10.0, 10.0),
    "50 Mbit/s, 50 ms": Throttle(5.96, 50.0),
    "0.5 MiB/s, 200 ms": Throttle(0.5, 200.0),
    "0.25 MiB/s, 20 ms": Throttle(0.25, 20.0),
}
SIZE_PX = (1280, 720)
STEP_S = 1 / 60
LOOK_EVERY = 3
WAIT_S = 60.0
"""A last view that is not whole after this long is given up"""
THRESHOLD_PX = 2.0
SHOWN_PX = 0.2
LITTLE = 0.5
"""Of what a line could bring"""


@dataclass(slots=True)
class Descent:
    """A flight down, and the wait at its end."""

    step_s: float
    error_px: list[float] = field(default_factory=list)
    """95th percentile over the ground, at each frame of the flight that was looked at"""
    stall_s: float = 0.0
    """from the end of the flight until the view there had all"""
    bytes_read: int = 0
    line_share: float = 0.0
    """bytes that came / bytes that the line could have brought"""

    @property
    def within(self) -> float:
        """Per cent of the frames that are within the threshold."""
        return 100 * float((np.array(self.error_px) <= THRESHOLD_PX).mean())


def run(setting: Setting, show: Progress) -> Found:
    """Run the experiment."""
    store = setting.world()
    flight = sample_flight(store, "fly_in", SIZE_PX)
    lines = list(LINES.items())[2:] if setting.quick else list(LINES.items())
    return measure(store, flight, dict(lines), setting.pick(2 * STEP_S, 4 * STEP_S), show)


def measure(
    store: Path,
    flight: Flight,
    lines: dict[str, Throttle],
    step_s: float,
    show: Progress,
) -> Found:
    """Fly down each line with each policy."""
    found, most = Found(), 0.0
    stalls: dict[str, list[float]] = {policy: [] for policy in POLICIES}
    good: dict[str, list[float]] = {policy: [] for policy in POLICIES}
    shown: list[Series] = []
    for i, (name, line) in enumerate(lines.items()):
        shown = []
        for j, (policy, words) in enumerate(POLICIES.items()):
            one = fly_down(store, flight, policy, line, step_s)
            _rows(found, name, policy, one)
            stalls[policy].append(one.stall_s)
            good[policy].append(one.within)
            most = max(most, one.line_share)
            times_s = np.arange(len(one.error_px)) * LOOK_EVERY * step_s
            error_px = np.maximum(one.error_px, SHOWN_PX)
            shown.append(Series(words, times_s.tolist(), error_px.tolist()))
            show(100 * (i + (j + 1) / len(POLICIES)) / len(lines))
    waits = [Series(words, range(len(lines)), stalls[p]) for p, words in POLICIES.items()]
    title = "Wait at the end of a fly-in until the view is whole"
    y = f"s ({WAIT_S:g}: given up)"
    found.charts.append(Chart("e6_waits", title, "line", y, waits, bars=[*lines]))
    y = f"terrain, 95th percentile, px ({SHOWN_PX:g}: or less)"
    title = f"Error during the fly-in: {[*lines][-1]}"
    found.charts.append(Chart("e6_error", title, "time, s", y, shown, log_y=True))
    _say(found, most, stalls, good)
    return found


def _say(
    found: Found, most: float, stalls: dict[str, list[float]], good: dict[str, list[float]]
) -> None:
    """Say how the policies' waits and good frames stand to each other."""
    if most < LITTLE:
        found.says.append(
            f"No line was used to more than {100 * most:.0f} %: most of the time goes by"
            " between asking and the first byte, whatever the order."
        )
    slow, fast = (sum(stalls[policy]) for policy in ("vgis-stepwise", "vgis"))
    ours = sum(stalls["benefit"])
    found.says.append(
        f"Over all lines the last view is whole after {slow:.1f} s when every level is"
        f" walked, after {fast:.1f} s when levels are skipped, and after {ours:.1f} s with"
        " geopage's own order."
        + (" Ours waits longer than VGIS with skipping." if ours > fast else "")
    )
    shares = ", ".join(
        f"{np.mean(good[policy]):.0f} % ({words})" for policy, words in POLICIES.items()
    )
    found.says.append(f"Frames within {THRESHOLD_PX:g} px, mean over the lines: {shares}.")


def fly_down(
    store: Path, flight: Flight, policy: str, line: Throttle, step_s: float
) -> Descent:
    """Fly once, and wait at the end."""
    settings = PagerSettings(
        THRESHOLD_PX, None, 512 * MIB, throttle=line, policy=policy, fade_s=0.0
    )
    flyer, found = Flyer(store, settings), Descent(step_s)
    count = round(flight.path.duration_s / step_s)
    is_whole = False

    def views() -> Iterator[ViewState]:
        for i in range(count + round(WAIT_S / step_s)):
            if i > count and is_whole:
                return
            yield flight.view(i * step_s)

    def look(i: int, drawn: DrawList, view: ViewState) -> None:
        nonlocal is_whole
        if i >= count:
            is_whole = flyer.lacking(drawn, view) == 0
            found.stall_s = (i - count) * step_s
        elif i % LOOK_EVERY == 0:
            found.error_px.append(flyer.error_px(drawn, view))

    found.bytes_read = flyer.fly(views(), step_s, look).bytes_read
    seconds = flight.path.duration_s + found.stall_s
    found.line_share = found.bytes_read / (line.mib_per_s * MIB * seconds)
    return found


def _rows(found: Found, line: str, policy: str, one: Descent) -> None:
    where = f"{line}, {POLICIES[policy]}"
    error_px = np.array(one.error_px)
    note = "told, not measured" if not found.rows else ""
    note = "given up" if one.stall_s > WAIT_S - 1 else note
    quantity = "wait at the end until the view is whole"
    found.rows.append(Row(KEY, where, quantity, "s", None, SOURCE, one.stall_s, note))
    quantity = f"frames within {THRESHOLD_PX:g} px"
    found.rows.append(Row(KEY, where, quantity, "%", None, "", one.within))
    worst = float(np.percentile(error_px, 95))
    quantity = "error of the terrain, 95th percentile of frames"
    found.rows.append(Row(KEY, where, quantity, "px", None, "", worst))
    note = f"{one.bytes_read / 1e6:.1f} MB"
    quantity, share = "of what the line could bring, read", 100 * one.line_share
    found.rows.append(Row(KEY, where, quantity, "%", None, "", share, note))

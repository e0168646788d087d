# SPDX-License-Identifier: Apache-2.0
"""E5's rows and charts, made of what `fly_in` measured."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from viewer.experiments.rows import SAME, Chart, Found, Row, Series

KEY = "E5"
SOURCE = "VGIS 1999, section 5"
FAR_M = 160e3
"""The paper's largest buildings appear here"""
ALONE, ALL, ONE, LEVELS = (
    "terrain only",
    "without the hierarchy",
    "1 px",
    "1 px, buildings 10 px",
)
METHODS = (ALONE, ALL, ONE, LEVELS)
PAPER_FPS = {ALONE: 17.5, ALL: 7.0}
HIDING = " (more than all: low down they hide ground that is dearer to shade)"
CLOCK = "another machine: only ratios compare"


@dataclass(slots=True)
class Drawn:
    """One method at one view."""

    frame_ms: float
    triangles: int
    objects: int


@dataclass(slots=True)
class Town:
    """All that was measured over one town."""

    buildings: int
    heights_m: list[float]
    by_height: dict[str, list[Drawn]]
    turning: dict[tuple[str, bool], list[Drawn]]
    """pan or orbit, with culling or without"""
    first_m: float
    """from where the first building is drawn at 1 px"""
    expected_m: float
    """s f / threshold"""

    def near(self, method: str) -> list[Drawn]:
        """Return what a method drew from below 160 km."""
        pairs = zip(self.heights_m, self.by_height[method], strict=True)
        return [one for height_m, one in pairs if height_m < FAR_M]

    def far(self, method: str) -> list[Drawn]:
        """Return what a method drew from above that."""
        pairs = zip(self.heights_m, self.by_height[method], strict=True)
        return [one for height_m, one in pairs if height_m >= FAR_M]


def mean_fps(drawn: Sequence[Drawn]) -> float:
    """Return the mean of frames a second."""
    return float(np.mean([1e3 / one.frame_ms for one in drawn]))


def mean_triangles(drawn: Sequence[Drawn]) -> float:
    """Return the mean of triangles a frame."""
    return float(np.mean([one.triangles for one in drawn]))


def figures(towns: Sequence[Town]) -> Found:
    """Return rows, charts and sentences of all towns."""
    found = Found()
    found.rows.append(_tower(towns[0]))
    for town in towns:
        _fps(found, town, town is towns[0])
        _turning(found, town, town is towns[0])
        found.charts.append(_fps_chart(town))
    found.charts.append(_triangles_chart(towns[-1]))
    _say(found, towns)
    return found


def _tower(town: Town) -> Row:
    """Return from which height the tower is drawn."""
    note = (
        f"s f / threshold = {town.expected_m / 1e3:.1f} km; ours counts from the near side"
        " of the tile that the tower is in"
    )
    quantity, first_km = (
        "first building drawn at 1 px, from a height of",
        town.first_m / 1e3,
    )
    where = "tower of 312 m"
    return Row(KEY, where, quantity, "km", 160.0, SOURCE, first_km, note, SAME)


def _fps_chart(town: Town) -> Chart:
    return Chart(
        f"e5_fps_{town.buildings}",
        f"Fly-in over {town.buildings:,} buildings",
        "height above the ground, m",
        "frames a second (shortest of 3 draws)",
        [
            Series(m, town.heights_m, [1e3 / d.frame_ms for d in town.by_height[m]])
            for m in METHODS
        ],
        log_x=True,
    )


def _triangles_chart(town: Town) -> Chart:
    return Chart(
        "e5_triangles",
        f"Triangles of the fly-in over {town.buildings:,} buildings",
        "height above the ground, m",
        "triangles a frame",
        [
            Series(m, town.heights_m, [d.triangles for d in town.by_height[m]])
            for m in METHODS
        ],
        log_x=True,
        log_y=True,
    )


def _fps(found: Found, town: Town, is_first: bool) -> None:  # noqa: FBT001
    where = f"{town.buildings:,} buildings, below 160 km"
    for method in METHODS:
        paper = PAPER_FPS.get(method) if is_first else None
        note = f"{mean_triangles(town.near(method)):,.0f} triangles a frame"
        note += f"; {CLOCK}" if paper else ""
        quantity = f"frames a second, {method}"
        fps, source = mean_fps(town.near(method)), SOURCE if paper else ""
        row = Row(KEY, where, quantity, "1/s", paper, source, fps, note, timed=True)
        found.rows.append(row)
    share = 100 * mean_fps(town.near(ALL)) / mean_fps(town.near(ALONE))
    paper = 100 * PAPER_FPS[ALL] / PAPER_FPS[ALONE] if is_first else None
    quantity = "speed without the hierarchy / terrain only"
    source = SOURCE if paper else ""
    row = Row(KEY, where, quantity, "%", paper, source, share, timed=True)
    found.rows.append(row)
    share = 100 * mean_fps(town.near(ONE)) / mean_fps(town.near(ALL))
    quantity = "speed with the hierarchy, 1 px / without"
    found.rows.append(Row(KEY, where, quantity, "%", None, "", share, timed=True))
    share = 100 * mean_fps(town.near(LEVELS)) / mean_fps(town.near(ONE))
    quantity = "speed with levels of detail / 1 px"
    note = '"significantly higher frame rates" (figures missing)' if is_first else ""
    row = Row(KEY, where, quantity, "%", None, SOURCE if is_first else "", share, note)
    found.rows.append(replace(row, timed=True))
    above = f"{town.buildings:,} buildings, above 160 km"
    share = 100 * mean_triangles(town.far(ONE)) / mean_triangles(town.far(ALONE))
    note = (
        '"does not slow perceptibly until the buildings are paged in"' if is_first else ""
    )
    quantity = "triangles with the hierarchy, 1 px / terrain only"
    paper, source = (100.0, SOURCE) if is_first else (None, "")
    row = Row(KEY, above, quantity, "%", paper, source, share, note, SAME)
    found.rows.append(row)
    share = 100 * mean_triangles(town.far(ALL)) / mean_triangles(town.far(ALONE))
    quantity = "triangles without the hierarchy / terrain only"
    found.rows.append(Row(KEY, above, quantity, "%", None, "", share))


def _turning(found: Found, town: Town, is_first: bool) -> None:  # noqa: FBT001
    for name in ("pan", "orbit"):
        on, off = town.turning[name, True], town.turning[name, False]
        where = f"{town.buildings:,} buildings, {name}"
        share = 100 * mean_triangles(on) / mean_triangles(off)
        quantity = "triangles with culling / without"
        source = SOURCE if is_first else ""
        note = "higher rates where some are culled (figures 6 and 7 missing)"
        note = note if is_first else ""
        found.rows.append(Row(KEY, where, quantity, "%", None, source, share, note))
        gain = mean_fps(on) / mean_fps(off)
        quantity = "speed with culling / without"
        found.rows.append(Row(KEY, where, quantity, "", None, source, gain, timed=True))


def _say(found: Found, towns: Sequence[Town]) -> None:
    few, many = towns[0], towns[-1]

    def kept(town: Town) -> float:
        return 100 * mean_fps(town.near(ALL)) / mean_fps(town.near(ALONE))

    found.says.append(
        "The paper's 471 buildings cost its machine 60 % of its speed. Here"
        f" {few.buildings:,} buildings without any hierarchy leave {kept(few):.0f} %"
        f"{HIDING if kept(few) > 100 else ''}, and"
        f" {many.buildings:,} leave {kept(many):.0f} %: a processor of today draws a few"
        " thousand plain triangles in no time, so their case only returns with many more"
        " buildings."
    )
    faster = 100 * mean_fps(many.near(ONE)) / mean_fps(many.near(ALL))
    levels = 100 * mean_fps(many.near(LEVELS)) / mean_fps(many.near(ONE))
    found.says.append(
        f"Over {many.buildings:,} buildings the hierarchy at 1 px runs at {faster:.0f} % of"
        f" the speed without it, and levels of detail at {levels:.0f} % of that again."
        + (" It gains nothing there." if max(faster, levels) < 105 else "")
    )

# SPDX-License-Identifier: Apache-2.0
"""E4: how small a cache may be before more has to be read (MMR 1999, graph 3)."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from geopage.settings import PagerSettings
from geopage.view import ViewState
from tiles.lanes import Lane
from viewer.experiments.city import COUNT, make_city, write_city
from viewer.experiments.city_pages import depth_px
from viewer.experiments.pages import Flown, Flyer
from viewer.experiments.rows import Chart, Found, Progress, Row, Series
from viewer.experiments.setting import Setting, sample_flight
from viewer.experiments.walks import STEP_S, make_walk

KEY = "E4"
SOURCE = "MMR 1999, section 6.3 and graph 3"
PAPER_MB, PAPER_SHARE = 140.0, 100 * 140 / 1300
POLICIES = ("mmr", "benefit")
CITY_MB = (14, 17, 20, 24, 30, 40, 60, 140)
WORLD_MB = (16, 20, 24, 30, 40, 60, 100, 200)
WORLD_PX = 1.0
SIZE_PX = (1280, 720)
FLAT = 1.05
"""The knee: within so many times of what any larger cache reads, at full detail"""


@dataclass(frozen=True, slots=True)
class Case:
    """A data set and a flight that comes back to where it was."""

    name: str
    store: Path
    views: Sequence[ViewState]
    step_s: float
    threshold_px: float
    sizes_mb: Sequence[float]


def run(setting: Setting, show: Progress) -> Found:
    """Run the experiment."""
    seconds = setting.pick(60.0, 30.0)
    cases = [city_case(setting, COUNT, seconds)]
    if not setting.quick:
        cases.append(world_case(setting))
    return measure(cases, show)


def city_case(setting: Setting, count: int, seconds: float) -> Case:
    """Return a walk out and back through the city of E3."""
    city = make_city(count)
    walk = make_walk("normal", np.full(2, 0.3 * city.side_m), seconds)
    out = [walk.view(i) for i in range(len(walk.place))]
    store = write_city(setting.data / "city.geopage", city)
    px = depth_px(out[0].focal_px)
    return Case("city of boxes", store, again(out, STEP_S), STEP_S, px, CITY_MB)


def again(views: Sequence[ViewState], step_s: float) -> list[ViewState]:
    """Return views and then the same backwards, in time."""
    there = [*views, *views[::-1]]
    return [
        ViewState(i * step_s, v.eye, v.rotation, v.focal_px, v.width_px, v.height_px)
        for i, v in enumerate(there)
    ]


def world_case(setting: Setting) -> Case:
    """Return the flight twice round a block of the sample world."""
    store = setting.world()
    flight = sample_flight(store, "street_revisit", SIZE_PX)
    times_s = np.arange(0.0, flight.path.duration_s, STEP_S).tolist()
    views = [flight.view(t_s) for t_s in times_s]
    return Case("sample world", store, views, STEP_S, WORLD_PX, WORLD_MB)


def measure(cases: Sequence[Case], show: Progress) -> Found:
    """Fly each case with each policy and each size of cache."""
    found = Found()
    flights = len(cases) * len(POLICIES)
    for i, case in enumerate(cases):
        series = []
        for j, policy in enumerate(POLICIES):
            flown = []
            for k, size_mb in enumerate(case.sizes_mb):
                flown.append(fly(case, policy, size_mb))
                part = (k + 1) / len(case.sizes_mb)
                show(100 * (i * len(POLICIES) + j + part) / flights)
            _rows(found, case, policy, flown)
            read_mb = [one.whole_bytes / 1e6 for one in flown]
            series.append(Series(policy, case.sizes_mb, read_mb))
        title = f"Read from a cold start over cache size: {case.name}"
        name = "e4_" + case.name.split()[0]
        x, y = "cache with index, MB", "read, MB"
        found.charts.append(Chart(name, title, x, y, series, log_x=True))
    found.says.append(
        "Below the knee two things differ from MMR: our pager raises its thresholds rather"
        " than read the same again and again, so bytes alone would flatter it, and the knee"
        " counts only caches that keep full detail. The index lies in our cache, not in"
        " theirs."
    )
    return found


def fly(case: Case, policy: str, size_mb: float) -> Flown:
    """Fly a case once."""
    budget_bytes = int(size_mb * 1e6)
    settings = PagerSettings(
        case.threshold_px, budget_bytes=budget_bytes, policy=policy, fade_s=0.0
    )
    return Flyer(case.store, settings).fly(case.views, case.step_s)


def knee_of(flown: Sequence[Flown]) -> int | None:
    """Return the place of the smallest cache that keeps all detail and reads no more.

    More than any larger one, that is: a policy that fills free memory ahead reads more
    the more there is. Of the largest of all that can't be known.
    """
    read = [one.whole_bytes for one in flown]
    for i in range(len(flown) - 1):
        whole = all(max(one.raised) == 1.0 for one in flown[i:])
        if whole and read[i] <= FLAT * min(read[i:]):
            return i
    return None


def _rows(found: Found, case: Case, policy: str, flown: Sequence[Flown]) -> None:
    where = f"{case.name}, policy {policy}"
    data_mb = _data_mb(case)
    knee = knee_of(flown)
    size_mb = case.sizes_mb[knee] if knee is not None else None
    share = 100 * size_mb / data_mb if size_mb else None
    peak = (
        f"; not known closer than {_before(case, knee):g} to {size_mb:g} MB" if knee else ""
    )
    note = f"data set {data_mb:,.0f} MB in memory{peak}"
    paper = PAPER_MB, PAPER_SHARE
    row = Row(KEY, where, "smallest cache that suffices", "MB", paper[0], SOURCE, size_mb)
    found.rows.append(row)
    note += ". A share of a data set of which the flight sees a part: theirs and ours alike"
    quantity = "smallest cache / data set"
    found.rows.append(Row(KEY, where, quantity, "%", paper[1], SOURCE, share, note))
    floor = flown[-1].whole_bytes / 1e6
    found.rows.append(Row(KEY, where, "read with the largest cache", "MB", None, "", floor))
    for i in sorted({0, (knee or 2) // 2}):
        one, size = flown[i], case.sizes_mb[i]
        quantity = f"read with {size:g} MB / with the largest cache"
        raised = float(np.mean(one.raised))
        note = f"thresholds {raised:.2f} times as large on average"
        more = one.whole_bytes / flown[-1].whole_bytes
        found.rows.append(Row(KEY, where, quantity, "", None, "", more, note))


def _before(case: Case, knee: int | None) -> float:
    return case.sizes_mb[knee - 1] if knee else 0.0


def _data_mb(case: Case) -> float:
    forests = Flyer(case.store, PagerSettings(budget_bytes=2**33)).pager.forests
    return float(sum(forests[lane].records["memory_bytes"].sum() for lane in Lane)) / 1e6

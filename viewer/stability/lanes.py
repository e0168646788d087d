# SPDX-License-Identifier: Apache-2.0
"""Paging at its limits, by a virtual clock: slow storage, starved lanes, sharp turns."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

from geopage.settings import PagerSettings, Throttle
from geopage.view import ViewState
from tiles.frames import WGS84_A_M
from tiles.lanes import Lane
from viewer.camera import Pose, view_state
from viewer.flight import FRAME_S
from viewer.paging import Paging
from viewer.stability.place import SCREEN_PX, Place
from viewer.stability.row import Finding, Row, first_bad

THRESHOLD_PX = 2.0
LATENCY_MS = 100.0
EVERY = 4
"""Frames from one look at the screen error to the next"""
Path = Callable[[float], ViewState]


@dataclass(slots=True)
class Seen:
    """What a flight showed."""

    error_px: list[float] = field(default_factory=list)
    """95th percentile over the picture's ground, every `EVERY` frames"""
    idle_s: dict[Lane, float] = field(default_factory=lambda: dict.fromkeys(Lane, 0.0))
    """longest time that a lane which lacks tiles got none"""
    bytes_read: int = 0
    missing: float = 0.0
    """tiles that the view lacks, mean"""

    def longest_s(self, limit_px: float) -> float:
        """Return the longest time above a screen error."""
        longest = run = 0
        for error_px in self.error_px:
            run = run + 1 if error_px > limit_px else 0
            longest = max(longest, run)
        return longest * EVERY * FRAME_S


def page(place: Place, path: Path, seconds: float, settings: PagerSettings) -> Seen:
    """Page one flight; it begins when its first view is complete."""
    seen, since = Seen(), dict.fromkeys(Lane, 0.0)
    paging = Paging(place.store, settings)
    with paging.pager as pager:
        start_s = paging.settle(path(0.0))
        before, read = paging.missing(path(0.0)), pager.counters["bytes_read"]
        for i in range(round(seconds / FRAME_S)):
            t_s = i * FRAME_S
            view = path(t_s)
            drawn = paging.frame(view)
            missing = paging.missing(view)
            for lane, now, then in zip(Lane, missing, before, strict=True):
                if now == 0 or now < then:
                    since[lane] = t_s
                seen.idle_s[lane] = max(seen.idle_s[lane], t_s - since[lane])
            before = missing
            seen.missing += sum(missing)
            if i % EVERY == 0:
                seen.error_px.append(paging.error_px(drawn, view))
            pager.advance(start_s + t_s, start_s + t_s + FRAME_S)
        seen.missing /= round(seconds / FRAME_S)
        seen.bytes_read = pager.counters["bytes_read"] - read
    return seen


def fly_in(place: Place, seconds: float) -> Path:
    """Return a fall from 3,000 km to 100 m, straight down, by the same factor a second."""
    return lambda t_s: above(place, 3e6 * (100.0 / 3e6) ** min(t_s / seconds, 1.0), t_s)


def above(place: Place, above_m: float, t_s: float, east_rad: float = 0.0) -> ViewState:
    """Return a view down on the finest ground, or beside it."""
    lon, lat = place.finest
    height_m = place.session.surface.height_at(lon, lat) + above_m
    pose = Pose(lon + east_rad, lat, height_m, 0.0, -math.pi / 2)
    return view_state(pose, SCREEN_PX, t_s=t_s)


def slow(place: Place) -> Finding:
    """Fall with a line that gets slower and slower."""
    seconds = place.count(8, 4)

    def worst_s(rate: float, policy: str = "benefit") -> float:
        throttle = Throttle(rate, LATENCY_MS)
        settings = PagerSettings(THRESHOLD_PX, throttle=throttle, policy=policy)
        seen = page(place, fly_in(place, seconds), seconds, settings)
        return seen.longest_s(2 * THRESHOLD_PX)

    breaks = first_bad(lambda r: worst_s(r) <= STALL_S, LINE_MIB_S, 0.05, place.count(5, 3))
    note = f"a fall from 3,000 km to 100 m in {seconds} s, {LATENCY_MS:g} ms a tile"
    ours, others = worst_s(LINE_MIB_S), worst_s(LINE_MIB_S, "demand")
    return Finding(LINE_MIB_S, ours, breaks, 0.05, others, note)


STALL_S, LINE_MIB_S = 0.5, 4.0


def starved(place: Place) -> Finding:
    """Jump into the city over a line that gets slower: both lanes lack much at once."""
    seconds = place.count(8, 4)

    def path(t_s: float) -> ViewState:
        return above(place, 3e6 if t_s == 0.0 else 300.0, t_s)

    def worst_s(rate: float) -> float:
        settings = PagerSettings(THRESHOLD_PX, throttle=Throttle(rate, LATENCY_MS))
        return max(page(place, path, seconds, settings).idle_s.values())

    breaks = first_bad(
        lambda r: worst_s(r) <= IDLE_S, STARVED_MIB_S, 0.02, place.count(6, 3)
    )
    note = f"after a jump to 300 m above the city, {LATENCY_MS:g} ms a tile"
    return Finding(STARVED_MIB_S, worst_s(STARVED_MIB_S), breaks, 0.02, note=note)


IDLE_S, STARVED_MIB_S = 1.0, 1.0


def overshoot(place: Place) -> Finding:
    """Fly to and fro, faster and faster, with prediction and without."""
    seconds = place.count(8, 4)

    def lacks(speed_m_s: float, *, predicts: bool) -> float:
        settings = PagerSettings(THRESHOLD_PX, throttle=Throttle(LINE_MIB_S, LATENCY_MS))
        path = to_and_fro(place, speed_m_s, predicts=predicts)
        return page(place, path, seconds, settings).missing

    def worse(speed_m_s: float) -> float:
        ours, others = (lacks(speed_m_s, predicts=yes) for yes in (True, False))
        return (ours + LITTLE) / (others + LITTLE)

    breaks = first_bad(lambda v: worse(v) <= 1.0, SPEED_M_S, 1000.0, place.count(4, 2))
    note = f"300 m above the city, {TURNS_HZ:g} turns a second"
    return Finding(SPEED_M_S, worse(SPEED_M_S), breaks, 1000.0, note=note)


def to_and_fro(place: Place, speed_m_s: float, *, predicts: bool) -> Path:
    """Return a flight east and west; without a clock nothing can be predicted of it."""

    def path(t_s: float) -> ViewState:
        way = abs((t_s * TURNS_HZ + 0.5) % 2.0 - 1.0) - 0.5
        view = above(place, 300.0, t_s, speed_m_s / WGS84_A_M / TURNS_HZ * way)
        return view if predicts else replace(view, t_s=0.0)

    return path


TURNS_HZ, SPEED_M_S, LITTLE = 0.5, 100.0, 0.05
ROWS = (
    Row(
        "slow storage",
        "the picture stays coarse in a fall: largest screen error first",
        "rate of the line, MiB/s",
        f"longest time above {2 * THRESHOLD_PX:g} px, s; threshold {THRESHOLD_PX:g} px",
        STALL_S,
        slow,
        more_is_harder=False,
    ),
    Row(
        "starvation",
        "one of terrain and buildings waits while the other loads",
        "rate of the line, MiB/s",
        "longest time in which a lane that lacks tiles got none, s",
        IDLE_S,
        starved,
        more_is_harder=False,
    ),
    Row(
        "overshoot",
        "at a turn what was predicted is loaded, not what is seen",
        "speed of a flight to and fro, m/s",
        "tiles that the view lacks with prediction / without it, means",
        1.0,
        overshoot,
    ),
)

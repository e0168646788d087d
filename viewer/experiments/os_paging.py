# SPDX-License-Identifier: Apache-2.0
"""E1: a data set 1.07 times the memory, paged by the operating system or by prediction.

Funkhouser, Database Management for Interactive Display of Large Architectural Models,
1996, section 5. What stands in:

- The building: a city of boxes with one level of detail, seen 400 m deep, driven through
  and back. Sizes are a tenth of theirs; data / memory is the same. Where they see a room
  through a door, all of it at once, we see a tile of some 58 boxes.
- Test A, virtual memory: 4 KiB pages of one image, tile after tile; a frame touches the
  pages of the tiles in its view; what is not resident comes from the disk, page by page,
  while the frame waits; least recently used goes. No read-ahead.
- Test B: geopage's pager with that memory and that disk, by the policies named.
- The disk: 14 ms to a place, 2 MB/s from there, as disks of the time.
- Drawing: a fixed time and one for each box, set so that a frame without a fault takes
  63 ms on average, the paper's mean of B. So means compare only with each other.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from geopage.settings import MIB, PagerSettings, Throttle
from tiles.frames import Floats, Ints
from viewer.experiments.city import MEMORY_BYTES, City, make_city, tile_of, write_city
from viewer.experiments.pages import Flown, Flyer
from viewer.experiments.rows import SAME, Chart, Found, Progress, Row, Series
from viewer.experiments.setting import Setting
from viewer.experiments.walks import SPEED_M_S, STEP_S, Walk, in_frustum, make_walk

KEY = "E1"
SOURCE = "Funkhouser 1996, section 5"
MEMORY, RATIO = 12_800_000, 137 / 128
DEEP_M, THRESHOLD_BOX_M = 400.0, 20.0
PAGE_BYTES = 4096
SEEK_S, BYTES_S = 0.014, 2e6
FAULT_S = SEEK_S + PAGE_BYTES / BYTES_S
SHARES = (1.0, 0.9, 0.75)
MEAN_S, FIXED_SHARE = 0.063, 0.3
PAPER = {"A": (0.082, 0.175, 5.78), "B": (0.063, 0.035, 0.263)}
POLICIES = ("berkeley", "benefit")
NAMES = ("mean", "standard deviation", "longest")


@dataclass(slots=True)
class Trip:
    """A drive, and for each step the tiles in view."""

    city: City
    walk: Walk
    seen: list[Ints]
    first: Ints
    """(tiles + 1,) where each tile's boxes begin in the image"""

    @property
    def draw_s(self) -> Floats:
        """Seconds that each frame takes to draw, (n,)."""
        held = np.diff(self.first)
        count = np.array([held[tiles].sum() for tiles in self.seen], np.float64)
        per_box = MEAN_S * (1 - FIXED_SHARE) / count.mean()
        return np.asarray(MEAN_S * FIXED_SHARE + per_box * count)


def make_trip(memory_bytes: int, seconds: float) -> Trip:
    """Return the drive out and back through a city that is a little too large."""
    city = make_city(round(RATIO * memory_bytes / MEMORY_BYTES))
    start = np.full(2, 0.15 * city.side_m)
    reach_m = 0.7 * city.side_m * 2**0.5
    out = make_walk("normal", start, min(seconds, reach_m / SPEED_M_S["normal"]))
    walk = Walk(
        out.name,
        np.concatenate((out.place, out.place[::-1])),
        np.concatenate((out.heading_rad, out.heading_rad[::-1] + np.pi)),
    )
    _, tile = tile_of(city)
    order = np.argsort(tile, kind="stable")
    first = np.searchsorted(tile[order], np.arange(tile.max() + 2))
    low = np.minimum.reduceat(city.low[order], first[:-1])
    high = np.maximum.reduceat(city.high[order], first[:-1])
    seen = []
    for place, heading in zip(walk.place, walk.heading_rad.tolist(), strict=True):
        away = np.maximum(np.maximum(low[:, :2] - place, place - high[:, :2]), 0)
        near = np.linalg.norm(away, axis=1) < DEEP_M
        seen.append(np.flatnonzero(near & in_frustum(low, high, place, heading)))
    return Trip(city, walk, seen, first)


class VirtualMemory:
    """An operating system's pages, least recently used out first.

    Parameters
    ----------
    pages : of the whole image
    room : how many fit
    """

    def __init__(self, pages: int, room: int) -> None:
        self._used = np.arange(pages)  # the image was read from end to end
        self._there = self._used >= pages - room
        self._room, self._now = room, pages

    def touch(self, pages: Ints) -> int:
        """Use pages; return how many were not there."""
        self._now += 1
        faults = int((~self._there[pages]).sum())
        self._there[pages], self._used[pages] = True, self._now
        over = int(self._there.sum()) - self._room
        if over > 0:
            there = np.flatnonzero(self._there)
            oldest = np.argsort(self._used[there], kind="stable")[:over]
            self._there[there[oldest]] = False
        return faults


def faults_of(trip: Trip, memory_bytes: int) -> NDArray[np.int64]:
    """Return the page faults of each frame under virtual memory."""
    start = trip.first * MEMORY_BYTES
    pages = -(-int(start[-1]) // PAGE_BYTES)
    system = VirtualMemory(pages, memory_bytes // PAGE_BYTES)
    faults = []
    for tiles in [trip.seen[0], *trip.seen]:  # the first view is there before the clock
        spans = [
            np.arange(start[k] // PAGE_BYTES, (start[k + 1] - 1) // PAGE_BYTES + 1)
            for k in tiles.tolist()
        ]
        touched = np.unique(np.concatenate(spans)) if spans else np.zeros(0, np.int64)
        faults.append(system.touch(touched))
    return np.array(faults[1:])


def paged(store: Path, trip: Trip, policy: str, memory_bytes: int) -> Flown:
    """Return the drive by a pager behind the same disk."""
    px = trip.walk.view(0).focal_px * THRESHOLD_BOX_M / DEEP_M
    tile_bytes = 58 * MEMORY_BYTES
    rate = tile_bytes / (SEEK_S + tile_bytes / BYTES_S)
    line = Throttle(rate / MIB, SEEK_S * 1e3)
    settings = PagerSettings(
        px, budget_bytes=memory_bytes, throttle=line, policy=policy, fade_s=0.0
    )
    flyer = Flyer(store, settings)
    views = (trip.walk.view(i) for i in range(len(trip.walk.place)))
    return flyer.fly(views, STEP_S)


def run(setting: Setting, show: Progress) -> Found:
    """Run the experiment."""
    return measure(setting, MEMORY, setting.pick(150.0, 60.0), show)


def measure(setting: Setting, memory_bytes: int, seconds: float, show: Progress) -> Found:
    """Drive with virtual memory, then with each policy."""
    found, trip = Found(), make_trip(memory_bytes, seconds)
    store = write_city(setting.data / "e1.geopage", trip.city, MEMORY_BYTES)
    show(20)
    at_s = (np.arange(len(trip.seen)) * STEP_S).tolist()
    _spread(found, "B, predictive cache", trip.draw_s, PAPER["B"])
    series = [Series("B: never waits", at_s, trip.draw_s.tolist())]
    for share in SHARES:
        stall_s = FAULT_S * faults_of(trip, int(share * memory_bytes)).astype(np.float64)
        ratios = _stalled(found, share, trip.draw_s, stall_s)
        found.says.append(
            f"With {share:.0%} of the memory for the model, virtual memory's longest frame"
            f" is {ratios[2]:.1f} times that of the pager (paper: 22), its spread"
            f" {ratios[1]:.1f} times (5.0), its mean {ratios[0]:.2f} times (1.30)."
        )
        if share == SHARES[1]:
            times_s = (trip.draw_s + stall_s).tolist()
            series.insert(0, Series(f"A: {share:.0%} for the model", at_s, times_s))
    show(30)
    for i, policy in enumerate(POLICIES):
        _pager_rows(found, policy, paged(store, trip, policy, memory_bytes))
        show(30 + 35 * (i + 1))
    title = "Frame times of the drive, by a virtual clock"
    y = "frame time, s"
    found.charts.append(Chart("e1_frames", title, "time, s", y, series, log_y=True))
    found.says.append(
        "No frame of B waits, here as there. Part of their 128 MB held system and program;"
        " the paper does not say how much. On a disk of today all stalls would be a hundred"
        " times shorter."
    )
    return found


def _spread(
    found: Found, where: str, times_s: Floats, papers: tuple[float, ...]
) -> tuple[float, ...]:
    """Add mean, standard deviation and longest of frame times; return them."""
    ours = float(times_s.mean()), float(times_s.std()), float(times_s.max())
    for name, paper, value in zip(NAMES, papers, ours, strict=True):
        is_set = name == "mean" and papers == PAPER["B"]
        note = "set so: see what stands in" if is_set else ""
        quantity = f"frame time, {name}"
        found.rows.append(Row(KEY, where, quantity, "s", paper, SOURCE, value, note))
    return ours


def _stalled(
    found: Found, share: float, draw_s: Floats, stall_s: Floats
) -> tuple[float, ...]:
    """Add what virtual memory comes to when a share of the memory is the model's.

    Returns
    -------
    mean, standard deviation and longest, over those of frames without a stall
    """
    where = f"A, virtual memory, {share:.0%} of it for the model"
    ours = _spread(found, where, draw_s + stall_s, PAPER["A"])
    base = float(draw_s.mean()), float(draw_s.std()), float(draw_s.max())
    for name, a, b, x, y in zip(NAMES, PAPER["A"], PAPER["B"], ours, base, strict=True):
        note = "B reads and manages beside the drawing; ours here does not"
        note = note if share == SHARES[0] and name != "mean" else ""
        quantity = f"frame time, {name}, A / B"
        found.rows.append(Row(KEY, where, quantity, "", a / b, SOURCE, x / y, note, SAME))
    frames = 100 * float((stall_s > 0).mean())
    found.rows.append(Row(KEY, where, "frames that stall", "%", None, "", frames))
    return tuple(x / y for x, y in zip(ours, base, strict=True))


def _pager_rows(found: Found, policy: str, flown: Flown) -> None:
    where, count = f"B, policy {policy}", len(flown.missing)
    frame_kb = flown.bytes_read / count / 1e3
    note = "a frame of 0.1 s, on another path" if policy == POLICIES[0] else ""
    quantity = "loaded a frame"
    paper = 28.4
    found.rows.append(Row(KEY, where, quantity, "kB", paper, SOURCE, frame_kb, note))
    late = 100 * float((np.array(flown.missing) > 0).mean())
    note = '"a few instances"' if policy == POLICIES[0] else ""
    source = SOURCE if note else ""
    quantity = "frames that miss a tile"
    found.rows.append(Row(KEY, where, quantity, "%", None, source, late, note))
    raised = max(flown.raised)
    quantity = "thresholds raised for want of memory, at most"
    found.rows.append(Row(KEY, where, quantity, "", None, "", raised))

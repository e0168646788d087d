# SPDX-License-Identifier: Apache-2.0
"""Clairvoyant: knows the flight and the line, and makes as many frames good as it can.

The reference for the others, not a way to page. The views of the whole flight are known,
and with them the fewest tiles that make each good by area (`geopage.ground_needs`), and
the object tiles that it draws when all is there. Frames are chosen greedily: again and
again the one whose missing tiles have the fewest bytes, if the line can still bring every
chosen frame's tiles before its time (deadlines, earliest first, which is exact). First
frames whose terrain is good, then those that have their objects, too. So it is a very
good choice of frames, not a proven best. What is not chosen comes when nothing else is
to be read. Without a throttle every frame is chosen.

What is used last goes first, or what is never used again (Belady, 1966).
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from geopage.ground_needs import ground_needs_of, work_of
from geopage.outlook import outlook
from geopage.policies.demand import by_error
from geopage.policies.protocol import Numbers, Plan, Requests, Situation, in_order
from geopage.screen_error import lens_of
from geopage.selection import Thresholds, everything, select
from geopage.tree import F8, Tree
from geopage.view import ViewState
from tiles.forest import Rows
from tiles.lanes import Lane

SLOT_S = 0.1
HORIZON_S = 15.0
"""Nothing that is scheduled later is asked for."""
NEVER = np.inf


Needs = dict[Lane, NDArray[np.bool_]]
"""For each lane, (slots, n): what the view of each slot draws when all is there."""


def needs_of(
    trees: Mapping[Lane, Tree],
    views: Sequence[ViewState],
    grounds_m: Sequence[float],
    limits: Thresholds,
) -> Needs:
    """Say what each of a flight's views needs.

    Parameters
    ----------
    grounds_m : for each view, the height of the ground under the eye
    """
    land, there = trees[Lane.TERRAIN], everything(trees)
    nothing, work = np.zeros(len(land.parent), np.uint8), work_of(land)
    needs = {
        lane: np.zeros((len(views), len(tree.parent)), np.bool_)
        for lane, tree in trees.items()
    }
    for slot, (view, ground_m) in enumerate(zip(views, grounds_m, strict=True)):
        ahead = outlook(view, None, ground_m, np.zeros(1))
        found = ground_needs_of(land, nothing, ahead, limits.terrain_px, 1, work)
        needs[Lane.TERRAIN][slot, found.rows] = True
        drawn = select(trees, lens_of(view), there, limits).objects
        needs[Lane.OBJECTS][slot, drawn] = True
    return needs


def frames_to_fill(
    needs: NDArray[np.bool_], size_bytes: F8, slot_bytes: float, given: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Choose frames whose tiles can all be there in time, (slots,).

    Parameters
    ----------
    needs : (slots, n)
    size_bytes : (n,)
    slot_bytes : what the line brings in a slot
    given : (slots,) frames that are chosen already, of which the tiles can be there
    """
    chosen, open_ = given.copy(), ~given
    there = needs[chosen].any(axis=0)
    while open_.any():
        missing = needs @ (size_bytes * ~there)
        slot = int(np.argmin(np.where(open_, missing, np.inf)))
        open_[slot] = False
        chosen[slot] = True
        if in_time(needs, size_bytes, slot_bytes, chosen):
            there |= needs[slot]
        else:
            chosen[slot] = False
    return chosen


def in_time(
    needs: NDArray[np.bool_], size_bytes: F8, slot_bytes: float, chosen: NDArray[np.bool_]
) -> bool:
    """Say whether the line can bring every chosen frame's tiles before the frame."""
    slots = np.flatnonzero(chosen)
    first = deadlines(needs, chosen)
    due = np.bincount(first[np.isfinite(first)].astype(int), size_bytes[np.isfinite(first)])
    brought = np.cumsum(np.pad(due, (0, len(chosen) - len(due))))
    return bool((brought[slots] <= slots * slot_bytes).all())


def deadlines(needs: NDArray[np.bool_], chosen: NDArray[np.bool_]) -> F8:
    """Return the first chosen slot that needs each tile, (n,), infinite: none does."""
    slots = np.flatnonzero(chosen)
    some = needs[slots]
    if not len(slots):
        return np.full(needs.shape[1], NEVER)
    return np.where(some.any(axis=0), slots[some.argmax(axis=0)], NEVER)


class Oracle:
    """Reads what the recorded future needs."""

    def __init__(self) -> None:
        self._needs: Needs = {}
        self._due: dict[Lane, F8] = {}
        self._now = 0.0

    def foresee(
        self,
        trees: Mapping[Lane, Tree],
        views: Sequence[ViewState],
        grounds_m: Sequence[float],
        limits: Thresholds,
        bytes_per_s: float,
    ) -> None:
        """Tell it the flight's views, a slot apart, and what the line carries.

        Parameters
        ----------
        grounds_m : for each view, the height of the ground under the eye
        """
        self._needs = needs_of(trees, views, grounds_m, limits)
        both = np.concatenate([self._needs[lane] for lane in Lane], axis=1)
        size = np.concatenate([trees[lane].tile_bytes for lane in Lane]).astype(float)
        size[both[0]] = 0  # there before the flight begins
        land = self._needs[Lane.TERRAIN].shape[1]
        chosen = np.arange(len(views)) == 0
        slot_bytes = min(bytes_per_s * SLOT_S, float(size.sum()))
        chosen = frames_to_fill(both[:, :land], size[:land], slot_bytes, chosen)
        whole = in_time(both, size, slot_bytes, chosen)
        if whole:
            chosen = frames_to_fill(both, size, slot_bytes, chosen)
        due = deadlines(both if whole else both[:, :land], chosen)
        due = np.pad(due, (0, both.shape[1] - len(due)), constant_values=NEVER)
        self._due = {Lane.TERRAIN: due[:land], Lane.OBJECTS: due[land:]}

    def plan(self, seen: Situation) -> Plan:
        """Ask for what is scheduled next, then for what the newest view misses."""
        self._now = seen.view.t_s / SLOT_S
        requests: Requests = {}
        for lane in Lane:
            wants = seen.chosen.wants[lane]
            missed = wants.rows, by_error(wants)
            order = [self._scheduled(seen, lane), missed]
            requests[lane] = in_order(order if seen.motion else order[::-1], now=2)
        return Plan(requests)

    def _scheduled(self, seen: Situation, lane: Lane) -> tuple[Rows, F8]:
        if not self._due:
            return np.zeros(0, np.int32), np.zeros(0)
        due, absent = self._due[lane], seen.uploaded[lane] == 0
        soon = (due >= np.floor(self._now)) & (due <= self._now + HORIZON_S / SLOT_S)
        rows = np.flatnonzero(soon & absent).astype(np.int32)
        return rows, due[rows]

    def leaving(self, lane: Lane, rows: Rows, last_used: Numbers) -> F8:
        """Order by the next use, the last first."""
        if not self._needs:
            return last_used.astype(np.float64)
        coming = self._needs[lane][int(self._now) :, rows]
        return np.where(coming.any(axis=0), -coming.argmax(axis=0).astype(float), -NEVER)

# SPDX-License-Identifier: Apache-2.0
"""What a policy is asked and what it answers.

A policy says which tiles are wanted, in which order, and which may go first. It does not
say what is drawn: all policies draw the best that is uploaded for the same thresholds,
so that they differ in nothing but paging. Nor can it break a promise of the residency:
what the newest list draws or waits for stays, and the budget holds.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from geopage.eviction import least_recently_used
from geopage.prediction import LEAST_HEIGHT_M, SWEEP_S, Motion, predict, sweep_of
from geopage.screen_error import Lens, lens_of
from geopage.selection import Flags, Selection, Thresholds, select
from geopage.tree import F8, Tree
from geopage.view import ViewState
from tiles import geodesy
from tiles.forest import Rows
from tiles.frames import Ecef
from tiles.lanes import Lane


@dataclass(frozen=True, slots=True)
class PageRequests:
    """All that a lane wants, best first."""

    rows: Rows
    """(w,) each row once"""
    ranks: F8
    """(w,) ascending; smaller is sooner, comparable between the lanes"""
    now: int
    """the first so many are needed by the newest view and may evict what it does not
    need; the others may only evict what no list of the last second needed"""


NOTHING = PageRequests(np.zeros(0, np.int32), np.zeros(0), 0)
GROUP = 1e6
"""Between the ranks of two groups; what is in a group stays well within."""
Numbers = NDArray[np.int64]
Requests = dict[Lane, PageRequests]


@dataclass(frozen=True, slots=True)
class Situation:
    """What a policy may look at when it is asked, once for each draw list."""

    history: Sequence[ViewState]
    """the last views, oldest first"""
    motion: Motion | None
    """None at rest and after a jump"""
    floor_m: float
    """lowest height above the ellipsoid that the eye can get to here"""
    number: int
    """the list's"""
    trees: Mapping[Lane, Tree]
    uploaded: Flags
    limits: Thresholds
    """as they are now, raised when memory is short"""
    shutter_s: float
    chosen: Selection
    """what the newest view draws and misses"""
    destination: ViewState | None = None
    """where the eye is known to be going, if anybody has said so"""
    bytes_per_s: float = math.inf
    """how fast tiles come, as measured"""

    @property
    def view(self) -> ViewState:
        """The newest view."""
        return self.history[-1]

    def lens(self, view: ViewState) -> Lens:
        """Return the lens of a view that moves as the newest one does."""
        return lens_of(view, sweep=sweep_of(view, self.motion, self.shutter_s))

    def look(self, lens: Lens, trees: Mapping[Lane, Tree] | None = None) -> Selection:
        """Select for another lens with what is uploaded now."""
        return select(trees or self.trees, lens, self.uploaded, self.limits)


@dataclass(frozen=True, slots=True)
class Plan:
    """What a policy answers."""

    requests: Requests
    keep: Sequence[Mapping[Lane, Rows]] = ()
    """rows that count as used, though one list earlier than what the newest view uses"""


class Policy(Protocol):
    """One way to page."""

    def plan(self, seen: Situation) -> Plan:
        """Say what is wanted, best first. Thread: scene manager."""

    def leaving(self, lane: Lane, rows: Rows, last_used: Numbers) -> F8:
        """Order tiles that may go. Thread: managers, with the residency's lock held.

        Parameters
        ----------
        lane : Lane
        rows : (n,) tiles that the newest list does not need
        last_used : (n,) number of the newest list that needed each

        Returns
        -------
        (n,) the smallest goes first; comparable between the lanes
        """


def velocity(seen: Situation) -> Ecef:
    """Return how far the eye goes in a second, (3,) m."""
    if seen.motion is None:
        return Ecef(np.zeros(3))
    return Ecef((predict(seen.view, seen.motion, SWEEP_S).eye - seen.view.eye) / SWEEP_S)


def height_of(seen: Situation) -> float:
    """Return how high the eye is above the ground, metres."""
    _, _, height_m = geodesy.to_geodetic(seen.view.eye)
    return max(float(height_m) - seen.floor_m, LEAST_HEIGHT_M)


def everywhere(seen: Situation, view: ViewState) -> Lens:
    """Return a lens that sees in all directions alike."""
    return seen.lens(view)._replace(cone_cos=-1.0, cone_sin=0.0)


def in_order(groups: Sequence[tuple[Rows, F8]], now: int = 1) -> PageRequests:
    """Return requests of groups of rows, each group before the next.

    Parameters
    ----------
    groups : rows and keys, the smallest first within a group; a row that comes again
        counts where it comes first
    now : the first so many groups are needed by the newest view
    """
    rows = np.concatenate([rows for rows, _ in groups])
    apart = [
        i * GROUP + np.clip(key, -GROUP / 3, GROUP / 3) for i, (_, key) in enumerate(groups)
    ]
    ranks = np.concatenate(apart)
    order = np.lexsort((rows, ranks))
    rows, ranks = rows[order], ranks[order]
    _, first = np.unique(rows, return_index=True)
    first.sort()
    ranks = ranks[first]
    return PageRequests(rows[first], ranks, int((ranks < (now - 0.5) * GROUP).sum()))


class LeastRecentlyUsed:
    """The common way to let tiles go: by when a list last needed them."""

    def leaving(self, lane: Lane, rows: Rows, last_used: Numbers) -> F8:
        """Return when each was last needed."""
        return least_recently_used(lane, rows, last_used)

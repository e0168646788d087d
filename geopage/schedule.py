# SPDX-License-Identifier: Apache-2.0
"""Which pictures can be good in time, and what to read first for them.

A goal is that one picture ahead has all tiles of one kind. The line brings so many bytes
until then. Goals are chosen greedily: again and again the one that takes the fewest
further bytes for the time that its picture lasts, if the line can still bring all that
was chosen before it is due (earliest due first, which is exact). So bytes go where they
make pictures good, and nothing is read for a picture that it would come too late for.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geopage.ground_needs import Needs
from geopage.tree import F4, F8
from tiles.forest import Rows
from tiles.kernels import kernel

Places = NDArray[np.int16]
Tile_bytes = NDArray[np.int64]
NONE = np.int16(2**15 - 1)
STEP = 100.0
"""Between the ranks of what two pictures wait for."""
UNMET = 1e4
"""Rank from which on tiles come too late for any picture that is looked at."""
_HALF = 0.49 * STEP


class Line(NamedTuple):
    """What is booked on the line, for each of k pictures."""

    room_bytes: F8
    """(k,) what can come before the picture, ascending"""
    lasts_s: F8
    """(k,) how long it is seen"""
    brought_bytes: F8
    """(k,) what is to come until then"""
    chosen: NDArray[np.bool_]
    """(k,) something is to be there in time"""


class Marks(NamedTuple):
    """Room for marks on all rows of a lane; as `marks_of` made it between two calls."""

    due: Places
    """(n,) first picture that is to have a tile"""
    gain: F4
    coarsest: NDArray[np.int8]


def marks_of(count: int) -> Marks:
    """Return room for a lane of so many rows."""
    none = np.full(count, NONE, np.int16)
    return Marks(none, np.zeros(count, np.float32), np.zeros(count, np.int8))


def line_of(ahead_s: F8, bytes_per_s: float, lag_s: float) -> Line:
    """Return a line on which nothing is booked.

    Parameters
    ----------
    ahead_s : (k,) when each picture will be seen
    lag_s : from the last byte until a tile is drawn
    """
    room = np.maximum(ahead_s - lag_s, 0.0) * min(bytes_per_s, 1e15)
    count = len(room)
    return Line(room, np.gradient(ahead_s), np.zeros(count), np.zeros(count, np.bool_))


@kernel
def choose(
    needs: Needs, goals: Rows, share: float, size_bytes: Tile_bytes, line: Line, due: Places
) -> NDArray[np.bool_]:
    """Choose goals that can all be met in time, and book them.

    Parameters
    ----------
    needs : of m goals for each picture, those of one picture together
    goals : (g,) the ones to choose from
    share : of the room that may be taken
    size_bytes : (n,) stored size of each row's tile
    line, due : are changed

    Returns
    -------
    (g,) goals that can be met
    """
    pictures = len(line.room_bytes)
    each = (len(needs.start) - 1) // pictures
    met, open_ = np.zeros(len(goals), np.bool_), np.ones(len(goals), np.bool_)
    more = np.empty(pictures)
    for _ in range(len(goals)):
        best, least = -1, np.inf
        for i in range(len(goals)):
            if open_[i]:
                cost = fresh_bytes(needs, goals[i], size_bytes, due)
                cost /= line.lasts_s[goals[i] // each]
                if cost < least:
                    best, least = i, cost
        open_[best] = False
        goal, here = goals[best], goals[best] // each
        rows = needs.rows[needs.start[goal] : needs.start[goal + 1]]
        more[:] = 0.0
        for row in rows:
            for k in range(here, min(due[row], pictures)):
                more[k] += size_bytes[row]
        met[best] = fits(line, here, more, share)
        if met[best]:
            line.chosen[here] = True
            line.brought_bytes[:] += more
            for row in rows:
                due[row] = min(due[row], here)
    return met


@kernel
def fresh_bytes(needs: Needs, goal: int, size_bytes: Tile_bytes, due: Places) -> float:
    """Return the bytes of a goal that nothing chosen needs."""
    fresh = 0.0
    for i in range(needs.start[goal], needs.start[goal + 1]):
        if due[needs.rows[i]] == NONE:
            fresh += size_bytes[needs.rows[i]]
    return fresh


@kernel
def fits(line: Line, here: int, more: F8, share: float) -> bool:
    """Say whether more bytes leave all that is chosen in time."""
    for k in range(here, len(more)):
        asked = k == here or (line.chosen[k] and more[k] > 0.0)
        if asked and line.brought_bytes[k] + more[k] > share * line.room_bytes[k]:
            return False
    return True


@kernel
def ranked(
    needs: Needs, size_bytes: Tile_bytes, line: Line, marks: Marks
) -> tuple[Rows, F8]:
    """Rank all that is missing, and clear the marks.

    First what is due first, and of that what is most of the pictures for its bytes. Then
    what comes too late for any goal: the coarsest first, since it shows soonest.

    Returns
    -------
    rows : (w,) each row once
    ranks : (w,) smaller is sooner, comparable between the lanes
    """
    pictures = len(line.room_bytes)
    each = (len(needs.start) - 1) // pictures
    found, count = np.empty(len(needs.rows), np.int32), 0
    for goal in range(pictures * each):
        for i in range(needs.start[goal], needs.start[goal + 1]):
            row = needs.rows[i]
            if marks.gain[row] == 0.0:
                found[count], marks.coarsest[row] = row, 0
                count += 1
            marks.coarsest[row] = max(marks.coarsest[row], goal % each)
            marks.gain[row] += max(needs.share[i], 1e-9) * line.lasts_s[goal // each]
    rows, ranks = found[:count].copy(), np.empty(count)
    for i in range(count):
        row = rows[i]
        worth = np.log(marks.gain[row] / max(size_bytes[row], 1))
        ranks[i] = -min(max(worth + 20.0, -_HALF), _HALF)
        if marks.due[row] < NONE:
            ranks[i] += STEP * marks.due[row]
        else:
            ranks[i] += UNMET - STEP * marks.coarsest[row]
        marks.due[row], marks.gain[row] = NONE, 0.0
    return rows, ranks

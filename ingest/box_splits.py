# SPDX-License-Identifier: Apache-2.0
"""Groups of buildings split into boxes, as compiled loops.

A group starts as one box, and the box that is most wrong is split again and again, as a
surface area heuristic splits a box of triangles: across either axis, at the one of 16
places that leaves least wrong volume.
"""

import math

import numpy as np

from ingest.box_fit import (
    COLUMNS,
    GROUND,
    HIGH_U,
    HIGH_V,
    LOW_U,
    LOW_V,
    TOP,
    fit,
    roof_m,
)
from ingest.proxy_solids import Frame, Solids
from tiles.frames import Floats, Ints
from tiles.kernels import inlined, kernel

_BINS = 16
_LEAST_COVER = 0.1
"""Share of a box that its buildings fill; an ordinary town fills a third."""
_MOST_HEIGHTS = 2.0
"""Height of a box above its ground, in heights of its tallest building."""
_SUMS = 8
"""For each bin: ends along both axes; area, and times height, miss and miss squared."""


@kernel
def split_groups(
    solids: Solids, first: Ints, last: Ints, frames: Floats, most: Ints
) -> tuple[Ints, Ints, Ints, Floats]:
    """Split each group of buildings into at most so many boxes.

    Parameters
    ----------
    first, last : (g,) group k holds the buildings from first[k] to last[k] - 1
    frames : (g, 4) rows of `Frame`
    most : (g,) boxes

    Returns
    -------
    item : (m,) building numbers, box by box
    begin : (b + 1,) where each box begins in `item`
    group : (b,)
    box : (b, 10) columns as in `box_fit`
    """
    item = np.empty(np.sum(last - first), np.int64)
    room = np.sum(np.minimum(most, last - first))
    begin, group = np.zeros(room + 1, np.int64), np.empty(room, np.int64)
    box = np.empty((room, COLUMNS))
    boxes = filled = 0
    for g in range(len(first)):
        count = last[g] - first[g]
        here = item[filled : filled + count]
        here[:] = np.arange(first[g], last[g])
        frame = Frame(frames[g, 0], frames[g, 1], frames[g, 2], frames[g, 3])
        ends, found = _split_group(solids, frame, here, min(most[g], count))
        begin[boxes + 1 : boxes + 1 + len(ends)] = filled + ends
        group[boxes : boxes + len(ends)] = g
        box[boxes : boxes + len(ends)] = found
        boxes += len(ends)
        filled += count
    return item, begin[: boxes + 1].copy(), group[:boxes].copy(), box[:boxes].copy()


@kernel
def _split_group(
    solids: Solids, frame: Frame, item: Ints, most: int
) -> tuple[Ints, Floats]:
    """Sort `item` by box; return where boxes end, and the boxes."""
    low, high = np.zeros(most, np.int64), np.zeros(most, np.int64)
    wrong, box = np.zeros(most), np.empty((most, COLUMNS))
    high[0], count = len(item), 1
    ends = np.empty((len(item), 4))
    wrong[0] = fit(solids, frame, item, ends, box[0])
    while count < most:
        worst = np.argmax(wrong[:count])
        if wrong[worst] <= 0:
            break
        here = slice(low[worst], high[worst])
        middle = low[worst] + _divide(solids, item[here], ends[here], box[worst])
        low[count], high[count], high[worst] = middle, high[worst], middle
        for k in (worst, count):
            here = slice(low[k], high[k])
            wrong[k] = fit(solids, frame, item[here], ends[here], box[k])
        count += 1
    for k in range(count):
        here = slice(low[k], high[k])
        _settle(solids, frame, item[here], ends[here], box[k])
    order = np.argsort(low[:count])
    return high[order], box[order]


@kernel
def _settle(solids: Solids, frame: Frame, item: Ints, ends: Floats, box: Floats) -> None:
    """Put a box around the densest of its buildings, where all of them are mostly air.

    The others are left out: that is off by their size, a box that hangs above a
    valley by more. Then its sides move inwards, all as far, until its area is that of
    its buildings: half a street is filled on each side instead of a whole one on one.
    """
    tall = np.max(solids.top_m[item] - solids.ground_m[item])
    count, area = len(item), np.sum(solids.area_m2[item])
    width, length = box[HIGH_U] - box[LOW_U], box[HIGH_V] - box[LOW_V]
    while count > 1 and (
        area < _LEAST_COVER * width * length
        or box[TOP] - box[GROUND] > _MOST_HEIGHTS * tall
    ):
        lower = _divide(solids, item[:count], ends[:count], box)
        below = np.sum(solids.area_m2[item[:lower]])
        if below < area / 2:
            item[:count] = np.concatenate((item[lower:count], item[:lower]))
            lower, below = count - lower, area - below
        count, area = lower, below
        fit(solids, frame, item[:count], ends[:count], box)
        width, length = box[HIGH_U] - box[LOW_U], box[HIGH_V] - box[LOW_V]
    half, over = width + length, max(width * length - area, 0.0)
    inset = (half - math.sqrt(max(half * half - 4 * over, 0.0))) / 4
    box[LOW_U], box[HIGH_U] = box[LOW_U] + inset, box[HIGH_U] - inset
    box[LOW_V], box[HIGH_V] = box[LOW_V] + inset, box[HIGH_V] - inset


@kernel
def _divide(solids: Solids, item: Ints, ends: Floats, box: Floats) -> int:
    """Sort buildings to both sides of the best place to split, and return it."""
    count = len(item)
    middle, miss = np.empty((2, count)), np.empty(count)
    for k in range(count):
        middle[0, k] = ends[k, 0] + ends[k, 1]
        middle[1, k] = ends[k, 2] + ends[k, 3]
        u, v = middle[0, k] / 2, middle[1, k] / 2
        miss[k] = solids.top_m[item[k]] - roof_m(box, u, v)
    bins = min(_BINS, 2 * count)
    sums, upper = np.empty((bins, _SUMS)), np.empty(bins)
    least, at, axis = np.inf, 0.0, 0
    for way in range(2):
        low, high = np.min(middle[way]), np.max(middle[way])
        if high <= low:
            continue
        place = (middle[way] - low) / (high - low) * bins
        _bin(solids, item, ends, place, miss, sums)
        k, wrong = _best(sums, upper)
        if wrong < least:
            least, axis, at = wrong, way, low + k * (high - low) / bins
    left = middle[axis] < at
    if not left.any() or left.all():
        left = np.arange(count) < count // 2
    item[:] = np.concatenate((item[left], item[~left]))
    return int(np.sum(left))


@kernel
def _bin(
    solids: Solids, item: Ints, ends: Floats, place: Floats, miss: Floats, sums: Floats
) -> None:
    for one in sums:
        one[0], one[1], one[2], one[3] = np.inf, -np.inf, np.inf, -np.inf
        one[4] = one[5] = one[6] = one[7] = 0.0
    for k in range(len(item)):
        one, i = sums[min(int(place[k]), len(sums) - 1)], item[k]
        one[0], one[1] = min(one[0], ends[k, 0]), max(one[1], ends[k, 1])
        one[2], one[3] = min(one[2], ends[k, 2]), max(one[3], ends[k, 3])
        area = solids.area_m2[i]
        one[4] += area
        one[5] += area * (solids.top_m[i] - solids.ground_m[i])
        one[6] += area * miss[k]
        one[7] += area * miss[k] * miss[k]


@kernel
def _best(sums: Floats, upper: Floats) -> tuple[int, float]:
    """Return the first bin of the upper side of the best split, and what it leaves."""
    side = sums[-1].copy()
    for k in range(len(sums) - 1, 0, -1):
        upper[k] = _wrong(side)
        _join(side, sums[k - 1])
    side[:] = sums[0]
    best, least = 1, np.inf
    for k in range(1, len(sums)):
        both = _wrong(side) + upper[k]
        if both < least:
            best, least = k, both
        _join(side, sums[k])
    return best, least


@inlined
def _join(side: Floats, more: Floats) -> None:
    side[0], side[1] = min(side[0], more[0]), max(side[1], more[1])
    side[2], side[3] = min(side[2], more[2]), max(side[3], more[3])
    side[4], side[5] = side[4] + more[4], side[5] + more[5]
    side[6], side[7] = side[6] + more[6], side[7] + more[7]


@inlined
def _wrong(side: Floats) -> float:
    """Return the wrong volume of a box: air, and roofs by their deviation."""
    air = max((side[1] - side[0]) * (side[3] - side[2]) - side[4], 0.0)
    deviation = math.sqrt(max(side[7] * side[4] - side[6] * side[6], 0.0))
    return float(air * side[5] / side[4] + deviation)

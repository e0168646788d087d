# SPDX-License-Identifier: Apache-2.0
"""Where a source's triangles end: its rim, as short straight lines.

A line carries at both ends the difference between the source and the coarser surface.
Along it the source is linear; where the coarser surface is not, the line is halved.
"""

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from ingest.layer import Layer
from ingest.rim import Rim
from tiles.frames import Floats
from tiles.geodesy import to_ecef
from tiles.kernels import inlined, kernel
from tiles.raster_blocks import BLOCK

TILE_COLS = 8 * BLOCK
HALVINGS = 6
TOLERANCE_M, TOLERANCE = 0.03, 0.001
"""Largest difference from linear along a line: metres, and a share of the difference."""
LONE = 0.05
"""A post without a triangle becomes a line this long to both sides, in posts."""
MOST_LINES = 1_500_000
"""Ceiling of a rim, 60 MB: of a longer one every second line is left out."""
PROBE = 61
"""One of so many edges is looked at for what that costs"""
MET = 99.0
"""Percentage of them that counts"""
Coarse = Callable[[Floats, Floats], Floats]
"""Height of the coarser surface at longitudes and latitudes, (n,) m"""
Keep = Callable[[Floats, Floats], NDArray[np.bool_]]
"""Whether an edge is kept that has an end, or its middle, at a lon and lat, (n,)"""
Parts = Sequence[tuple[Layer, Keep | None]]
"""Sources, each with those of its edges that are kept: all of them where it's None"""


def rim_lines(
    parts: Parts, coarse: Coarse, most: int = MOST_LINES
) -> tuple[Floats, NDArray[np.float32], int]:
    """Return the rim of sources, or those of its edges that are to be kept.

    Returns
    -------
    ends : (n, 2, 3) float64, ECEF m at height 0
    delta_m : (n, 2) float32, source minus coarser surface there
    stride : one of so many lines is returned
    """
    ends, deltas, stride = [np.zeros((0, 2, 3))], [np.zeros((0, 2), np.float32)], 1
    for layer, edges, height in _kept(parts):
        at, delta = halved(layer, coarse, edges[::stride], height[::stride])
        lon, lat = layer.places(*at.reshape(-1, 2).T)
        ends.append(to_ecef(lon, lat, 0.0).reshape(-1, 2, 3))
        deltas.append(delta.astype(np.float32))
        while sum(map(len, deltas)) > most:
            stride *= 2
            ends = [np.concatenate(ends)[::2]]
            deltas = [np.concatenate(deltas)[::2]]
    return np.concatenate(ends), np.concatenate(deltas), stride


def missed_m(rim: Rim, parts: Parts, coarse: Coarse) -> float:
    """Return how far from a source's edges the surface that meets them ends, m.

    So close it is at 99 of 100 of them: more than nothing where lines were left out.
    """
    off = [np.zeros(1)]
    for layer, edges, height in _kept(parts):
        lon, lat = layer.places(*edges[::PROBE].mean(axis=1).T)
        delta = height[::PROBE].mean(axis=1) - coarse(lon, lat)
        far = np.abs(rim.deltas(lon, lat)[0] - delta)
        # An edge may reach to where the coarser surface has no data.
        off.append(far[np.isfinite(far)])
    return float(np.percentile(np.concatenate(off), MET))


def _kept(parts: Parts) -> Iterator[tuple[Layer, Floats, Floats]]:
    for layer, keep in parts:
        for edges, height in rim_edges(layer):
            if keep is None:
                yield layer, edges, height
                continue
            ends_and_middle = edges[:, 0], edges[:, 1], edges.mean(axis=1)
            shown = [keep(*layer.places(*one.T)) for one in ends_and_middle]
            kept = np.flatnonzero(np.logical_or.reduce(shown))
            yield layer, edges[kept], height[kept]


def halved(
    layer: Layer, coarse: Coarse, at: Floats, height: Floats
) -> tuple[Floats, Floats]:
    """Halve lines until the difference from the coarser surface is linear along each.

    Parameters
    ----------
    at : (n, 2, 2) column and row of both ends
    height : (n, 2) m, the source's there

    Returns
    -------
    at : (m, 2, 2)
    delta_m : (m, 2)
    """

    def gap(places: Floats, fine: Floats) -> Floats:
        lon, lat = layer.places(*places.reshape(-1, 2).T)
        return fine - coarse(lon, lat).reshape(fine.shape)

    if not len(at):
        return at, height
    delta = gap(at, height)
    done = []
    for _ in range(HALVINGS):
        middle, mean = at.mean(axis=1), height.mean(axis=1)
        there = gap(middle, mean)
        off = np.abs(there - delta.mean(axis=1))
        bad = ~(off <= TOLERANCE_M + TOLERANCE * np.abs(there))
        done.append((at[~bad], delta[~bad]))
        if not bad.any():
            break
        at = _halves(at[bad], middle[bad])
        height = _halves(height[bad], mean[bad])
        delta = _halves(delta[bad], there[bad])
    else:
        done.append((at, delta))
    at, delta = (np.concatenate(parts) for parts in zip(*done, strict=True))
    # An edge may end where the coarser surface has no data.
    known = np.isfinite(delta).all(axis=1)
    return at[known], delta[known]


def _halves(ends: Floats, middle: Floats) -> Floats:
    first, last = ends[:, 0], ends[:, 1]
    return np.concatenate([np.stack(p, axis=1) for p in ((first, middle), (middle, last))])


def rim_edges(layer: Layer) -> Iterator[tuple[Floats, Floats]]:
    """Yield the edges of triangles that end a source's surface, a part of it at a time.

    Yields
    ------
    at : (n, 2, 2) column and row of both ends
    height_m : (n, 2)
    """
    for top, left, posts, known in layer.framed(BLOCK, TILE_COLS):
        edges = _edges(known)
        if not len(edges):
            continue
        height = posts[edges[..., 1], edges[..., 0]].astype(np.float64)
        at = edges + np.array([left - 1.0, top - 1.0])
        alone = (edges[:, 0] == edges[:, 1]).all(axis=1)
        at[alone, :, 0] += (-LONE, LONE)
        yield at, height


@kernel
def _edges(known: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the edges that are not between two triangles, (n, 2, 2) column and row.

    An edge belongs to its north-western post; posts in the frame are looked at only.
    A post that no edge touches is an edge from itself to itself.
    """
    found = np.empty((0, 2, 2), np.int64)
    for fill in (False, True):
        count = 0
        for r in range(1, known.shape[0] - 1):
            for c in range(1, known.shape[1] - 1):
                beside = known[r - 1, c] & known[r, c - 1] & known[r, c + 1]
                if not known[r, c] or (beside & known[r + 1, c] & known[r + 1, c + 1]):
                    continue
                for k, is_edge in enumerate(_edges_at(known, r, c)):
                    if is_edge and fill:
                        found[count, 0, 0], found[count, 0, 1] = c, r
                        found[count, 1, 0], found[count, 1, 1] = c + k % 2, r + k // 2
                    count += is_edge
        if not fill:
            found = np.empty((count, 2, 2), np.int64)
    return found


@inlined
def _edges_at(known: NDArray[np.bool_], r: int, c: int) -> tuple[bool, bool, bool, bool]:
    """Say which edges of a known post end the surface: to itself, east, south, diagonal."""
    east, south, diagonal = known[r, c + 1], known[r + 1, c], known[r + 1, c + 1]
    north, west = known[r - 1, c], known[r, c - 1]
    any_beside = east or south or diagonal or north or west or known[r - 1, c - 1]
    return (
        not any_beside,
        east and not (diagonal and north),
        south and not (diagonal and west),
        diagonal and not (east and south),
    )

# SPDX-License-Identifier: Apache-2.0
"""One tile's surface with its triangles sorted into squares: heights of many places.

A place is only tried against the triangles whose box meets its square, in their order
in the tile: the first that holds it, as in a search through all of them, or the nearest
where rounding leaves none.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tiles import cells
from tiles.frames import WGS84_A_M, WGS84_B_M, WGS84_E2, Floats, Ints
from tiles.kernels import inlined, kernel
from tiles.mesh import UV_ONE
from tiles.terrain import TerrainTile

TRIANGLES_PER_SQUARE = 2.0
MOST_SQUARES = 128
"""Along an edge of the cell."""
AMISS = -1e-9
"""A place this far outside of all triangles of its square is looked for in all."""
_TURNS = 2  # of Bowring's iteration: float64's rounding is reached, see tiles.geodesy


class Patch(NamedTuple):
    """A tile's surface, skirts left out."""

    bounds: Floats
    """(4,) west, south, east, north, rad"""
    centre: Floats
    """(3,) ECEF m"""
    widths: tuple[float, float]
    """of the south and the north edge on the map that places are looked up on: 1, or 0 at
    a pole, where meridians meet"""
    at: Floats
    """(v, 2) on that map, west to east and south to north, 0 to 1"""
    local: Floats
    """(v, 3) m around the centre"""
    triangles: NDArray[np.uint16]
    """(t, 3)"""
    side: int
    """squares along an edge of the cell"""
    start: Ints
    """(side * side + 1,) where each square's triangles begin in `items`"""
    items: NDArray[np.int32]


def patch_of(tile: TerrainTile, rung: int = 0) -> Patch:
    """Sort the triangles of a tile's surface, or of a rung's, into squares."""
    triangles = tile.surface(rung)
    at = tile.mesh.vertices["detail"].astype(np.float64) / UV_ONE
    bounds = np.array([float(edge) for edge in cells.bounds_rad(tile.cell)])
    south, north = (np.abs(bounds[1::2]) < cells.POLAR_RAD).astype(float).tolist()
    _put_on_map(at, (south, north))
    wanted = math.ceil(math.sqrt(len(triangles) / TRIANGLES_PER_SQUARE))
    side = min(max(wanted, 1), MOST_SQUARES)
    start, items = _sorted(triangles, at, side)
    local, frame = np.ascontiguousarray(tile.mesh.local), (bounds, tile.mesh.centre)
    return Patch(*frame, (south, north), at, local, triangles, side, start, items)


@kernel
def _put_on_map(at: Floats, widths: tuple[float, float]) -> None:
    """Turn fractions of the cell into places on its map."""
    for i in range(len(at)):
        at[i, 0] = _across(at[i, 0], at[i, 1], widths)


@inlined
def _across(x: float, y: float, widths: tuple[float, float]) -> float:
    """Return how far east a fraction of the cell is on its map."""
    return 0.5 + (x - 0.5) * (widths[0] + (widths[1] - widths[0]) * y)


@kernel
def _sorted(
    triangles: NDArray[np.uint16], at: Floats, side: int
) -> tuple[Ints, NDArray[np.int32]]:
    """Count, then fill; each square's triangles stay in their order."""
    start = np.zeros(side * side + 1, np.int64)
    for t in range(len(triangles)):
        west, south, east, north = _squares(triangles, at, side, t)
        for row in range(south, north + 1):
            for column in range(west, east + 1):
                start[row * side + column + 1] += 1
    start = np.cumsum(start)
    place, items = start[:-1].copy(), np.empty(start[-1], np.int32)
    for t in range(len(triangles)):
        west, south, east, north = _squares(triangles, at, side, t)
        for row in range(south, north + 1):
            for column in range(west, east + 1):
                items[place[row * side + column]] = t
                place[row * side + column] += 1
    return start, items


@inlined
def _squares(
    triangles: NDArray[np.uint16], at: Floats, side: int, t: int
) -> tuple[int, int, int, int]:
    a, b, c = triangles[t]
    return (
        _square(min(at[a, 0], at[b, 0], at[c, 0]), side),
        _square(min(at[a, 1], at[b, 1], at[c, 1]), side),
        _square(max(at[a, 0], at[b, 0], at[c, 0]), side),
        _square(max(at[a, 1], at[b, 1], at[c, 1]), side),
    )


@inlined
def _square(at: float, side: int) -> int:
    return int(min(max(at * side, 0.0), side - 1.0))


@kernel
def heights_on(patch: Patch, lon_rad: Floats, lat_rad: Floats, height_m: Floats) -> None:
    """Write the heights of (n,) places of the tile's cell above the ellipsoid, m."""
    west, south, east, north = patch.bounds
    local, centre = patch.local, patch.centre
    every = np.arange(len(patch.triangles)).astype(np.int32)
    for i in range(len(lon_rad)):
        lon = lon_rad[i]
        away = lon - (west + east) / 2
        if abs(away) > math.pi:
            lon -= 2 * math.pi * math.copysign(1.0, away)
        x, y = (lon - west) / (east - west), (lat_rad[i] - south) / (north - south)
        x = _across(x, y, patch.widths)
        square = _square(y, patch.side) * patch.side + _square(x, patch.side)
        near = patch.items[patch.start[square] : patch.start[square + 1]]
        best, a, b, c, wa, wb, wc = _search(patch.triangles, patch.at, near, x, y)
        if best < AMISS:
            _, a, b, c, wa, wb, wc = _search(patch.triangles, patch.at, every, x, y)
        height_m[i] = _height_m(
            wa * local[a, 0] + wb * local[b, 0] + wc * local[c, 0] + centre[0],
            wa * local[a, 1] + wb * local[b, 1] + wc * local[c, 1] + centre[1],
            wa * local[a, 2] + wb * local[b, 2] + wc * local[c, 2] + centre[2],
        )


@kernel
def _search(
    triangles: NDArray[np.uint16], at: Floats, among: NDArray[np.int32], x: float, y: float
) -> tuple[float, int, int, int, float, float, float]:
    """Return how far inside a place is, its triangle's corners and their weights."""
    best, found, wa, wb, wc = -np.inf, 0, 1.0, 0.0, 0.0
    for t in among:
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        ax, ay = at[a, 0] - x, at[a, 1] - y
        bx, by = at[b, 0] - x, at[b, 1] - y
        cx, cy = at[c, 0] - x, at[c, 1] - y
        w0, w1, w2 = bx * cy - by * cx, cx * ay - cy * ax, ax * by - ay * bx
        area, least = w0 + w1 + w2, min(w0, w1, w2)
        if area <= 0.0 or least <= best * area:
            continue
        best, found, wa, wb, wc = least / area, t, w0 / area, w1 / area, w2 / area
        if least >= 0.0:
            break
    a, b, c = triangles[found, 0], triangles[found, 1], triangles[found, 2]
    return best, a, b, c, wa, wb, wc


@inlined
def _height_m(x: float, y: float, z: float) -> float:
    """Return the height of an ECEF point, as `geodesy.to_geodetic` does."""
    axis = math.sqrt(x * x + y * y)
    up, out = z * WGS84_A_M, axis * WGS84_B_M
    for _ in range(_TURNS):
        length = math.sqrt(up * up + out * out)
        sine, cosine = up / length, out / length
        up = (z + WGS84_E2 * WGS84_A_M**2 / WGS84_B_M * sine**3) * WGS84_B_M
        out = (axis - WGS84_E2 * WGS84_A_M * cosine**3) * WGS84_A_M
    up, out = up / WGS84_B_M, out / WGS84_A_M
    length = math.sqrt(up * up + out * out)
    sine, cosine = up / length, out / length
    height = axis * cosine + z * sine
    return height - WGS84_A_M * math.sqrt(1.0 - WGS84_E2 * sine**2)

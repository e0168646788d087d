# SPDX-License-Identifier: Apache-2.0
"""Pictures laid over the texels of a cell: the finest first, the coarser where it is clear.

Texels are placed by interpolating between nodes whose column and row are exact, as many
as it takes: a map projection for each texel would take longer than all the rest.
"""

import numpy as np
from numpy.typing import NDArray

from ingest.boxes import edge_m, edges_rad, overlap
from ingest.layer import Layer
from ingest.picture_rim import faded
from ingest.polar import is_polar, lon_at
from tiles.frames import Floats
from tiles.kernels import inlined, kernel
from tiles.terrain import TEXTURE_SIDE

COARSE_M, COARSE_SHARE = 1000.0, 0.75
"""A picture of the whole earth is far coarser than the relief under it: a quarter of the
height tint keeps valleys and summits apart. The same at every level, so no seam shows."""
NODES = (16, 64, 256)
"""Spans between nodes along an edge: the first that is good enough."""
GOOD_PX = 0.4
"""Largest error at every other node, when the nodes between are left out: a quarter of it
is left between the nodes themselves."""


SHARE, CLEAR, FINE = 3, 4, 5
ALL = np.float32(0.999)
"""So opaque that nothing shows through: sums of weights are rounded."""
MOST_SAMPLES = 32
"""Texels of a picture averaged along a texel's row, where it is so much longer: near a
pole, those of a picture in degrees are narrow."""
Rows = NDArray[np.float32]


def drape(cell: int, pictures: list[Layer]) -> NDArray[np.float32]:
    """Lay pictures, coarsest first, over the texels of a cell.

    Returns
    -------
    (256, 256, 9) float32, row 0 south: the pictures' sRGB colour 0..255 times its share,
    its share, how much a coarser picture would show through, and from FINE on colour and
    share of those finer than COARSE_M alone
    """
    out = np.zeros((TEXTURE_SIDE, TEXTURE_SIDE, FINE + 4), np.float32)
    out[..., CLEAR] = 1.0
    texel_m = edge_m(cell) / TEXTURE_SIDE
    for layer in reversed(pictures):
        shares = faded(cell, layer, pictures)
        for part in parts_under(cell, layer.bounds_deg):
            _lay(out, cell, layer, part, (texel_m, shares))
        if layer.spacing_m <= COARSE_M:
            out[..., FINE:] = out[..., :CLEAR]
        if not out[..., CLEAR].any():
            break
    return out


def parts_under(
    cell: int, bounds_deg: tuple[float, float, float, float]
) -> list[tuple[int, int, int, int]]:
    """Return the rectangles of texels, (x0, x1, y0, y1), that meet a box."""
    west, south, east, _ = edges_rad(cell)
    texel = float(east - west) / TEXTURE_SIDE
    box = np.radians(bounds_deg)
    y0, y1 = _span((box[1] - south) / texel, (box[3] - south) / texel)
    found = []
    if is_polar(cell):
        return [(0, TEXTURE_SIDE, y0, y1)] if y0 < y1 and overlap(cell, bounds_deg) else []
    for turn in (-2 * np.pi, 0.0, 2 * np.pi):
        x0, x1 = _span((box[0] + turn - west) / texel, (box[2] + turn - west) / texel)
        if x0 < x1 and y0 < y1:
            found.append((x0, x1, y0, y1))
    return found


def _span(low: float, high: float) -> tuple[int, int]:
    """Return the texels, [first, last), that touch an interval."""
    first, last = int(np.floor(low)), int(np.ceil(high))
    return min(max(first, 0), TEXTURE_SIDE), min(max(last, 0), TEXTURE_SIDE)


def _lay(
    out: NDArray[np.float32],
    cell: int,
    layer: Layer,
    part: tuple[int, int, int, int],
    how: tuple[float, Floats],
) -> None:
    """Lay one picture over a rectangle of texels, under what lies there already.

    Parameters
    ----------
    how : the texels' size in metres, and the share of the picture that shows, of `faded`
    """
    texel_m, shares = how
    nodes = _nodes(cell, layer, part, texel_m / layer.spacing_m)
    found = layer.picture(texel_m, *nodes)
    if found is not None:
        window, *places, limits = found
        weight = np.float32(COARSE_SHARE if layer.spacing_m > COARSE_M else 1.0)
        texels = weight, MOST_SAMPLES if is_polar(cell) else 1
        _sample(window, np.stack(places), limits, np.array(part), shares, texels, out)


def _nodes(
    cell: int, layer: Layer, part: tuple[int, int, int, int], texel_px: float
) -> Floats:
    """Return columns and rows in a picture, (2, n + 1, n + 1), over a rectangle."""
    _, south, _, north = edges_rad(cell)
    x0, x1, y0, y1 = part
    is_bent = layer.is_projected or is_polar(cell)
    for count in NODES:
        along = np.arange(count + 1) / (count * TEXTURE_SIDE)
        u, v = x0 / TEXTURE_SIDE + along * (x1 - x0), y0 / TEXTURE_SIDE + along * (y1 - y0)
        across, lat = np.meshgrid(u, south + v * (north - south))
        lon = lon_at(cell, across, lat)
        places = np.stack(layer.pixels(lon.ravel(), lat.ravel())).reshape(2, *lon.shape)
        if not is_bent or _bend(places) < GOOD_PX * max(texel_px, 1.0):
            break
    return places


def _bend(nodes: Floats) -> float:
    """Return how far nodes, (2, n, n), are from the lines between their neighbours."""
    across = nodes[:, 1:-1:2] - (nodes[:, :-2:2] + nodes[:, 2::2]) / 2
    along = nodes[:, :, 1:-1:2] - (nodes[:, :, :-2:2] + nodes[:, :, 2::2]) / 2
    with np.errstate(invalid="ignore"):
        return float(np.abs(across).max() + np.abs(along).max())


@kernel
def _sample(
    window: NDArray[np.uint8],
    nodes: Floats,
    limits: Floats,
    part: NDArray[np.int64],
    shares: Floats,
    texels: tuple[np.float32, int],
    out: NDArray[np.float32],
) -> None:
    """Interpolate a picture between those of its texels that are not transparent.

    Parameters
    ----------
    window : (h, w, 3) uint8; 0, 0, 0 is transparent
    nodes : (2, n + 1, n + 1) columns and rows in the window, over the rectangle
    limits : (4,) least and largest x, least and largest y that the picture covers
    part : (4,) x0, x1, y0, y1 of the rectangle
    shares : (m + 1, m + 1) of the picture that shows, over all of the cell
    texels : share of a colour that counts, it hides coarser ones all the same; and how
        many samples a texel has at most
    out : of `drape`
    """
    weight, most = texels
    spans, one, steps = nodes.shape[1] - 1, np.float32(1.0), len(shares) - 1
    du, dv = spans / (part[1] - part[0]), spans / (part[3] - part[2])
    for j in range(part[2], part[3]):
        v = (j + 0.5 - part[2]) * dv
        r = min(int(v), spans - 1)
        for i in range(part[0], part[1]):
            clear = out[j, i, CLEAR]
            if clear <= 0.0:
                continue
            u = (i + 0.5 - part[0]) * du
            c = min(int(u), spans - 1)
            x = _between(nodes[0], r, c, u - c, v - r)
            y = _between(nodes[1], r, c, u - c, v - r)
            if not (limits[0] < x < limits[1] and limits[2] < y < limits[3]):
                continue
            s, t = steps * (i + 0.5) / TEXTURE_SIDE, steps * (j + 0.5) / TEXTURE_SIDE
            clear *= np.float32(_between(shares, int(t), int(s), s - int(s), t - int(t)))
            wide, count = 0.0, 1
            if most > 1:
                wide = abs(_between(nodes[0], r, c, u - c + du, v - r) - x)
                count = min(max(int(wide), 1), most)
            red = green = blue = opaque = np.float32(0.0)
            share = one / np.float32(count)
            for k in range(count):
                at = x + wide * ((k + 0.5) / count - 0.5)
                texel = _texel(window, at, y)
                red += share * texel[0]
                green += share * texel[1]
                blue += share * texel[2]
                opaque += share * texel[3]
            out[j, i, 0] += clear * weight * red
            out[j, i, 1] += clear * weight * green
            out[j, i, 2] += clear * weight * blue
            out[j, i, SHARE] += clear * weight * opaque
            left = out[j, i, CLEAR] - clear * opaque
            out[j, i, CLEAR] = left if left > one - ALL else np.float32(0.0)


@inlined
def _texel(
    window: NDArray[np.uint8], x: float, y: float
) -> tuple[np.float32, np.float32, np.float32, np.float32]:
    """Return a colour times its share, and the share, between four texels."""
    height, width, one = window.shape[0], window.shape[1], np.float32(1.0)
    x, y = min(max(x, 0.0), width - 1.0), min(max(y, 0.0), height - 1.0)
    left, top = int(x), int(y)
    right, low = min(left + 1, width - 1), min(top + 1, height - 1)
    fx, fy = np.float32(x - left), np.float32(y - top)
    w00 = _weight(window, top, left, (one - fx) * (one - fy))
    w01 = _weight(window, top, right, fx * (one - fy))
    w10 = _weight(window, low, left, (one - fx) * fy)
    w11 = _weight(window, low, right, fx * fy)
    nw, ne = window[top, left], window[top, right]
    sw, se = window[low, left], window[low, right]
    return (
        w00 * nw[0] + w01 * ne[0] + w10 * sw[0] + w11 * se[0],
        w00 * nw[1] + w01 * ne[1] + w10 * sw[1] + w11 * se[1],
        w00 * nw[2] + w01 * ne[2] + w10 * sw[2] + w11 * se[2],
        w00 + w01 + w10 + w11,
    )


@inlined
def _between(nodes: Floats, r: int, c: int, fu: float, fv: float) -> float:
    """Interpolate between four nodes."""
    south = nodes[r, c] + fu * (nodes[r, c + 1] - nodes[r, c])
    north = nodes[r + 1, c] + fu * (nodes[r + 1, c + 1] - nodes[r + 1, c])
    return float(south + fv * (north - south))


@inlined
def _weight(
    window: NDArray[np.uint8], row: int, col: int, weight: np.float32
) -> np.float32:
    """Return a texel's weight, 0 where it is transparent."""
    return weight if window[row, col, 0] else np.float32(0.0)

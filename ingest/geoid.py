# SPDX-License-Identifier: Apache-2.0
"""The zero surface of a vertical datum at a raster's posts."""

from typing import Any

import numpy as np

from ingest.datum import undulation_m
from ingest.map_edge import known_places
from tiles.frames import Floats
from tiles.kernels import inlined, kernel
from tiles.placement import Placement

STRIDE_M = 2000.0
"""Between posts this far apart places are interpolated: then they are right to 0.1 m, and
heights to 0.01 mm."""
LONGEST_STRIDE = 64
SAMPLES = 65


class ZeroSurface:
    """Height of a source's zero above the ellipsoid, at its posts."""

    def __init__(self, planned: dict[str, Any]) -> None:
        """Take a source as it is planned: where the posts are, and `datum`."""
        self.datum = str(planned["datum"])
        self._place = Placement(planned)
        self._is_beyond = bool(planned.get("is_beyond"))
        self._shape = (int(planned["height"]), int(planned["width"]))
        stride = int(STRIDE_M / max(float(planned["spacing_m"]), 1e-3))
        self._stride = (
            min(max(stride, 1), LONGEST_STRIDE) if self._place.is_projected else 1
        )

    def at(self, top: int, left: int, rows: int, cols: int) -> Floats:
        """Return the heights at a window's posts, (rows, cols) m.

        NaN beyond the datum's grid, infinite beyond the edge of the raster's map.
        """
        if self.datum == "ellipsoid" and not self._is_beyond:
            return np.zeros((rows, cols))
        lon, lat = self._places(top, left, rows, cols)
        there = np.isfinite(lon)
        zero_m = undulation_m(self.datum, *(np.where(there, a, 0.0) for a in (lon, lat)))
        return np.where(there, zero_m, np.inf)

    def extent_m(self, datum: str) -> tuple[float, float]:
        """Return the least and the largest height of a datum's zero over the raster."""
        height, width = self._shape
        rows, cols = (np.linspace(0, n - 1, min(n, SAMPLES)) for n in (height, width))
        col, row = np.meshgrid(cols, rows)
        lon, lat = known_places(self._place, col.ravel(), row.ravel(), width)
        there = np.isfinite(lon)
        zero_m = undulation_m(datum, lon[there], lat[there])
        known = zero_m[np.isfinite(zero_m)]
        return (float(known.min()), float(known.max())) if len(known) else (0.0, 0.0)

    def _places(self, top: int, left: int, rows: int, cols: int) -> tuple[Floats, Floats]:
        step = self._stride
        # A row and column more than needed, so that every post lies between two.
        row = top + step * np.arange(-(-(rows - 1) // step) + 1.0 + (step > 1))
        col = left + step * np.arange(-(-(cols - 1) // step) + 1.0 + (step > 1))
        c, r = np.meshgrid(col, row)
        where = known_places if self._is_beyond else Placement.places
        lon, lat = (a.reshape(c.shape) for a in where(self._place, c.ravel(), r.ravel()))
        return (lon, lat) if step == 1 else _between(lon, lat, step, rows, cols)


@kernel
def _between(
    lon_rad: Floats, lat_rad: Floats, step: int, rows: int, cols: int
) -> tuple[Floats, Floats]:
    """Interpolate places between every `step`-th post, as vectors: also over a pole."""
    flat = np.cos(lat_rad)
    x, y, z = flat * np.cos(lon_rad), flat * np.sin(lon_rad), np.sin(lat_rad)
    lon, lat = np.empty((rows, cols)), np.empty((rows, cols))
    for i in range(rows):
        r, fy = i // step, (i % step) / step
        for c in range((cols + step - 1) // step):
            # The two edges of a square of known places, at this row.
            x0, x1 = _mix(x[r, c], x[r + 1, c], fy), _mix(x[r, c + 1], x[r + 1, c + 1], fy)
            y0, y1 = _mix(y[r, c], y[r + 1, c], fy), _mix(y[r, c + 1], y[r + 1, c + 1], fy)
            z0, z1 = _mix(z[r, c], z[r + 1, c], fy), _mix(z[r, c + 1], z[r + 1, c + 1], fy)
            for j in range(c * step, min((c + 1) * step, cols)):
                fx = (j - c * step) / step
                px, py = _mix(x0, x1, fx), _mix(y0, y1, fx)
                lon[i, j] = np.arctan2(py, px)
                lat[i, j] = np.arctan2(_mix(z0, z1, fx), np.sqrt(px * px + py * py))
    return lon, lat


@inlined
def _mix(one: float, other: float, share: float) -> float:
    return one + share * (other - one)

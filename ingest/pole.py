# SPDX-License-Identifier: Apache-2.0
"""A cell that reaches to a pole: one of its edges is a point, its tip.

All vertices on that edge are drawn in one place of the earth's axis: else there would be
gaps beside it, in the cell and between cells, where no skirt hangs.
"""

import numpy as np
from numpy.typing import NDArray

from ingest.boxes import edges_rad
from tiles import cells
from tiles.frames import Floats, Local
from tiles.mesh import STEPS, UV_ONE, quantise


def at_pole(cell: int) -> bool:
    """Say whether a cell reaches to a pole."""
    return max(abs(edge) for edge in edges_rad(cell)[1::2]) > cells.POLAR_RAD


def on_pole(cell: int, at: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Say which places of a cell, (n, 2) 0..UV_ONE, are a pole, (n,)."""
    edges = zip(edges_rad(cell)[1::2], (0, UV_ONE), strict=True)
    poles = [edge for lat, edge in edges if abs(lat) > cells.POLAR_RAD]
    return np.isin(at[:, 1], poles)


def tip_of(cell: int, at: NDArray[np.int64], points: Floats) -> Floats | None:
    """Return the one place of those of a cell's places that are a pole, (3,) ECEF m.

    Between columns of posts a source's surface passes a pole by up to half their distance
    in the row beside it.
    """
    poles = on_pole(cell, at)
    return np.array([0.0, 0.0, points[poles, 2].mean()]) if poles.any() else None


def with_extent(rows: NDArray[np.int64], poles: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return triangles or edges, (n, k) vertices, but for those two of which are a pole."""
    return np.asarray(rows[poles[rows].sum(axis=1) < 2])


def quantise_around(tip: Floats, local: Local) -> tuple[NDArray[np.int16], float, Floats]:
    """Round positions as `mesh.quantise` does, and a pole to its very place.

    Parameters
    ----------
    tip : (3,) of the pole, as `local`
    local : (n, 3) m around a mesh's centre

    Returns
    -------
    steps, scale_m : of `quantise`
    aside_m : (3,) how far the mesh's centre is moved, by at most half a step along an axis
    """
    scale_m = quantise(local)[1] * (1 + 1 / STEPS)  # so that there are steps enough
    aside_m = tip - np.rint(tip / scale_m) * scale_m
    return np.rint((local - aside_m) / scale_m).astype(np.int16), scale_m, aside_m

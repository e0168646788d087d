# SPDX-License-Identifier: Apache-2.0
"""Of the terrain tiles that are drawn: which of their meshes, and how deep their skirts."""

import numpy as np

from geopage.screen_error import Lens, blur_px
from geopage.tree import F4, F8, U1, Tree
from tiles.forest import Rows
from tiles.kernels import kernel

COARSEN = 0.8
"""What is drawn in detail gets coarser only below this share of the threshold."""


@kernel
def rungs(
    tree: Tree, lens: Lens, tau: float, drawn: Rows, scale: F8, before: U1
) -> tuple[U1, F4]:
    """Choose the coarsest mesh of each drawn tile whose screen error is small enough.

    A tile changes to a coarser one only below COARSEN times the threshold.

    Returns
    -------
    rung : (d,) 0 for the whole mesh
    error_m : (d,) of the mesh that is drawn
    """
    rung, error_m = np.zeros(len(drawn), np.uint8), tree.mesh_error_m[drawn]
    for i in range(len(drawn)):
        row, c = drawn[i], tree.centre[drawn[i]]
        limit = tau
        if lens.sweep.shutter_s > 0.0:
            limit = max(tau, blur_px(lens, c[0], c[1], c[2], tree.radius_m[row]))
        for k in range(tree.rung_m.shape[1]):
            is_coarser = before[row] > 1 and k + 1 > before[row] - 2
            most = limit * COARSEN if is_coarser else limit
            if tree.rung_m[row, k] * scale[i] <= most:
                rung[i], error_m[i] = k + 1, tree.rung_m[row, k]
    return rung, error_m


@kernel
def skirts(tree: Tree, drawn: Rows, error_m: F4) -> F4:
    """Return how deep each drawn tile's skirt must hang, (d,) m.

    A crack is at most as wide as the errors of the two tiles together. The link of a
    tile leads to the neighbour's cell or one above it; what is drawn there is at most
    as deep as the tile itself, so each pair is seen from its finer side, for both.
    """
    place = np.full(len(tree.parent), -1, np.int32)
    for i in range(len(drawn)):
        place[drawn[i]] = i
    beside = np.zeros(len(drawn), np.float32)
    for i in range(len(drawn)):
        row = drawn[i]
        for k in range(4):
            other = tree.links[row, k]
            while other >= 0 and place[other] < 0:
                other = tree.parent[other]
            if other >= 0:
                j = place[other]
                beside[i] = max(beside[i], error_m[j])
                beside[j] = max(beside[j], error_m[i])
    return beside + error_m

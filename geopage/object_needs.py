# SPDX-License-Identifier: Apache-2.0
"""Which object tiles the pictures of the next seconds miss."""

import numpy as np

from geopage.ground_needs import Needs
from geopage.object_selection import (
    cover_objects,
    emit_objects,
    needed_rows,
    want_objects,
)
from geopage.object_visit import visit
from geopage.outlook import Ahead
from geopage.screen_error import Lens
from geopage.tree import U1, Tree
from tiles.kernels import kernel


@kernel
def object_needs_of(
    tree: Tree,
    uploaded: U1,
    ahead: Ahead,
    lens: Lens,
    tau: float,
    object_tau: float,
) -> Needs:
    """Say what pictures ahead miss of having all their objects.

    Parameters
    ----------
    lens : the newest view's; the cone and the sweep are taken from it
    tau, object_tau : thresholds, px
    """
    count = len(ahead.ahead_s)
    start = np.zeros(count + 1, np.int32)
    rows, share = [np.int32(0) for _ in range(0)], [np.float32(0) for _ in range(0)]
    keep = [np.int32(0) for _ in range(0)]
    for k in range(count):
        soon = Lens(
            ahead.eye[k],
            -ahead.rotation[k, 2],
            lens.focal_px,
            lens.corner_cos,
            lens.cone_cos,
            lens.cone_sin,
            lens.occluder_m,
            lens.width_px,
            lens.height_px,
            lens.sweep,
        )
        plan = visit(tree, soon, tau, object_tau, uploaded)
        covered = cover_objects(tree, plan, uploaded)
        _, _, _, stand = emit_objects(tree, plan, uploaded, covered)
        missing, benefit, error_px = want_objects(
            tree, soon, plan, uploaded, covered, stand
        )
        for i in range(len(missing)):
            area_px = benefit[i] * tree.tile_bytes[missing[i]] / max(error_px[i], tau)
            rows.append(missing[i])
            share.append(np.float32(area_px / (lens.width_px * lens.height_px)))
        needed = needed_rows(plan)
        keep.extend(needed[uploaded[needed] > 0])
        start[k + 1] = len(rows)
    kept = np.unique(np.array(keep, np.int32))
    return Needs(start, np.array(rows, np.int32), np.array(share, np.float32), kept)

# SPDX-License-Identifier: Apache-2.0
"""Which object tiles the pictures of the next seconds miss."""

import numpy as np

from geopage.ground_needs import COARSER, Needs
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
    goals: int,
) -> Needs:
    """Say what pictures ahead miss of having all their objects.

    Parameters
    ----------
    lens : the newest view's; the cone and the sweep are taken from it
    tau, object_tau : thresholds, px
    goals : for each view, the first for the thresholds, each next one `COARSER` times as
        coarse

    Returns
    -------
    Needs of k * goals goals, those of one view together
    """
    count = len(ahead.ahead_s)
    start = np.zeros(count * goals + 1, np.int32)
    rows, share = [np.int32(0) for _ in range(0)], [np.float32(0) for _ in range(0)]
    keep = [np.int32(0) for _ in range(0)]
    for k in range(count):
        soon = Lens(
            ahead.eye[k],
            -ahead.rotation[k, 2],
            ahead.rotation[k],
            lens.focal_px,
            lens.corner_cos,
            lens.cone_cos,
            lens.cone_sin,
            lens.occluder_m,
            lens.width_px,
            lens.height_px,
            lens.sweep,
        )
        coarse = 1.0
        for goal in range(goals):
            at = k * goals + goal
            if not goal or start[at] > start[at - 1]:  # else nothing is missing here, too
                plan = visit(tree, soon, coarse * tau, coarse * object_tau, uploaded)
                covered = cover_objects(tree, plan, uploaded)
                _, _, _, stand = emit_objects(tree, plan, uploaded, covered)
                missing, benefit, error_px = want_objects(
                    tree, soon, plan, uploaded, covered, stand
                )
                for i in range(len(missing)):
                    if benefit[i] == 0.0:  # finer ones are drawn
                        continue
                    area_px = benefit[i] * tree.tile_bytes[missing[i]]
                    area_px /= max(error_px[i], tau)
                    rows.append(missing[i])
                    share.append(np.float32(area_px / (lens.width_px * lens.height_px)))
                needed = needed_rows(plan)
                keep.extend(needed[uploaded[needed] > 0])
            start[at + 1] = len(rows)
            coarse *= COARSER
    kept = np.unique(np.array(keep, np.int32))
    return Needs(start, np.array(rows, np.int32), np.array(share, np.float32), kept)

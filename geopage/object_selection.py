# SPDX-License-Identifier: Apache-2.0
"""What objects one view draws and wants: four named passes over arrays.

visit walks down to every cell that has something large enough on the screen, and says
for each child whether to go on to it or to draw its proxy. cover walks back up and says
where the uploaded tiles suffice. emit takes a child where it is covered and its proxy
where it is not: never both, and never neither while one of them can be drawn. want
lists the tiles that are missing.

Cells without a tile are passed through. A *held* cell is a finer tile from before, kept
while the tile with its proxy is on its way.
"""

import math
from typing import NamedTuple

import numpy as np

from geopage.object_visit import ObjectPlan, made_of, visit_again
from geopage.screen_error import Lens
from geopage.tree import F8, U1, Tree
from tiles.forest import Rows
from tiles.kernels import kernel

JUMP_LEVELS = 3
NOTHING = 0


class Objects(NamedTuple):
    """What the passes come to."""

    drawn: Rows
    """(d,) rows"""
    own: U1
    """(d,) 1 where own objects are drawn"""
    proxies: U1
    """(d,) bit k: the proxy of child k is drawn"""
    needed: Rows
    """rows whose tiles are drawn when all is there"""
    above: Rows
    """rows whose uploaded tiles can stand in for those"""
    wanted: Rows
    """(w,) rows, each once"""
    benefit: F8
    error_px: F8
    made: U1
    """(n,) bits: `before` of the next selection"""


@kernel
def select_objects(
    tree: Tree, lens: Lens, tau: float, object_tau: float, uploaded: U1, before: U1
) -> Objects:
    """Run the passes, in one call without the GIL; see each for its parameters."""
    plan = visit_again(tree, lens, tau, object_tau, uploaded, before)
    covered = cover_objects(tree, plan, uploaded)
    taken, own, proxies, stand = emit_objects(tree, plan, uploaded, covered)
    rows, benefit, error_px = want_objects(tree, lens, plan, uploaded, covered, stand)
    return Objects(
        plan.rows[taken],
        own,
        proxies,
        needed_rows(plan),
        plan.rows[uploaded[plan.rows] > 0],
        rows,
        benefit,
        error_px,
        made_of(len(tree.parent), plan),
    )


@kernel
def needed_rows(plan: ObjectPlan) -> Rows:
    """Return the rows that a plan draws something of when all is there."""
    rows: Rows = plan.rows[((plan.own | plan.proxies) > 0) & (plan.held == 0)]
    return rows


@kernel
def cover_objects(tree: Tree, plan: ObjectPlan, uploaded: U1) -> U1:
    """Say, (m,), where the uploaded tiles draw all that the plan asks of a cell."""
    covered = np.zeros(len(plan.rows), np.uint8)
    for i in range(len(plan.rows) - 1, -1, -1):
        here = uploaded[plan.rows[i]]
        enough = here or not plan.own[i]
        for k in range(4):
            bit, child = np.uint8(1 << k), plan.below[i, k]
            below = child >= 0 and covered[child]
            if plan.go_on[i] & bit:
                enough = enough and (below or (here and tree.proxies[plan.rows[i]] & bit))
            elif plan.proxies[i] & bit:
                enough = enough and (here or below)
        covered[i] = enough
    return covered


@kernel
def emit_objects(
    tree: Tree, plan: ObjectPlan, uploaded: U1, covered: U1
) -> tuple[Rows, U1, U1, Rows]:
    """Take children where they are covered and their proxies where they are not.

    Returns
    -------
    taken : (d,) places in the plan that draw something
    own : (d,) 1 where own objects are drawn
    proxies : (d,) bit k: the proxy of child k is drawn
    stand : (m,) place whose tile draws a proxy for the cell, -1 where none does
    """
    m = len(plan.rows)
    taken, stand = np.empty(m, np.int32), np.full(m, -1, np.int32)
    own, proxies = np.empty(m, np.uint8), np.empty(m, np.uint8)
    count = 0
    for i in range(m):
        here = uploaded[plan.rows[i]]
        bits = proxies_instead(tree, plan, i, covered) if here and stand[i] < 0 else NOTHING
        for k in range(4):
            child = plan.below[i, k]
            if child >= 0:
                stand[child] = i if bits >> k & 1 else stand[i]
        if stand[i] < 0 and here and (plan.own[i] or bits):
            taken[count], own[count], proxies[count] = i, plan.own[i], bits
            count += 1
    return taken[:count].copy(), own[:count].copy(), proxies[:count].copy(), stand


@kernel
def proxies_instead(tree: Tree, plan: ObjectPlan, i: int, covered: U1) -> int:
    """Return bit k for each child that its proxy in an uploaded tile is drawn for."""
    bits = np.int64(plan.proxies[i])
    for k in range(4):
        if plan.go_on[i] >> k & 1 and not covered[plan.below[i, k]]:
            bits |= 1 << k
    return int(bits & np.int64(tree.proxies[plan.rows[i]]))


@kernel
def want_objects(
    tree: Tree, lens: Lens, plan: ObjectPlan, uploaded: U1, covered: U1, stand: Rows
) -> tuple[Rows, F8, F8]:
    """List the tiles that are missing, and what each would gain.

    Returns
    -------
    rows : (w,) int32
    benefit : (w,) px of screen error, times px of area, removed for each byte read; 0
        where finer tiles are drawn until this one comes
    error_px : (w,) screen error of what is drawn there now
    """
    m = len(plan.rows)
    rows, gap = np.empty(m, np.int32), np.zeros(m, np.int32)
    benefit, error_px = np.empty(m, np.float64), np.empty(m, np.float64)
    count = 0
    for i in range(m):
        row, parent = plan.rows[i], plan.above[i]
        gap[i] = JUMP_LEVELS if parent < 0 else gap[parent] + 1
        if uploaded[row] or not tree.has_tile[row] or plan.held[i]:
            gap[i] = 0 if uploaded[row] else gap[i]
            continue
        between = not covered[i] and tree.proxies[row] and gap[i] >= JUMP_LEVELS
        if not (plan.own[i] or plan.proxies[i] or between):
            continue
        gap[i] = 0
        now_m = max(tree.subtree_m[row], tree.proxy_m[row])
        now_px = now_m * plan.scale[i]
        if stand[i] >= 0:
            now_px = tree.error_m[plan.rows[stand[i]]] * plan.scale[stand[i]]
        elif covered[i]:
            now_px = 0.0
        left_px = tree.error_m[row] * plan.scale[i] if tree.proxies[row] else 0.0
        rows[count] = row
        error_px[count] = min(now_px, lens.width_px + lens.height_px)
        reach_px = tree.radius_m[row] * plan.scale[i]
        area_px = min(math.pi * reach_px * reach_px, lens.width_px * lens.height_px)
        removed_px = max(error_px[count] - left_px, 0.0)
        benefit[count] = removed_px * area_px / max(tree.tile_bytes[row], 1)
        count += 1
    return rows[:count].copy(), benefit[:count].copy(), error_px[:count].copy()

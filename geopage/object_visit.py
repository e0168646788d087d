# SPDX-License-Identifier: Apache-2.0
"""The first pass over objects: down to every cell with something large enough to see.

A *held* cell is a finer tile from before, kept while the tile with its proxy is on its
way. What the last selection drew goes a little later than it came (hysteresis).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geopage.screen_error import Lens, blur_px, px_per_m
from geopage.tree import F8, U1, Tree
from tiles.forest import Rows
from tiles.kernels import inlined, kernel

STAY = 0.95
"""What was drawn goes only below this share of its threshold."""
OWN, SHOWN, SEEN = np.uint8(16), np.uint8(32), np.uint8(64)
"""Bits of what the last selection made of a cell, beside bit k: it went on to child k."""


class ObjectPlan(NamedTuple):
    """The cells that visit found, parents before children."""

    rows: Rows
    scale: F8
    """pixels per metre in the cell's sphere"""
    above: Rows
    """place of the parent in this plan, -1 for roots"""
    below: NDArray[np.int32]
    """(m, 4) place of each child in this plan, -1 where it is not in it"""
    own: U1
    """own objects are large enough"""
    go_on: U1
    """bit k: child k is to be drawn rather than its proxy"""
    proxies: U1
    """bit k: the proxy of child k is to be drawn"""
    held: U1


@kernel
def visit(
    tree: Tree, lens: Lens, tau: float, object_tau: float, uploaded: U1
) -> ObjectPlan:
    """Walk down as for a first picture."""
    nothing = np.zeros(len(tree.parent), np.uint8)
    return visit_again(tree, lens, tau, object_tau, uploaded, nothing)


@kernel
def visit_again(
    tree: Tree, lens: Lens, tau: float, object_tau: float, uploaded: U1, before: U1
) -> ObjectPlan:
    """Walk down to everything that is larger than its threshold.

    Parameters
    ----------
    tree, lens : the objects and the view
    tau : largest screen error of proxies, and their smallest size, px; where all moves
        faster, `blur_px` instead
    object_tau : smallest bounding dimension of objects, px; likewise
    uploaded : (n,) 1 where the tile can be drawn
    before : (n,) bits of the last selection; what it drew stays by hysteresis
    """
    n = len(tree.parent)  # often many times more than are visited: nothing is cleared
    rows, above = np.empty(n, np.int32), np.empty(n, np.int32)
    below, scale = np.empty((n, 4), np.int32), np.empty(n, np.float64)
    own, go_on = np.empty(n, np.uint8), np.empty(n, np.uint8)
    proxies, held = np.empty(n, np.uint8), np.empty(n, np.uint8)
    blur = np.empty(n, np.float64)
    # Handing a whole tree to a function costs more than such a function does.
    centre, radius_m = tree.centre, tree.radius_m
    subtree_m, proxy_m = tree.subtree_m, tree.proxy_m
    count, i = 0, 0
    for root in tree.roots:
        scale[count], blur[count] = looks(lens, centre[root], radius_m[root])
        more = scale[count] / (STAY if before[root] & SEEN else 1.0)
        if is_seen(subtree_m[root], proxy_m[root], more, blur[count], tau, object_tau):
            rows[count], above[count], held[count] = root, -1, 0
            count += 1
    while i < count:
        row = rows[i]
        below[i], go_on[i], proxies[i] = -1, 0, 0
        was, least = before[row], max(tau, blur[i])
        own_px = tree.own_m[row] * scale[i] / (STAY if was & OWN else 1.0)
        own[i] = tree.has_tile[row] and (held[i] or own_px > max(object_tau, blur[i]))
        proxy_px = proxy_m[row] * scale[i] / (STAY if was & SHOWN else 1.0)
        shown = proxy_px > least or held[i]
        for k in range(4):
            child, proxy = tree.children[row, k], tree.proxies[row] >> k & 1
            if child < 0:
                continue
            scale[count], blur[count] = looks(lens, centre[child], radius_m[child])
            more = scale[count] / (STAY if before[child] & SEEN else 1.0)
            seen = is_seen(
                subtree_m[child], proxy_m[child], more, blur[count], tau, object_tau
            )
            enough_px = least * (STAY if was >> k & 1 else 1.0)
            rough = tree.error_m[row] * scale[i] > enough_px
            better = seen and (rough or not proxy) and not held[i]
            go_on[i] |= better << k
            proxies[i] |= (not better and proxy and shown) << k
            held[count] = proxies[i] >> k & 1 and uploaded[child] and not uploaded[row]
            if better or held[count]:
                rows[count], above[count], below[i, k] = child, i, count
                count += 1
        i += 1
    return ObjectPlan(
        rows[:count].copy(),
        scale[:count].copy(),
        above[:count].copy(),
        below[:count].copy(),
        own[:count].copy(),
        go_on[:count].copy(),
        proxies[:count].copy(),
        held[:count].copy(),
    )


@inlined
def looks(lens: Lens, centre: NDArray[np.float64], radius_m: float) -> tuple[float, float]:
    """Return pixels per metre in a sphere, and how far it moves on the screen, px."""
    x, y, z = centre[0], centre[1], centre[2]
    moves = lens.sweep.shutter_s > 0.0
    blur = blur_px(lens, x, y, z, radius_m) if moves else 0.0
    return px_per_m(lens, x, y, z, radius_m), blur


@inlined
def is_seen(
    subtree_m: float,
    proxy_m: float,
    scale: float,
    blur: float,
    tau: float,
    object_tau: float,
) -> bool:
    """Say whether any object, or any proxy, at or below a cell is large enough."""
    objects = subtree_m * scale > max(object_tau, blur)
    return bool(objects or proxy_m * scale > max(tau, blur))


@kernel
def made_of(n: int, plan: ObjectPlan) -> U1:
    """Return what a plan makes of each cell, as bits, (n,)."""
    made = np.zeros(n, np.uint8)
    for i in range(len(plan.rows)):
        if not plan.held[i]:
            own, shown = OWN * plan.own[i], SHOWN * (plan.proxies[i] > 0)
            made[plan.rows[i]] = plan.go_on[i] | own | shown | SEEN
    return made

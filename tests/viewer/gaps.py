# SPDX-License-Identifier: Apache-2.0
"""Light under walls, pixel by pixel: rays that pass below a wall's foot and go on.

From the lower edge of every wall that is drawn hangs a curtain, in float64, straight
down. Where walls go into the ground the curtain is under the ground, and no ray to
something drawn passes it. Each pixel whose ray does is one where a wall floats.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from geopage.draw_list import DrawList
from geopage.view import ViewState
from tiles import geodesy, objects
from tiles.frames import Ecef, Floats
from tiles.kernels import kernel
from tiles.lanes import Lane
from tiles.mesh import WALL
from tiles.objects import ObjectTile
from viewer.camera import pixel_rays
from viewer.session import Session

NEAR_PX = 6
"""Pixels this near to a building's are looked at."""
CLEAR_M, CLEAR_SHARE = 0.05, 2e-5
"""A ray must be this far below the foot, and go on as far; positions are float32."""
DEEP_M = 3000.0


def light_under_walls(
    session: Session, drawn: DrawList, view: ViewState
) -> NDArray[np.bool_]:
    """Return the pixels, (h, w), of the last frame in which light passes under a wall."""
    ids = session.renderer.read_ids()
    points = session.renderer.read_positions()
    feet = [feet_of(*tile) for tile in tiles_seen(session, drawn, ids)]
    near = beside(ids < 0) & (ids >= 0)
    found = np.zeros(ids.shape, np.bool_)
    if feet and near.any():
        away_m = np.linalg.norm(points[near] - view.eye, axis=-1)
        away_m = np.where(np.isnan(away_m), np.inf, away_m)
        edges = np.concatenate(feet) - view.eye
        found[near] = passes(pixel_rays(view)[near], away_m, edges, view.eye)
    return found


def beside(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Grow a mask by NEAR_PX to all sides."""
    for axis in range(2):
        grown = mask.copy()
        for step in range(1, NEAR_PX + 1):
            ahead = [slice(None)] * 2
            back = [slice(None)] * 2
            ahead[axis], back[axis] = slice(step, None), slice(None, -step)
            grown[tuple(ahead)] |= mask[tuple(back)]
            grown[tuple(back)] |= mask[tuple(ahead)]
        mask = grown
    return mask


def tiles_seen(
    session: Session, drawn: DrawList, ids: NDArray[np.int32]
) -> Iterator[tuple[ObjectTile, NDArray[np.int64], int]]:
    """Yield tiles of which something is seen, which ordinals, and which proxies."""
    code = -1 - np.unique(ids[ids < 0].astype(np.int64))
    for entry in np.unique(code // 65536).tolist():
        record = session.pager.forests[Lane.OBJECTS].records[drawn.objects[entry]]
        key = int(record["cell"]), int(record["row"]), int(record["check"])
        tile = objects.decode(session.store.checked_body(Lane.OBJECTS, *key))
        yield tile, code[code // 65536 == entry] % 65536, int(drawn.proxies[entry])


def feet_of(tile: ObjectTile, ordinals: NDArray[np.int64], proxies: int) -> Floats:
    """Return the lower edges of walls that are drawn, (e, 2, 3) ECEF m."""
    triangles = tile.mesh.indices.reshape(-1, 3)
    vertices = tile.mesh.vertices
    seen = np.isin(vertices["detail"][triangles[:, 0], 1], ordinals)
    for proxy in tile.proxies:
        if not proxies >> int(proxy["child"]) & 1:
            seen[proxy["index_start"] // 3 : proxy["index_end"] // 3] = False
    # Walls begin at the ground or below it.
    above = vertices["detail"][:, 0].astype(np.int16)[triangles]
    foot = (vertices["flags"][triangles] == WALL) & (above <= 0)
    walls = seen & (foot.sum(axis=1) == 2)
    ends = triangles[walls][foot[walls]].reshape(-1, 2)
    return np.asarray(tile.mesh.local[ends] + tile.mesh.centre)


def passes(rays: Floats, away_m: Floats, edges: Floats, eye: Ecef) -> NDArray[np.bool_]:
    """Say which rays, (n, 3), pass below an edge, (e, 2, 3) from the eye, and go on."""
    start = np.ascontiguousarray(edges[:, 0])
    lon, lat, _ = geodesy.to_geodetic(Ecef(start + eye))
    down, run = -geodesy.up(lon, lat), edges[:, 1] - start
    normal = np.cross(run, down)
    # Where a ray meets the curtain's plane: how far along the edge, how far below it.
    square = (normal**2).sum(axis=1, keepdims=True)
    aside, under = np.cross(down, normal) / square, np.cross(normal, run) / square
    found = np.zeros(len(rays), np.bool_)
    _pass(rays, away_m, start, normal, aside, under, found)
    return found


@kernel
def _pass(
    rays: Floats,
    away_m: Floats,
    start: Floats,
    normal: Floats,
    aside: Floats,
    under: Floats,
    found: NDArray[np.bool_],
) -> None:
    for n in range(len(rays)):
        x, y, z = rays[n]
        for e in range(len(start)):
            a, m = start[e], normal[e]
            slope = x * m[0] + y * m[1] + z * m[2]
            if slope == 0.0:
                continue
            along = (a[0] * m[0] + a[1] * m[1] + a[2] * m[2]) / slope
            clear_m = CLEAR_M + CLEAR_SHARE * along
            if along <= 0.0 or along + clear_m >= away_m[n]:
                continue
            px, py, pz = along * x - a[0], along * y - a[1], along * z - a[2]
            share = px * aside[e, 0] + py * aside[e, 1] + pz * aside[e, 2]
            below = px * under[e, 0] + py * under[e, 1] + pz * under[e, 2]
            if 0.0 <= share <= 1.0 and clear_m < below < DEEP_M:
                found[n] = True
                break

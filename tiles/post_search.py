# SPDX-License-Identifier: Apache-2.0
"""The finest source surface: which source owns a place, and where rays meet it.

Where sources overlap, the finest that has data wins; what others say there is not part
of the surface, and rays pass through it. Around a finer source, up to its reach, the
coarser surface is bent to meet it: nobody measured it there, and nobody owns it.
"""

import math

from tiles.frames import Floats, Ints
from tiles.kernels import kernel
from tiles.points import Point, along, height_and_up
from tiles.post_distance import nearest
from tiles.post_rays import ACROSS_M, cast, plumb
from tiles.post_tree import PostTree
from tiles.post_walk import Rooms, new_rooms

AGAIN = 64
"""A ray passes through the surface of a source that is covered at most so often."""
STEP_M = 1e-3
"""From a covered hit to where the search begins again."""
NOWHERE, BENT = -1, -2
"""No source has posts there; a finer source nearby bends the surface there."""


@kernel
def owner_of(tree: PostTree, point: Point, sources: int, rooms: Rooms) -> tuple[int, float]:
    """Return the finest of the first sources with data at a place, and how far above."""
    for source in range(sources):
        above = plumb(tree, source, point, rooms)
        if above < math.inf:
            return source, above
    return NOWHERE, math.inf


@kernel
def is_bent(tree: PostTree, owner: int, point: Point, rooms: Rooms) -> bool:
    """Say whether a source finer than the owner may bend the surface at a point."""
    for source in range(owner):
        reach_m = tree.rasters.reach_m[source] * 1.02
        if _beside(tree, source, point, reach_m, rooms):
            return True
    return False


@kernel
def _beside(
    tree: PostTree, source: int, point: Point, reach_m: float, rooms: Rooms
) -> bool:
    """Say whether a source has posts within a distance of a point, heights apart."""
    seen = point
    for _ in range(2):
        away, to = nearest(tree, source, seen, reach_m + ACROSS_M, 0.0, rooms)
        if away >= reach_m + ACROSS_M:
            return False
        # Go to the height of the nearest post, so that only the way there counts.
        height_m, up = height_and_up(along(seen, to, 1.0))
        own_m, _ = height_and_up(seen)
        seen = along(seen, up, height_m - own_m)
    away, _ = nearest(tree, source, seen, reach_m + 1.0, reach_m, rooms)
    return away <= reach_m


@kernel
def first_hits(
    tree: PostTree, eye: Point, ways: Floats, ends: Floats, owner: Ints, out: Floats
) -> None:
    """Cast rays against the finest surface.

    Parameters
    ----------
    ways : (n, 3) unit vectors, ECEF axes
    ends : (n,) m, where each ray ends; inf never
    owner : (n,) written: the source that is met, or NOWHERE
    out : (n,) written: distance in m, inf where nothing is met
    """
    rooms = new_rooms()
    for i in range(len(ways)):
        way = (ways[i, 0], ways[i, 1], ways[i, 2])
        best, owner[i] = math.inf, NOWHERE
        for source in range(len(tree.top)):
            low = 0.0
            for _ in range(AGAIN):
                t = cast(tree, source, eye, way, low, min(best, ends[i]), rooms)
                if t == math.inf:
                    break
                covering, _ = owner_of(tree, along(eye, way, t), source, rooms)
                if covering == NOWHERE:
                    best, owner[i] = t, source
                    break
                low = t + STEP_M
        out[i] = best


@kernel
def drop_bent(tree: PostTree, points: Floats, owner: Ints) -> None:
    """Write BENT as the owner, (n,), of points that a finer source may have bent."""
    rooms = new_rooms()
    for i in range(len(points)):
        point = (points[i, 0], points[i, 1], points[i, 2])
        if owner[i] > 0 and is_bent(tree, owner[i], point, rooms):
            owner[i] = BENT


@kernel
def owners(tree: PostTree, points: Floats, owner: Ints, above_m: Floats) -> None:
    """Find out whose posts are below each point, (n, 3) ECEF m.

    Parameters
    ----------
    owner : (n,) written: the source, NOWHERE or BENT
    above_m : (n,) written: how far above the point its surface is, inf without an owner
    """
    rooms = new_rooms()
    for i in range(len(points)):
        point = (points[i, 0], points[i, 1], points[i, 2])
        owner[i], above_m[i] = owner_of(tree, point, len(tree.top), rooms)
    drop_bent(tree, points, owner)

# SPDX-License-Identifier: Apache-2.0
"""Between a roof and a box: buildings of city models as prisms with flat roofs.

A city model is simplified with its distance in three steps: bodies with their roofs;
the same buildings as prisms, their outlines simplified and raised to half-way from eaves
to ridge; boxes. Prisms stand for a cell that has no proxies below it, where they are
nearer to the bodies than boxes and have clearly fewer triangles than the bodies. A body
stays as it is where its prism would be farther off, or where its mesh does not cover its
footprint once.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from ingest.extrude import CORNER_VERTICES, Prisms
from ingest.footprints import Geometries
from ingest.object_cut import Cut
from ingest.object_levels import MAX_VERTICES
from ingest.proxy_error import to_polygon
from ingest.proxy_solids import Solids
from ingest.repair import metres_per_degree
from ingest.shapes import Shapes
from tiles.frames import Floats, Ints
from tiles.kernels import kernel

NEARER = 0.9
"""Share of the boxes' error that prisms are off at most."""
FEWER = 0.75
"""Share of the bodies' triangles that prisms have at most."""
SIMPLER = 0.5
"""How far outlines are simplified, as a share of what a flat roof is off."""
_FACES_UP = 0.2
_COVER, _COVER_M2 = 0.02, 0.5


class Roofs(NamedTuple):
    """What sets the bodies of n buildings apart from prisms; zeros for prisms."""

    overhang_m: Floats
    """(n,) how far the farthest vertex is outside the footprint"""
    low_m: Floats
    """(n,) lowest point of what looks up, above the ellipsoid"""
    up_m2: Floats
    """(n,) area of what looks up, as seen from above"""


class Ladder(NamedTuple):
    """What proxies are made of: the shapes of each, and its error."""

    shapes: Shapes
    start: Ints
    """(g + 1,) where each proxy's shapes begin"""
    error_m: Floats
    """(g,)"""


def roofs_of(shapes: Shapes, prisms: Prisms, solids: Solids) -> Roofs:
    """Look at the bodies among some shapes; `prisms` are their meshes."""
    owner = np.flatnonzero([one is not None for one in shapes.solid])
    count = len(shapes.solid)
    found = Roofs(np.zeros(count), np.zeros(count), np.zeros(count))
    if len(owner):
        scale = np.column_stack(metres_per_degree(solids.centre_deg[:, 1]))
        place = np.degrees(np.column_stack((prisms.lon_rad, prisms.lat_rad)))
        place = np.column_stack((place, prisms.height_m))
        starts = prisms.vertex_start, prisms.triangle_start
        _look(owner, solids, scale, place, prisms.triangles, starts, found)
    return found


@kernel
def _look(
    owner: Ints,
    solids: Solids,
    scale: Floats,
    place: Floats,
    triangles: Ints,
    starts: tuple[Ints, Ints],
    roofs: Roofs,
) -> None:
    for i in owner:
        x, y = solids.centre_deg[i]
        per_lon, per_lat = scale[i]
        first, last = solids.start[i], solids.start[i + 1]
        edge = np.empty((last - first, 4))
        for e in range(last - first):
            for k in range(0, 4, 2):
                edge[e, k] = (solids.edge_deg[first + e, k] - x) * per_lon
                edge[e, k + 1] = (solids.edge_deg[first + e, k + 1] - y) * per_lat
        low = starts[0][i]
        point = place[low : starts[0][i + 1]].copy()
        far = 0.0
        for v in range(len(point)):
            point[v, 0] = (point[v, 0] - x) * per_lon
            point[v, 1] = (point[v, 1] - y) * per_lat
            far = max(far, to_polygon(edge, point[v, 0], point[v, 1])[0])
        lowest, area = np.inf, 0.0
        for t in range(starts[1][i], starts[1][i + 1]):
            a, b, c = triangles[t] - low
            ab, ac = point[b] - point[a], point[c] - point[a]
            up = ab[0] * ac[1] - ab[1] * ac[0]
            across = (ab[1] * ac[2] - ab[2] * ac[1], ab[2] * ac[0] - ab[0] * ac[2])
            area += max(up, 0.0) / 2
            if up > _FACES_UP * np.hypot(np.hypot(across[0], across[1]), up):
                lowest = min(lowest, point[a, 2], point[b, 2], point[c, 2])
        roofs.overhang_m[i] = np.sqrt(far)
        roofs.low_m[i] = lowest if lowest < np.inf else point[:, 2].min()
        roofs.up_m2[i] = area


def worst_overhangs_m(roofs: Roofs, first: Ints, last: Ints) -> Floats:
    """Return the largest overhang in each group of buildings, none of them empty, (g,).

    Boxes are measured against footprints: bodies are so much farther off at most.
    """
    if not roofs.overhang_m.any():
        return np.zeros(len(first))
    worst = [roofs.overhang_m[a:b].max() for a, b in zip(first, last, strict=True)]
    return np.array(worst, np.float64)


def flat_roofs(shapes: Shapes, solids: Solids, roofs: Roofs) -> tuple[Shapes, Floats]:
    """Return a prism for each building, and how far off it is.

    Its roof is half-way from the lowest roof to the highest point, its outline is
    simplified by half as much as the roof is off, or by 0.5 m where that is more.

    Returns
    -------
    shapes : (n,) prisms
    error_m : (n,) Hausdorff distance at most, as that of boxes; infinite where a body
        does not cover its footprint, or covers it twice
    """
    has_solid = _has_solid(shapes)
    low_m = np.where(has_solid, roofs.low_m, solids.top_m)
    top_m = (low_m + solids.top_m) / 2
    off_m = solids.top_m - top_m
    tolerance_m = SIMPLER * np.maximum(off_m, 1.0)
    high_m = np.maximum(solids.top_m - solids.ground_m, 0.0)
    miss_m = np.hypot(off_m, roofs.overhang_m + tolerance_m)
    # Walls below a raised building go on to the ground.
    gap_m = np.maximum(solids.foot_m - solids.ground_m, 0.0) / 2
    error_m = np.maximum(np.minimum(miss_m, high_m), gap_m)
    polygon = _simplified(shapes.polygon, solids.centre_deg, tolerance_m)
    none = np.full(len(top_m), None, object)
    plain = Shapes(polygon, shapes.foot_m, shapes.ground_m, top_m, none, shapes.lean)
    return plain, np.where(has_solid & ~_covers(solids, roofs), np.inf, error_m)


def _has_solid(shapes: Shapes) -> NDArray[np.bool_]:
    return np.array([one is not None for one in shapes.solid], bool)


def _covers(solids: Solids, roofs: Roofs) -> NDArray[np.bool_]:
    """Tell which bodies have as much roof as they cover ground, overhangs included."""
    rim_m2 = roofs.overhang_m * (_perimeters_m(solids) + 4 * roofs.overhang_m)
    low_m2 = (1 - _COVER) * solids.area_m2 - _COVER_M2
    high_m2 = (1 + _COVER) * (solids.area_m2 + rim_m2) + _COVER_M2
    return (roofs.up_m2 >= low_m2) & (roofs.up_m2 <= high_m2)


def _perimeters_m(solids: Solids) -> Floats:
    scale = np.column_stack(metres_per_degree(solids.centre_deg[:, 1]))
    way = solids.edge_deg[:, 2:] - solids.edge_deg[:, :2]
    owner = np.repeat(np.arange(len(scale)), np.diff(solids.start))
    length_m = np.linalg.norm(way * scale[owner], axis=1)
    return np.asarray(np.bincount(owner, length_m, len(scale)), np.float64)


def _simplified(polygon: Geometries, centre_deg: Floats, tolerance_m: Floats) -> Geometries:
    """Leave corners out that are no farther than that from the new outline."""
    scale = np.column_stack(metres_per_degree(centre_deg[:, 1]))
    place, owner = shapely.get_coordinates(polygon, return_index=True)
    place = (place - centre_deg[owner]) * scale[owner]
    flat = shapely.set_coordinates(polygon.copy(), place)
    flat = shapely.orient_polygons(shapely.simplify(flat, tolerance_m))
    place, owner = shapely.get_coordinates(flat, return_index=True)
    place = place / scale[owner] + centre_deg[owner]
    return np.asarray(shapely.set_coordinates(flat, place), object)


def with_flat_roofs(
    cut: Cut, shapes: Shapes, prisms: Prisms, roofs: Roofs, solids: Solids, boxes: Ladder
) -> Ladder:
    """Let prisms stand for bodies of city models where they are better than boxes.

    Parameters
    ----------
    shapes, prisms, roofs, solids : the buildings
    boxes : what stands for the cells `cut.held`
    """
    has_solid = _has_solid(shapes)
    lowest = _lowest(cut)
    if not has_solid.any() or not len(lowest):
        return boxes
    first, last = cut.tree.first[cut.held], cut.tree.last[cut.held]
    group = np.full(len(has_solid), -1)
    for k in lowest.tolist():
        group[first[k] : last[k]] = k
    flat, miss_m = flat_roofs(shapes, solids, roofs)
    is_flat = (group >= 0) & (miss_m <= NEARER * boxes.error_m[group])
    better = _better(cut, group, is_flat, flat, prisms)
    better[np.setdiff1d(np.arange(len(first)), group[is_flat & has_solid])] = False
    mixed = _mixed(shapes, flat, is_flat)
    spans = zip(first, last, boxes.start[:-1], boxes.start[1:], better, strict=True)
    parts = [
        mixed.take(slice(a, b)) if fine else boxes.shapes.take(slice(c, d))
        for a, b, c, d, fine in spans
    ]
    worst_m = np.zeros(len(first))
    np.maximum.at(worst_m, group[is_flat], miss_m[is_flat])
    return Ladder(
        Shapes.joined(parts),
        np.cumsum([0, *(len(one.foot_m) for one in parts)]),
        np.where(better, worst_m, boxes.error_m),
    )


def _mixed(shapes: Shapes, flat: Shapes, is_flat: NDArray[np.bool_]) -> Shapes:
    """Return prisms for some buildings, the others as they are."""
    solid = shapes.solid.copy()
    solid[is_flat] = None
    return replace(
        shapes,
        polygon=np.where(is_flat, flat.polygon, shapes.polygon),
        top_m=np.where(is_flat, flat.top_m, shapes.top_m),
        solid=solid,
    )


def _better(
    cut: Cut, group: Ints, is_flat: NDArray[np.bool_], flat: Shapes, prisms: Prisms
) -> NDArray[np.bool_]:
    """Tell which groups have few triangles, and a tile with room for their vertices."""
    real_v, real_t = np.diff(prisms.vertex_start), np.diff(prisms.triangle_start)
    corners = shapely.get_num_coordinates(flat.polygon)
    # Rings are closed, and a roof has two triangles less than corners.
    prism_t = 3 * corners - 5 * shapely.get_num_geometries(flat.polygon)
    inside, count = group >= 0, len(cut.held)
    many, few, vertices = (
        np.bincount(group[inside], some[inside], count)
        for some in (
            real_t,
            np.where(is_flat, prism_t, real_t),
            np.where(is_flat, CORNER_VERTICES * corners, real_v),
        )
    )
    better = (few < FEWER * many) & (many > 0)
    # A tile's indices have 16 bits.
    tree, parent = cut.tree, cut.tree.parent[cut.held]
    used = prisms.vertex_start[tree.own_last] - prisms.vertex_start[tree.own_first]
    used = used.astype(np.float64)
    np.add.at(used, parent, better * vertices)
    return np.asarray(better & (used[parent] <= MAX_VERTICES))


def _lowest(cut: Cut) -> Ints:
    """Return which of the cells `held` have no proxies in their tile or below it."""
    holds = np.zeros(len(cut.tree.cell))
    holds[cut.tree.parent[cut.held]] = 1.0
    above = cut.tree.raised(np.maximum, holds) > 0
    return np.flatnonzero(~above[cut.held])

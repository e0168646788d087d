# SPDX-License-Identifier: Apache-2.0
"""Object tiles and index records of a part of the forest: a branch, or the crown above.

A branch measures its proxies against the buildings themselves. The crown knows only
what stands for its branches: its proxies are measured against that, and what that is
wrong by is added, so that an error is never understated.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from ingest.flat_roofs import Ladder, roofs_of, with_flat_roofs, worst_overhangs_m
from ingest.grounding import Terrain, proxy_feet_m
from ingest.object_cut import Cut
from ingest.object_encode import Decided, decided, encoded
from ingest.object_index import Drawn, index_records
from ingest.object_tiles import OwnObjects, Proxies, meshes_of
from ingest.object_tree import Tree, below_proxies
from ingest.proxies import make_boxes, measure
from ingest.shapes import Shapes, dimensions_m
from tiles import cells
from tiles.frames import Ecef, Floats, Ints


@dataclass(frozen=True, slots=True)
class Buildings:
    """n buildings in the order of their cells, largest first in each."""

    id: Ints
    dimension_m: Floats
    """(n,) bounding dimension: largest side of the box, what is below ground left out"""
    shapes: Shapes


@dataclass(frozen=True, slots=True)
class StandIn:
    """What stands for all buildings below a cell."""

    shapes: Shapes
    error_m: float


@dataclass(frozen=True, slots=True)
class Made:
    """Tiles and index records of a part."""

    records: NDArray[np.void]
    """(c,) INDEX sorted by cell; `row` counts the bodies from 1, 0 where there is none"""
    bodies: list[bytes]


@dataclass(frozen=True, slots=True)
class Branch:
    """What the crown must know of a branch."""

    record: NDArray[np.void]
    """(1,) INDEX of its root, `row` as in the store"""
    top: StandIn


def make_branch(
    cut: Cut, buildings: Buildings, terrain: Terrain | None = None
) -> tuple[Made, StandIn]:
    """Make all tiles of a branch, and what stands for it above, if that is wanted."""
    tree = cut.tree
    prisms = buildings.shapes.prisms()
    each = np.arange(len(buildings.id) + 1)
    meshes = meshes_of(prisms, each, tree.object_cell)
    own = OwnObjects(meshes, buildings.id, buildings.dimension_m)
    root = np.flatnonzero(tree.parent < 0)[: int(cut.is_wanted)]
    group = np.append(cut.held, root)
    first, last = tree.first[group], tree.last[group]
    solids = buildings.shapes.solids(prisms)
    boxes = make_boxes(solids, first, last)
    roofs = roofs_of(buildings.shapes, prisms, solids)
    error = measure(boxes, solids, first, last) + worst_overhangs_m(roofs, first, last)
    count = len(cut.held)
    start = np.searchsorted(boxes.group, np.arange(count + 1))
    shapes = Shapes.of_boxes(boxes)
    top = StandIn(shapes.take(slice(int(start[-1]), None)), float(error[count:].sum()))
    lower = Ladder(shapes.take(slice(int(start[-1]))), start, error[:count])
    lower = with_flat_roofs(cut, buildings.shapes, prisms, roofs, solids, lower)
    ground = _on_ground(lower.shapes, lower.start, terrain)
    proxies = _proxies(tree, cut.held, ground, lower.start, lower.error_m)
    records = index_records(tree, meshes.drawn + proxies.meshes.drawn)
    return _finished(decided(records, cut, own, proxies), own), top


def make_crown(
    cut: Cut,
    is_root: NDArray[np.bool_],
    own: Buildings,
    branches: Sequence[Branch],
    terrain: Terrain | None = None,
) -> Made:
    """Make the tiles above the branches; the records are those of the crown without them.

    Parameters
    ----------
    is_root : (c,) which of the crown's cells are roots of branches
    branches : one for each of these, in their order
    """
    tree = cut.tree
    meshes = meshes_of(own.shapes.prisms(), np.arange(len(own.id) + 1), tree.object_cell)
    objects = OwnObjects(meshes, own.id, own.dimension_m)
    standing = _standing(cut, is_root, own.shapes, branches)
    held = [standing[k] for k in cut.held.tolist()]
    shapes = Shapes.joined([one.shapes for one in held])
    start = np.cumsum([0, *(len(one.shapes.foot_m) for one in held)])
    error = np.array([one.error_m for one in held])
    shapes = _on_ground(shapes, start, terrain)
    proxies = _proxies(tree, cut.held, shapes, start, error)
    roots = np.concatenate([one.record for one in branches])
    below = Drawn(
        roots["cell"],
        Ecef(roots["centre"]),
        *(
            roots[name].astype(float)
            for name in ("radius_m", "min_height_m", "max_height_m")
        ),
    )
    records = index_records(tree, meshes.drawn + proxies.meshes.drawn + below)
    records[is_root] = roots
    made = _finished(decided(records, cut, objects, proxies, is_root), objects)
    return Made(made.records[~is_root], made.bodies)


def _finished(part: Decided, own: OwnObjects) -> Made:
    bodies = encoded(part, own)
    return Made(part.records, bodies)


def _standing(
    cut: Cut, is_root: NDArray[np.bool_], own: Shapes, branches: Sequence[Branch]
) -> dict[int, StandIn]:
    """Return what stands for each cell of the crown that a proxy above needs."""
    tree = cut.tree
    standing = {
        int(k): one.top for k, one in zip(np.flatnonzero(is_root), branches, strict=True)
    }
    wanted = below_proxies(tree, cut.held)
    for level in range(int(tree.level.max(initial=0)), -1, -1):
        here = np.flatnonzero(wanted & ~is_root & (tree.level == level)).tolist()
        below = [
            [standing[k] for k in np.flatnonzero(tree.parent == place).tolist()]
            for place in here
        ]
        mine = [
            own.take(slice(int(tree.own_first[k]), int(tree.own_last[k]))) for k in here
        ]
        parts = [
            Shapes.joined([*(one.shapes for one in found), more])
            for found, more in zip(below, mine, strict=True)
        ]
        found = _coarser(parts)
        for k, place in enumerate(here):
            worst = max((one.error_m for one in below[k]), default=0.0)
            standing[place] = StandIn(found[k].shapes, found[k].error_m + worst)
    return standing


def _coarser(parts: Sequence[Shapes]) -> list[StandIn]:
    """Make boxes that stand for some shapes each, with the error against these."""
    if not parts:
        return []
    shapes = Shapes.joined(parts)
    end = np.cumsum([len(one.foot_m) for one in parts])
    first = end - [len(one.foot_m) for one in parts]
    prisms = shapes.prisms()
    solids = shapes.solids(prisms)
    boxes = make_boxes(solids, first, end)
    overhang = worst_overhangs_m(roofs_of(shapes, prisms, solids), first, end)
    error = measure(boxes, solids, first, end) + overhang
    start = np.searchsorted(boxes.group, np.arange(len(parts) + 1)).tolist()
    made = Shapes.of_boxes(boxes)
    spans = zip(start[:-1], start[1:], error.tolist(), strict=True)
    return [StandIn(made.take(slice(a, b)), far) for a, b, far in spans]


def _on_ground(shapes: Shapes, start: Ints, terrain: Terrain | None) -> Shapes:
    """Let proxies' walls go on into every terrain that may be drawn with them."""
    if terrain is None or len(start) == 1:
        return shapes
    whole_m = np.repeat(_widths_m(shapes, start), np.diff(start))
    place = shapes.polygon, shapes.foot_m, shapes.lean
    return replace(shapes, foot_m=proxy_feet_m(*place, whole_m, terrain))


def _proxies(
    tree: Tree, held: Ints, shapes: Shapes, start: Ints, error_m: Floats
) -> Proxies:
    """Return proxies of the cells `held`; the shapes of each begin at `start`."""
    meshes = meshes_of(shapes.prisms(), start, tree.cell[tree.parent[held]])
    return Proxies(
        meshes,
        cells.child_position(tree.cell[held]),
        _widths_m(shapes, start),
        error_m,
        tree.last[held] - tree.first[held],
    )


def _widths_m(shapes: Shapes, start: Ints) -> Floats:
    """Return the largest side of a box around each group of shapes, m."""
    if len(start) == 1:
        return np.zeros(0)
    first = start[:-1]
    bounds = shapely.bounds(shapes.polygon)
    low = np.minimum.reduceat(bounds[:, :2], first)
    high = np.maximum.reduceat(bounds[:, 2:], first)
    whole = np.asarray(shapely.box(*low.T, *high.T), object)
    height = np.maximum.reduceat(shapes.top_m, first) - np.minimum.reduceat(
        shapes.ground_m, first
    )
    return dimensions_m(whole, height)

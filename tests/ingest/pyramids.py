# SPDX-License-Identifier: Apache-2.0
"""An objects lane in memory, made in as many branches as a test wants."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ingest.object_cut import crown
from ingest.object_plan import Outline, plan_objects
from ingest.object_pyramid import Branch, Buildings, make_branch, make_crown
from ingest.shapes import Shapes, centres_deg
from tiles.forest import Forest, build_forest
from tiles.index_tree import INDEX
from tiles.objects import ObjectTile, decode


@dataclass(frozen=True)
class Built:
    buildings: Buildings
    cell: np.ndarray
    """of each building"""
    bodies: dict[int, bytes]
    records: NDArray[np.void]
    forest: Forest
    tiles: dict[int, ObjectTile]
    branches: int


def take(buildings: Buildings, which: np.ndarray) -> Buildings:
    shapes = buildings.shapes.take(which)
    return Buildings(buildings.id[which], buildings.dimension_m[which], shapes)


def both(a: Buildings, b: Buildings) -> Buildings:
    shapes = Shapes.joined([a.shapes, b.shapes])
    dimension_m = np.concatenate((a.dimension_m, b.dimension_m))
    return Buildings(np.concatenate((a.id, b.id)), dimension_m, shapes)


def build(buildings: Buildings, at_most: int) -> Built:
    """Make all tiles, in branches of at most so many buildings."""
    lon, lat = centres_deg(buildings.shapes.polygon)
    size = np.full(len(lon), 40)
    plan = plan_objects(
        Outline(buildings.id, lon, lat, buildings.dimension_m, size), at_most
    )
    records, bodies, branches = [np.zeros(0, INDEX)], [b""], []
    for number, root in enumerate(plan.roots):
        cut, which = plan.branch(number)
        made, top = make_branch(cut, take(buildings, which))
        made.records["row"][made.records["row"] > 0] += len(bodies) - 1
        bodies += made.bodies
        records.append(made.records)
        here = made.records["cell"] == plan.tree.cell[root]
        branches.append(Branch(made.records[here], top))
    if branches:
        cut, own, is_root = crown(plan.tree, plan.held, plan.roots)
        made = make_crown(cut, is_root, take(buildings, plan.order[own]), branches)
        made.records["row"][made.records["row"] > 0] += len(bodies) - 1
        bodies += made.bodies
        records.append(made.records)
    index = np.concatenate(records)
    has_tile = index[index["row"] > 0]
    named = {int(one["cell"]): bodies[int(one["row"])] for one in has_tile}
    tiles = {cell: decode(body) for cell, body in named.items()}
    forest = build_forest(index)
    return Built(buildings, plan.cell, named, index, forest, tiles, len(branches))


def renumbered(buildings: Buildings, ids: np.ndarray) -> Buildings:
    return replace(buildings, id=ids)

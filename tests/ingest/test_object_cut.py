# SPDX-License-Identifier: Apache-2.0
"""Branches and crown: together the whole tree, each cell and each object once."""

import numpy as np
import pytest

from ingest.object_cut import branch, branch_roots, crown
from ingest.object_plan import Outline, Plan, plan_objects
from tiles import cells


def plan(at_most: int) -> Plan:
    """Three towns, one of them on a zone's corner, and a few houses nowhere near."""
    rng = np.random.default_rng(5)
    towns = [
        rng.normal(place, 0.01, (300, 2)) for place in ((0.0, 45.0), (7.4, 43.7), (7.9, 44))
    ]
    lon, lat = np.concatenate([*towns, rng.uniform(-40, 40, (20, 2))]).T
    size = rng.uniform(8, 25, len(lon))
    size[:3] = (900, 4000, 90_000)
    outline = Outline(np.arange(len(lon)), lon, lat, size, np.full(len(lon), 40))
    return plan_objects(outline, at_most)


@pytest.mark.parametrize("at_most", [1, 40, 250, 10_000])
def test_branches_and_crown_are_the_whole_tree(at_most: int) -> None:
    whole = plan(at_most)
    cuts = [whole.branch(k) for k in range(len(whole.roots))]
    top, own, is_root = crown(whole.tree, whole.held, whole.roots)
    found = np.concatenate([top.tree.cell[~is_root], *(cut.tree.cell for cut, _ in cuts)])
    assert np.array_equal(np.sort(found), whole.tree.cell)
    objects = np.concatenate([whole.order[own], *(mine for _, mine in cuts)])
    assert np.array_equal(np.sort(objects), np.arange(len(whole.cell)))
    roots = whole.tree.cell[whole.roots]
    assert np.array_equal(top.tree.cell[is_root], roots)
    assert not (
        cells.contains(roots[:, None], roots) & ~np.eye(len(roots), dtype=bool)
    ).any()


@pytest.mark.parametrize("at_most", [1, 40, 250])
def test_a_branch_has_few_objects_or_no_children_and_could_not_be_larger(
    at_most: int,
) -> None:
    tree, roots = plan(at_most).tree, branch_roots(plan(at_most).tree, at_most)
    count = tree.last - tree.first
    has_child = np.isin(np.arange(len(tree.cell)), tree.parent)
    assert ((count[roots] <= at_most) | ~has_child[roots]).all()
    above = tree.parent[roots]
    assert (count[above[above >= 0]] > at_most).all()


def test_every_proxy_is_held_once_and_objects_of_a_part_stand_in_its_own_order() -> None:
    whole = plan(60)
    tree, held = whole.tree, whole.held
    top, own, _ = crown(tree, held, whole.roots)
    parts = [branch(tree, held, int(root)) for root in whole.roots]
    found = np.concatenate([one.tree.cell[one.held] for one in (top, *parts)])
    assert np.array_equal(np.sort(found), np.sort(tree.cell[held]))
    for number, part in enumerate(parts):
        _, objects = whole.branch(number)
        assert np.array_equal(part.tree.object_cell, whole.cell[objects])
        assert (part.tree.parent < 0).sum() == 1
    assert np.array_equal(top.tree.object_cell, whole.cell[whole.order[own]])
    assert len(own) > 0

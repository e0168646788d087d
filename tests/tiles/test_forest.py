# SPDX-License-Identifier: Apache-2.0
"""The forest's arrays against the arithmetic of cell ids."""

import numpy as np
import pytest

from tiles import cells, links, zones
from tiles.forest import NONE, Forest, build_forest
from tiles.index_tree import INDEX, is_monotone


def records_of(ids: list[int]) -> np.ndarray:
    records = np.zeros(len(ids), INDEX)
    records["cell"] = ids
    return records


@pytest.fixture(scope="module")
def forest() -> Forest:
    """All zones, refined at random and around corners that hurt, in random order."""
    rng = np.random.default_rng(3)
    ids = [int(cells.make(zone, 0, 0, 0)) for zone in range(zones.COUNT)]
    for lon, lat in (
        (np.pi - 1e-9, 0.1),
        (-np.pi, 0.1),
        (0.0, 1.5707),
        (0.1, -1.5707),
        (0.0, 0.0),
    ):
        ids += [int(cells.cell_at(lon, lat, level)) for level in range(1, 7)]
    for _ in range(60):
        parent = int(rng.choice([c for c in set(ids) if cells.level(c) < 6]))
        ids += [int(child) for child in cells.children(parent)]
    whole = {
        int(cells.ancestor(c, k)) for c in set(ids) for k in range(int(cells.level(c)) + 1)
    }
    return build_forest(records_of(list(rng.permutation(sorted(whole)))))


def test_rows_are_ordered_by_level_then_cell(forest: Forest) -> None:
    ids = forest.records["cell"]
    keys = list(zip(cells.level(ids).tolist(), ids.tolist(), strict=True))
    assert keys == sorted(keys)


def test_parents_and_children_are_those_of_the_ids(forest: Forest) -> None:
    row_of = {int(c): k for k, c in enumerate(forest.records["cell"])}
    for k, one in enumerate(forest.records["cell"]):
        if cells.level(one) == 0:
            assert forest.parent[k] == NONE
        else:
            assert (
                forest.parent[k] == row_of[int(cells.ancestor(one, cells.level(one) - 1))]
            )
        wanted = [row_of.get(int(child), NONE) for child in cells.children(one)]
        assert forest.children[k].tolist() == wanted


def test_a_link_is_the_deepest_cell_that_covers_the_neighbour(forest: Forest) -> None:
    row_of = {int(c): k for k, c in enumerate(forest.records["cell"])}
    for k, one in enumerate(forest.records["cell"]):
        for side, neighbour in enumerate(links.edge_neighbours(one)):
            level = int(cells.level(neighbour))
            path = [int(cells.ancestor(neighbour, n)) for n in range(level, -1, -1)]
            wanted = next((row_of[c] for c in path if c in row_of), NONE)
            assert forest.links[k, side] == wanted


def test_rows_of_cells_and_of_strangers(forest: Forest) -> None:
    ids = forest.records["cell"]
    np.testing.assert_array_equal(forest.row_of(ids), np.arange(len(ids)))
    stranger = int(cells.cell_at(1.0, 1.0, 20))
    assert forest.row_of(stranger) == NONE
    assert forest.row_of(np.array([[stranger, int(ids[3])]])).tolist() == [[NONE, 3]]


def test_an_empty_index_is_a_forest() -> None:
    empty = build_forest(np.zeros(0, INDEX))
    assert len(empty.records) == len(empty.parent) == 0
    assert empty.children.shape == empty.links.shape == (0, 4)
    assert empty.row_of(5) == NONE
    assert empty.nbytes == 0


def test_other_records_are_refused() -> None:
    with pytest.raises(ValueError, match="INDEX"):
        build_forest(np.zeros(3, [("cell", "<i8")]))


def test_the_deepest_level_has_no_children() -> None:
    deepest = int(cells.cell_at(0.5, 0.5, cells.MAX_LEVEL))
    forest = build_forest(records_of([deepest]))
    assert (forest.children == NONE).all()


def test_monotone_errors_are_recognised(forest: Forest) -> None:
    records = forest.records.copy()
    records["error_m"] = 100.0 / 2 ** cells.level(records["cell"])
    assert is_monotone(records, forest.parent).all()
    child = int(np.flatnonzero(forest.parent >= 0)[5])
    records["error_m"][child] = 1e6
    wrong = np.flatnonzero(~is_monotone(records, forest.parent))
    assert wrong.tolist() == [child]

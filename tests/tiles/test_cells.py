# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tiles import cells

SHALLOW = 4


@st.composite
def places(draw: st.DrawFn, deepest: int = cells.MAX_LEVEL) -> tuple[int, int, int, int]:
    level = draw(st.integers(0, deepest))
    side = st.integers(0, (1 << level) - 1)
    return draw(st.integers(0, 31)), level, draw(side), draw(side)


ANY = places().map(lambda place: int(cells.make(*place)))
INNER = places(cells.MAX_LEVEL - 1).map(lambda place: int(cells.make(*place)))


def every_place(level: int) -> list[tuple[int, int, int, int]]:
    side = range(1 << level)
    return [(zone, level, row, col) for zone in range(32) for row in side for col in side]


def plain_id(zone: int, level: int, row: int, col: int) -> int:
    """Write the bits as a string: the layout read aloud, without any bit tricks."""
    pairs = zip(f"{row:0{level}b}", f"{col:0{level}b}", strict=True) if level else ()
    bits = f"{zone:05b}" + "".join(r + c for r, c in pairs) + "1"
    return int(bits.ljust(62, "0"), 2)


def shallow_cells() -> np.ndarray:
    places = np.array([p for level in range(SHALLOW + 1) for p in every_place(level)])
    return cells.make(*places.T)


def test_every_shallow_id_is_the_documented_bits() -> None:
    for level in range(SHALLOW + 1):
        places = every_place(level)
        ids = cells.make(*np.array(places).T)
        assert ids.tolist() == [plain_id(*place) for place in places]


@given(places())
def test_every_deep_id_is_the_documented_bits_and_gives_its_place_back(
    place: tuple[int, int, int, int],
) -> None:
    cell = int(cells.make(*place))
    assert cell == plain_id(*place)
    zone, level, row, col = place
    back = cells.zone(cell), cells.level(cell), *cells.row_col(cell)
    assert [int(part) for part in back] == [zone, level, row, col]


def test_every_shallow_id_gives_its_place_back_and_is_unique() -> None:
    places = np.array([p for level in range(SHALLOW + 1) for p in every_place(level)])
    ids = cells.make(*places.T)
    back = np.stack((cells.zone(ids), cells.level(ids), *cells.row_col(ids)), axis=-1)
    assert np.array_equal(back, places)
    assert len(np.unique(ids)) == len(ids) == 32 * (1 + 4 + 16 + 64 + 256)


def test_a_zone_root_is_the_zone_a_one_and_zeros() -> None:
    zone = np.arange(32)
    assert np.array_equal(cells.make(zone, 0, 0, 0), (zone * 2 + 1) << 56)


def test_children_are_south_west_south_east_north_west_north_east() -> None:
    ids = shallow_cells()
    row, col = cells.row_col(ids)
    children = cells.children(ids)
    assert children.shape == (*ids.shape, 4)
    for k, (north, east) in enumerate([(0, 0), (0, 1), (1, 0), (1, 1)]):
        made = cells.make(
            cells.zone(ids), cells.level(ids) + 1, 2 * row + north, 2 * col + east
        )
        assert np.array_equal(children[:, k], made)


@given(INNER)
def test_a_parent_has_four_ascending_children_that_know_it(cell: int) -> None:
    children = cells.children(cell)
    assert cells.ancestor(children, cells.level(cell)).tolist() == [cell] * 4
    assert cells.child_position(children).tolist() == [0, 1, 2, 3]
    assert children[0] < children[1] < cell < children[2] < children[3]


@given(ANY, st.integers(0, cells.MAX_LEVEL))
def test_an_ancestor_is_reached_level_by_level(cell: int, level: int) -> None:
    depth = int(cells.level(cell))
    if level > depth:
        with pytest.raises(ValueError, match="ancestor"):
            cells.ancestor(cell, level)
        return
    above = cell
    for _ in range(depth - level):
        above = int(cells.ancestor(above, cells.level(above) - 1))
    assert cells.ancestor(cell, level) == above
    assert cells.contains(above, cell)


@given(ANY, ANY)
def test_containing_is_being_an_ancestor(a: int, b: int) -> None:
    above = cells.level(b) >= cells.level(a) and cells.ancestor(b, cells.level(a)) == a
    assert bool(cells.contains(a, b)) == bool(above)


def test_a_range_holds_the_shallow_descendants_and_no_other_cell() -> None:
    ids = np.sort(shallow_cells())
    zone, level = cells.zone(ids), cells.level(ids)
    row, col = cells.row_col(ids)
    first = np.searchsorted(ids, cells.range_min(ids), "left")
    last = np.searchsorted(ids, cells.range_max(ids), "right")
    assert np.array_equal(last - first, (4 ** (SHALLOW + 1 - level) - 1) // 3)
    for at in range(0, len(ids), 37):
        inside = slice(first[at], last[at])
        up = level[inside] - level[at]
        assert (zone[inside] == zone[at]).all()
        assert (row[inside] >> up == row[at]).all()
        assert (col[inside] >> up == col[at]).all()


@given(ANY)
def test_a_range_ends_at_the_deepest_corner_cells(cell: int) -> None:
    deeper = cells.MAX_LEVEL - cells.level(cell)
    row, col = (value << deeper for value in cells.row_col(cell))
    far = (1 << deeper) - 1
    zone = cells.zone(cell)
    assert cells.range_min(cell) == cells.make(zone, cells.MAX_LEVEL, row, col)
    assert cells.range_max(cell) == cells.make(zone, cells.MAX_LEVEL, row + far, col + far)


@given(ANY)
def test_the_place_on_the_globe_leads_back_also_after_a_turn(cell: int) -> None:
    level = int(cells.level(cell))
    row, col = cells.global_row_col(cell)
    assert 0 <= row < 4 << level
    assert 0 <= col < 8 << level
    for turn in (-1, 0, 2):
        assert cells.from_global(level, row, col + turn * (8 << level)) == cell


@given(ANY)
def test_bounds_are_exact_multiples_of_the_step(cell: int) -> None:
    level = int(cells.level(cell))
    row, col = (int(value) for value in cells.global_row_col(cell))
    step = math.pi / 4 / 2**level
    west, south, east, north = cells.bounds_rad(cell)
    assert west == (col - 4 * 2**level) * step
    assert east == (col + 1 - 4 * 2**level) * step
    assert south == (row - 2 * 2**level) * step
    assert north == (row + 1 - 2 * 2**level) * step


@given(INNER)
def test_a_child_lies_inside_its_parent_and_shares_its_edges_to_the_bit(cell: int) -> None:
    west, south, east, north = cells.bounds_rad(cell)
    child = cells.bounds_rad(cells.children(cell))
    assert (child[0][0], child[1][0], child[2][3], child[3][3]) == (
        west,
        south,
        east,
        north,
    )
    assert child[2][0] == child[0][1] == child[2][2] == child[0][3]
    assert child[3][0] == child[1][2] == child[3][1] == child[1][3]


@given(ANY)
def test_a_cell_holds_its_own_corners_but_not_its_east_and_north_edge(cell: int) -> None:
    level = cells.level(cell)
    west, south, east, north = cells.bounds_rad(cell)
    assert cells.cell_at(west, south, level) == cell
    assert cells.cell_at(np.nextafter(east, -9), np.nextafter(north, -9), level) == cell
    assert cells.cell_at(east, south, level) != cell
    assert cells.cell_at(west, north, level) != cell or north == math.pi / 2


@given(st.floats(-7.0, 7.0), st.floats(-1.6, 1.6))
def test_the_cells_of_a_point_are_one_chain_of_ancestors(lon: float, lat: float) -> None:
    levels = np.arange(cells.MAX_LEVEL + 1)
    chain = cells.cell_at(lon, lat, levels)
    assert np.array_equal(cells.ancestor(chain[1:], levels[:-1]), chain[:-1])


def test_the_poles_and_the_antimeridian_are_in_valid_cells() -> None:
    level = np.arange(cells.MAX_LEVEL + 1)
    for lat, row in ((math.pi / 2, (4 << level) - 1), (-math.pi / 2, 0 * level)):
        for lon in (-math.pi, math.pi, 3 * math.pi):
            cell = cells.cell_at(lon, lat, level)
            assert np.array_equal(cells.level(cell), level)
            assert np.array_equal(cells.global_row_col(cell)[0], row)
            assert (cells.global_row_col(cell)[1] == 0).all()


def test_a_cell_is_written_as_zone_level_row_and_column() -> None:
    assert cells.text(int(cells.make(12, 5, 17, 9))) == "12/5/17/9"


@pytest.mark.parametrize(
    "place", [(-1, 3, 0, 0), (32, 3, 0, 0), (0, -1, 0, 0), (0, 29, 0, 0), (0, 3, 8, 0),
              (0, 3, 0, 8), (0, 3, -1, 0), (0, 3, 0, -1)],
)  # fmt: skip
def test_a_place_outside_the_forest_is_refused(place: tuple[int, int, int, int]) -> None:
    with pytest.raises(ValueError, match=r"level|outside"):
        cells.make(*place)


def test_roots_have_no_parent_and_the_deepest_cells_no_children() -> None:
    root, deepest = cells.make(3, 0, 0, 0), cells.make(3, 28, 5, 6)
    with pytest.raises(ValueError, match="level"):
        cells.ancestor(root, -1)
    with pytest.raises(ValueError, match="root"):
        cells.child_position(root)
    with pytest.raises(ValueError, match="deepest"):
        cells.children(deepest)


@given(ANY)
def test_a_scalar_in_is_a_hashable_int64_scalar_out(cell: int) -> None:
    values = (
        cells.level(cell),
        cells.zone(cell),
        *cells.row_col(cell),
        cells.ancestor(cell, 0),
        cells.range_min(cell),
        cells.range_max(cell),
        *cells.global_row_col(cell),
    )
    assert {type(value).__name__ for value in values} == {"int64"}


def test_arrays_keep_their_shape() -> None:
    ids = shallow_cells()[: 6 * 5 * 4].reshape(6, 5, 4)
    for value in (cells.level(ids), cells.ancestor(ids, 0)):
        assert value.shape == ids.shape
    assert cells.children(ids).shape == (6, 5, 4, 4)
    assert cells.bounds_rad(ids)[0].shape == ids.shape

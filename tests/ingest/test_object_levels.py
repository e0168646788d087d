# SPDX-License-Identifier: Apache-2.0
"""Where objects live: the rule of the levels, and what it is for: linked cells."""

import numpy as np
import pytest

from ingest import object_levels
from ingest.object_levels import MAX_OBJECTS, assign
from tiles import cells, geodesy, links
from tiles.errors import InputError

DEGREE_M = 111_194.0


def town(
    rng: np.random.Generator, count: int, place: tuple[float, float] = (7.4, 43.7)
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centres, rad, of houses of 5 to 40 m in 2 km, and one in 200 of 60 to 900 m."""
    lat = np.radians(place[1] + rng.normal(0, 0.006, count))
    lon = np.radians(place[0] + rng.normal(0, 0.006, count) / np.cos(lat))
    size = rng.uniform(5, 40, count)
    large = rng.random(count) < 0.005
    size[large] = rng.uniform(60, 900, large.sum())
    return lon, lat, size


def cells_of(lon: np.ndarray, lat: np.ndarray, size: np.ndarray) -> np.ndarray:
    return assign(lon, lat, size, np.full(len(lon), 20), 20)


def test_an_object_is_in_a_cell_that_holds_its_centre_and_is_wider(
    rng: np.random.Generator,
) -> None:
    lon, lat, size = town(rng, 4000)
    cell = cells_of(lon, lat, size)
    assert np.array_equal(cells.cell_at(lon, lat, cells.level(cell)), cell)
    assert (geodesy.cell_width_m(cell) > size).all()


def test_ordinary_objects_share_block_sized_cells_of_few(rng: np.random.Generator) -> None:
    lon, lat, size = town(rng, 4000)
    cell = cells_of(lon, lat, size)
    _, count = np.unique(cell, return_counts=True)
    assert 4 <= np.median(count) <= MAX_OBJECTS
    width = geodesy.cell_width_m(cell[size < 40])
    assert (width > 40 / 2).all()
    assert (geodesy.cell_edge_m(cell) < 1500).all()


def test_a_full_cell_splits_unless_its_children_are_narrower_than_its_objects(
    rng: np.random.Generator,
) -> None:
    lon, lat, size = town(rng, 4000)
    cell = cells_of(lon, lat, size)
    for one in np.unique(cell):
        inside = cells.contains(one, cells.cell_at(lon, lat, cells.MAX_LEVEL))
        if (cells.contains(one, cell) & (cell != one)).any():
            continue
        child = cells.cell_at(lon[inside], lat[inside], cells.level(one) + 1)
        fits = geodesy.cell_width_m(child) > size[inside]
        assert inside.sum() <= MAX_OBJECTS or fits.mean() < 0.9


def test_the_linked_cells_of_all_levels_hold_every_object_that_reaches_a_point(
    rng: np.random.Generator,
) -> None:
    for place in ((0.0, 45.0), (180.0, 0.0), (-122.44, 37.76), (20.0, 85.0)):
        lon, lat, size = town(rng, 500, place)
        cell = cells_of(lon, lat, size)
        at = geodesy.to_ecef(lon, lat, 0.0)
        for k in range(0, 500, 10):
            reach = np.flatnonzero(np.linalg.norm(at - at[k], axis=1) <= size / 2)
            levels = np.arange(cells.MAX_LEVEL + 1)
            linked = links.linked_cells(lon[k], lat[k], levels)
            assert np.isin(cell[reach], linked).all()


def test_a_lone_house_still_gets_a_small_cell_and_a_house_at_the_pole_its_zone() -> None:
    lone = cells_of(np.radians([9.0]), np.radians([48.5]), np.array([10.0]))
    assert geodesy.cell_edge_m(lone)[0] < 1500
    lon, lat = np.array([0.3, 0.3]), np.array([np.pi / 2, 0.9])
    pole, other = cells_of(lon, lat, np.array([10.0, 10.0]))
    assert cells.level(pole) == 0
    assert geodesy.cell_edge_m(other) > 1500  # it shares the pole's zone, and one in two


def test_many_in_one_place_go_up_rather_than_overflow(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(object_levels, "MAX_VERTICES", 500)
    count = 300
    lon, lat = np.full(count, 0.1), np.full(count, 0.8)
    vertices = np.full(count, 20)
    cell = assign(lon, lat, rng.uniform(10, 30, count), vertices, 20)
    held = {int(c): int(vertices[cell == c].sum()) for c in np.unique(cell)}
    assert max(held.values()) <= 500
    assert sum(held.values()) == vertices.sum()
    assert len({int(cells.level(c)) for c in held}) == 12
    monkeypatch.setattr(object_levels, "MAX_VERTICES", 30)
    with pytest.raises(InputError, match="too many buildings"):
        assign(lon, lat, np.full(count, 10.0), vertices, 20)

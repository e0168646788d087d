# SPDX-License-Identifier: Apache-2.0
import numpy as np

from tests.viewer.worlds import make_world, one_colour, terrain_tile
from tiles import cells
from tiles.lanes import Lane
from viewer.detail import detail_m
from viewer.textures import shows_water

EARTH = {"kind": "terrain", "bounds_deg": [-180.0, -90.0, 180.0, 90.0], "spacing_m": 1e4}


def test_a_cell_is_as_fine_as_the_finest_source_that_covers_all_of_it() -> None:
    inside = int(cells.cell_at(*np.radians((10.5, 20.5)), 12))
    outside = int(cells.cell_at(*np.radians((12.0, 20.5)), 12))
    around = int(cells.cell_at(*np.radians((10.5, 20.5)), 4))
    edge = int(cells.cell_at(np.pi - 1e-6, 0.1, 12))
    grey = one_colour((90, 90, 90))
    tiles = [terrain_tile(cell, grey, 3) for cell in (inside, outside, around, edge)]
    forest = make_world(tiles).forests[Lane.TERRAIN]
    box = {"kind": "imagery", "bounds_deg": [10.0, 20.0, 11.0, 21.0], "spacing_m": 5.0}
    houses = {"kind": "buildings", "bounds_deg": None, "spacing_m": None}
    found = detail_m(forest, [EARTH, box, houses])[forest.row_of(forest.records["cell"])]
    by_cell = dict(zip(forest.records["cell"].tolist(), found.tolist(), strict=True))
    # Where a fine picture is, nothing is made up: a minus.
    assert by_cell == {inside: -5.0, outside: 1e4, around: 1e4, edge: 1e4}
    coarse = box | {"spacing_m": 5e3}
    assert (detail_m(forest, [EARTH, coarse]) > 0).all()
    assert (detail_m(forest, [houses]) == 0.0).all()


def test_blue_textures_show_water_and_others_do_not() -> None:
    assert shows_water(one_colour((20, 60, 120)))
    assert shows_water(one_colour((88, 138, 172)))
    for rgb in ((120, 124, 110), (110, 132, 86), (222, 228, 236), (0, 0, 0)):
        assert not shows_water(one_colour(rgb))

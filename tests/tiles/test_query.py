# SPDX-License-Identifier: Apache-2.0
"""Objects at a place through linked cells, against asking every object."""

import sqlite3
from pathlib import Path

import numpy as np
import pytest
import shapely

from tests.tiles.towns import HARD, METRES, Town, town
from tiles import cells
from tiles.errors import TileFault
from tiles.footprints import covering, place_inside, read_footprints, rings_of
from tiles.forest import build_forest
from tiles.frames import Floats
from tiles.index_tree import INDEX
from tiles.query import Standing, homes_of
from tiles.reach import unreachable
from tiles.store import Store

QUERIES = 100_000


@pytest.fixture(scope="module")
def everywhere(tmp_path_factory: pytest.TempPathFactory) -> Town:
    """Objects around zone edges and corners, the antimeridian and both poles."""
    path = tmp_path_factory.mktemp("query") / "town.geopage"
    return town(path, np.random.default_rng(11), per_place=300)


@pytest.fixture(scope="module")
def places_deg(everywhere: Town) -> Floats:
    """Places in and around the objects, longitudes and latitudes, (n, 2)."""
    rng = np.random.default_rng(12)
    which = rng.integers(len(everywhere.centre_deg), size=QUERIES)
    north, size_m = everywhere.centre_deg[which, 1], everywhere.dimension_m[which]
    off = rng.uniform(-0.8, 0.8, (QUERIES, 2)) * size_m[:, None] / METRES
    off[:, 0] /= np.cos(np.radians(np.clip(north, -89.99, 89.99)))
    places = everywhere.centre_deg[which] + off
    places[:, 1] = np.clip(places[:, 1], -90, 90)
    # Exactly on the edges of zones, too, and at the antimeridian from both sides.
    places[:2000, 0] = np.rint(places[:2000, 0] / 45) * 45
    places[2000:4000, 1] = np.rint(places[2000:4000, 1] / 45) * 45
    places[:, 0] = (places[:, 0] + 180) % 360 - 180
    places[:1000:2, 0] *= np.where(np.abs(places[:1000:2, 0]) == 180, -1, 1)
    return places


def asked(footprint: np.ndarray, places_deg: Floats) -> set[tuple[int, int]]:
    """Ask every object, at each place and one round further east and west."""
    tree = shapely.STRtree(footprint)
    found = set()
    for turn in (-360.0, 0.0, 360.0):
        pairs = tree.query(
            shapely.points(places_deg + np.array([turn, 0])), predicate="within"
        )
        found |= set(zip(pairs[0].tolist(), (pairs[1] + 1).tolist(), strict=True))
    return found


def test_linked_cells_find_what_asking_every_object_finds(
    everywhere: Town, places_deg: Floats
) -> None:
    with Store(everywhere.path) as store:
        place, number = Standing(store).at(*np.radians(places_deg).T)
    found = set(zip(place.tolist(), number.tolist(), strict=True))
    wanted = asked(everywhere.footprint, places_deg)
    assert len(found) == len(place)
    assert len(wanted) > QUERIES
    # On an edge to the last bit, either answer is right.
    for one, other in found ^ wanted:
        edge = everywhere.footprint[other - 1].boundary
        near = [
            edge.distance(shapely.Point(places_deg[one] + (t, 0))) for t in (-360, 0, 360)
        ]
        assert min(near) < 1e-9
    assert len(found ^ wanted) < 20


def test_one_place_gets_the_answer_that_it_gets_among_many(
    everywhere: Town, places_deg: Floats
) -> None:
    some = np.radians(places_deg[:: QUERIES // 40])
    with Store(everywhere.path) as store:
        standing = Standing(store)
        place, number = standing.at(*some.T)
        for k, one in enumerate(some):
            alone = standing.at(one[:1], one[1:])[1]
            assert alone.tolist() == number[place == k].tolist()


def test_no_places_have_no_objects(everywhere: Town) -> None:
    with Store(everywhere.path) as store:
        place, number = Standing(store).at(np.zeros(0), np.zeros(0))
    assert len(place) == len(number) == 0


def test_few_cells_are_asked(everywhere: Town) -> None:
    with Store(everywhere.path) as store:
        standing = Standing(store)
        place, row = standing.linked(*np.radians(everywhere.centre_deg).T)
    level = cells.level(standing.forest.records["cell"][row])
    asked_of, count = np.unique(place * 32 + level, return_counts=True)
    assert count[asked_of % 32 > 0].max() <= 4
    assert len(np.unique(place * len(standing.forest.records) + row)) == len(row)


def test_every_object_is_found_where_it_stands(everywhere: Town) -> None:
    with Store(everywhere.path) as store:
        assert list(unreachable(store)) == []
        wrong = store.connection.execute("SELECT COUNT(*) FROM object").fetchone()[0]
    assert wrong == len(everywhere.footprint)


def test_an_object_away_from_its_cell_is_reported(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    small = town(tmp_path / "town.geopage", rng, per_place=2)
    with Store(small.path) as store:
        standing = Standing(store)
        cell = cells.level(standing.forest.records["cell"])
        deep = int(
            np.flatnonzero((standing.forest.records["own_dimension_m"] > 0) & (cell > 5))[0]
        )
        victim = standing.footprints(deep)
    moved = shapely.to_wkb(shapely.box(100.0, 10.0, 100.001, 10.001))
    with sqlite3.connect(small.path) as connection:
        connection.execute(
            "UPDATE object SET footprint=? WHERE id=?", (moved, int(victim.id[0]))
        )
    connection.close()
    with Store(small.path) as store:
        assert list(unreachable(store)) == [int(victim.id[0])]


def test_a_footprint_that_is_none_is_a_fault(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    small = town(tmp_path / "town.geopage", rng, per_place=1)
    with sqlite3.connect(small.path) as connection:
        connection.execute("UPDATE object SET footprint=?", (b"\x01\x03\x00",))
    connection.close()
    with Store(small.path) as store, pytest.raises(TileFault, match="ends early"):
        Standing(store).at(*np.radians(small.centre_deg).T)


@pytest.mark.parametrize(
    ("wkb", "says"),
    [
        (shapely.to_wkb(shapely.Point(1, 2)), "type 1"),
        (shapely.to_wkb(shapely.box(0, 0, 1, 1))[:40], "buffer"),
        (shapely.to_wkb(shapely.Polygon()), "without corners"),
        (b"", "ends early"),
    ],
)
def test_what_is_no_polygon_is_refused(wkb: bytes, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        rings_of(wkb)


def test_footprints_cover_what_shapely_says(
    rng: np.random.Generator, everywhere: Town
) -> None:
    some = everywhere.footprint[::7]
    stored = [(k, shapely.to_wkb(one)) for k, one in enumerate(some)]
    footprints = read_footprints(stored)
    lon, lat = place_inside(footprints)
    assert shapely.contains_xy(some, lon, lat).all()
    place, which = covering(footprints, lon + rng.choice((-720, 0, 360), len(lon)), lat)
    assert set(zip(range(len(lon)), range(len(lon)), strict=True)) <= set(
        zip(place.tolist(), which.tolist(), strict=True)
    )


def test_an_empty_forest_holds_nothing() -> None:
    homes = homes_of(build_forest(np.zeros(0, INDEX)))
    assert homes.around(*np.radians(HARD).T).shape == (2, 0)

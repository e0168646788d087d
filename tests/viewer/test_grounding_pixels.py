# SPDX-License-Identifier: Apache-2.0
"""No light shows under a wall, whatever terrain level is drawn with it."""

import math
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from geopage.settings import PagerSettings
from geopage.view import ViewState
from ingest.buildings import BuildingOptions, ingest_buildings
from tests.viewer.gaps import beside, light_under_walls
from tests.viewer.hill_city import (
    DEGREE_M,
    LAT_DEG,
    LON_DEG,
    add_ground,
    add_houses,
    write_houses,
)
from tiles.frames import Ecef, Floats
from tiles.geodesy import to_geodetic
from tiles.lanes import Lane
from tiles.objects import PROXY_ORDINAL
from tiles.store import Store
from tiles.surface import Surface
from viewer.camera import Pose, view_state
from viewer.session import Picture, Session

SIZE = 480, 270
VIEWS = [(300, 40, -8), (300, 200, -25), (3000, 0, -8), (3000, 90, -20), (15000, 180, -20)]
"""Distance to the city, m, heading and pitch, degrees"""


@pytest.fixture(scope="module")
def ground(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a store with rough ground and no houses; not to be changed."""
    folder = tmp_path_factory.mktemp("hills")
    add_ground(folder, folder / "ground.geopage")
    return folder


@pytest.fixture(scope="module")
def city(ground: Path) -> Path:
    """The store with its houses."""
    store = ground / "city.geopage"
    shutil.copy(ground / "ground.geopage", store)
    add_houses(ground, store)
    return store


@contextmanager
def looking_at(store: Path, threshold_px: float) -> Iterator[Session]:
    settings = PagerSettings(threshold_px=threshold_px)
    with Session(store, settings, Picture(SIZE)) as session:
        yield session


def view_from(surface: Surface, away_m: float, heading: float, pitch: float) -> ViewState:
    """Look at the city from a distance, at least 15 m above the ground."""
    turn, down = math.radians(heading), math.radians(-pitch)
    level_m = away_m * math.cos(down)
    lat = LAT_DEG - level_m * math.cos(turn) / DEGREE_M
    squeeze = math.cos(math.radians(LAT_DEG))
    lon = LON_DEG - level_m * math.sin(turn) / DEGREE_M / squeeze
    place = math.radians(lon), math.radians(lat)
    city_m = surface.height_at(math.radians(LON_DEG), math.radians(LAT_DEG))
    height_m = max(city_m + away_m * math.sin(down), surface.height_at(*place) + 15)
    return view_state(Pose(*place, height_m, turn, -down), SIZE)


@pytest.mark.parametrize("threshold_px", [1.0, 4.0])
def test_no_light_shows_under_a_wall_from_any_distance(
    city: Path, threshold_px: float
) -> None:
    shown, levels = [], set()
    with looking_at(city, threshold_px) as session:
        for seen_from in VIEWS:
            view = view_from(session.surface, *seen_from)
            drawn, _ = session.settle(view)
            assert light_under_walls(session, drawn, view).sum() == 0
            ids = session.renderer.read_ids()
            shown.append((ids < 0).sum())
            near = ids[beside(ids < 0) & (ids > 0)] - 1
            levels |= set(session.surface.level[drawn.terrain[near]].tolist())
            proxies = (-1 - ids[ids < 0]) % (PROXY_ORDINAL + 1) == PROXY_ORDINAL
    assert min(shown) > 2
    assert len(levels) > 2  # houses were seen on so many terrain levels
    assert proxies.any()  # from the last place


def test_light_is_seen_under_houses_that_hover(ground: Path) -> None:
    store = ground / "hovering.geopage"
    shutil.copy(ground / "ground.geopage", store)
    houses = write_houses(ground / "houses.geojson")
    with Store(store) as opened:
        surface = Surface(opened)

        def higher(lon: Floats, lat: Floats) -> tuple[Floats, Floats]:
            height_m, error_m = surface.heights(lon, lat)
            return height_m + 4.0, error_m

        ingest_buildings(store, [houses], BuildingOptions(), ground=higher)
    with looking_at(store, 1.0) as session:
        for seen_from, fewest in zip(VIEWS[:3], (100, 100, 1), strict=True):
            view = view_from(session.surface, *seen_from)
            drawn, _ = session.settle(view)
            assert light_under_walls(session, drawn, view).sum() >= fewest


def test_coarser_ground_hides_no_more_of_walls_than_the_threshold(city: Path) -> None:
    with looking_at(city, 4.0) as session:
        for seen_from in VIEWS:
            view = view_from(session.surface, *seen_from)
            drawn, _ = session.settle(view)
            ids, points = session.renderer.read_ids(), session.renderer.read_positions()
            near = beside(ids < 0) & (ids > 0)
            lon, lat, height_m = to_geodetic(Ecef(points[near]))
            over_m = height_m - session.surface.heights(lon, lat)[0]
            depth_m = (points[near] - view.eye) @ view.forward
            assert np.max(over_m * view.focal_px / depth_m) < 4.0
            rows = drawn.terrain[np.unique(ids[near]) - 1]
            records = session.pager.forests[Lane.TERRAIN].records[rows]
            if seen_from[0] >= 3000:
                assert (records["children"] > 0).any()  # coarser than the finest

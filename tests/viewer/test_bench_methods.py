# SPDX-License-Identifier: Apache-2.0
"""Methods of others, built over our tiles: what they draw is what they say."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from geopage.settings import MIB, PagerSettings
from geopage.view import ViewState
from tests.viewer.small_world import LAT_DEG, LON_DEG, make_store
from tiles import cells
from tiles.lanes import Lane
from tiles.mesh import SKIRT, UV_ONE
from tiles.terrain import TerrainTile
from viewer.bench_choices import HOUSE_M, by_faces, by_range
from viewer.bench_meshes import SIDES, error_of, remeshed, stored_bytes
from viewer.bench_methods import METHODS, Method
from viewer.bench_stage import MadeTiles, Remeshed
from viewer.camera import Pose, view_state
from viewer.drawn_surface import holders
from viewer.holes import hole_pixels
from viewer.session import Picture, Session

pytestmark = pytest.mark.usefixtures("gl_context")
SIZE_PX = (96, 64)


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Session]:
    store = make_store(tmp_path_factory.mktemp("hills"))
    settings = PagerSettings(budget_bytes=128 * MIB)
    with Session(store, settings, Picture(SIZE_PX)) as opened:
        yield opened


def view(session: Session, above_m: float, pitch: float = -0.6) -> ViewState:
    lon, lat = np.radians((LON_DEG, LAT_DEG)).tolist()
    height_m = session.surface.height_at(lon, lat) + above_m
    return view_state(Pose(lon, lat, height_m, 0.3, pitch), SIZE_PX)


def own_tile(session: Session, row: int) -> TerrainTile:
    tile = session.tile(Lane.TERRAIN, row)
    assert isinstance(tile, TerrainTile)
    return tile


def some_rows(session: Session) -> list[int]:
    count = len(session.pager.forests[Lane.TERRAIN].records)
    return np.linspace(0, count - 1, 12).astype(int).tolist()


@pytest.mark.parametrize("kind", SIDES)
def test_a_tile_that_is_meshed_anew_fills_its_cell(session: Session, kind: str) -> None:
    for row in some_rows(session):
        tile = remeshed(session.surface, own_tile(session, row), kind, leaf=False)
        triangles = tile.mesh.indices[: tile.surface_index_count].reshape(-1, 3)
        uv = tile.mesh.vertices["detail"].astype(float) / UV_ONE
        a, b, c = np.moveaxis(uv[triangles], 1, 0)
        area = np.linalg.det(np.stack((b - a, c - a), axis=1)) / 2
        assert (area > 0).all()
        assert area.sum() == pytest.approx(1.0)
        hanging = tile.mesh.vertices["flags"] == SKIRT
        on_rim = ((uv == 0) | (uv == 1)).any(axis=1)
        assert hanging.sum() == (on_rim & ~hanging).sum()
        assert stored_bytes(tile) > 0


def test_our_own_tiles_are_measured_as_they_state(session: Session) -> None:
    """The measure of other meshes is that of ours, at fewer places."""
    for row in some_rows(session):
        tile = own_tile(session, row)
        ground_m = tile.error_m / 4  # the tiles two levels finer err so much
        assert error_of(session.surface, tile) <= tile.error_m + ground_m + 0.01


def test_a_grid_states_what_it_errs_and_a_network_only_its_bound(session: Session) -> None:
    worse = 0
    for row in some_rows(session):
        own = own_tile(session, row)
        grid = remeshed(session.surface, own, "grid", leaf=False)
        assert grid.error_m == error_of(session.surface, grid)
        assert grid.surface_index_count == 6 * SIDES["grid"] ** 2
        network = remeshed(session.surface, own, "rtin", leaf=False)
        worse += error_of(session.surface, network) > network.error_m
    assert worse > 0


@pytest.fixture(scope="module")
def grids(session: Session) -> Iterator[Remeshed]:
    path, picture = session.store.path, session.picture
    made = Remeshed(path, session.settings, picture, "grid", session.renderer.gl)
    yield made
    made.close()


def test_a_remeshed_selection_knows_the_error_of_all_that_it_asks(grids: Remeshed) -> None:
    method = next(method for method in METHODS if method.mesh == "grid")
    eye, records = view(grids, 2000.0), grids.pager.forests[Lane.TERRAIN].records
    drawn = grids.draw_list(method, eye, 2.0)
    for row in drawn.terrain.tolist():
        assert records["error_m"][row] == np.float32(grids.made(row).error_m)
    grids.hold(drawn)
    grids.renderer.draw(drawn, eye)
    assert hole_pixels(grids.renderer, eye, float(records["min_height_m"].min())) == 0
    surface = MadeTiles(grids).surface(drawn)
    places = grids.renderer.read_positions().reshape(-1, 3)
    places = places[np.isfinite(places[:, 0])]
    assert (holders(surface, places) >= 0).mean() > 0.99


def test_faces_get_smaller_with_the_threshold_and_cover_the_globe(session: Session) -> None:
    forests, eye = session.pager.forests, view(session, 2000.0)
    counts = []
    for px in (16.0, 4.0, 1.0):
        drawn = by_faces(forests, eye, px)
        cell = forests[Lane.TERRAIN].records["cell"][drawn.terrain]
        first, last = np.sort(cells.range_min(cell)), np.sort(cells.range_max(cell))
        assert (first[1:] == last[:-1] + 2).all()
        counts.append(len(cell))
    assert counts == sorted(counts)
    assert counts[0] < counts[-1]


def test_within_a_range_everything_is_finest_and_beyond_there_is_nothing(
    session: Session,
) -> None:
    forests, eye = session.pager.forests, view(session, 100.0)
    drawn = by_range(forests, eye, 2.0)
    reach_m = HOUSE_M * eye.focal_px / 2.0
    for lane, rows in ((Lane.TERRAIN, drawn.terrain), (Lane.OBJECTS, drawn.objects)):
        forest = forests[lane]
        away_m = np.linalg.norm(forest.centre - eye.eye, axis=1) - forest.radius_m
        assert len(rows) > 0
        assert (away_m[rows] < reach_m).all()
    assert (forests[Lane.TERRAIN].records["children"][drawn.terrain] == 0).all()
    assert not drawn.proxies.any()
    assert len(by_range(forests, view(session, 1e6), 2.0).terrain) == 0


def test_only_what_the_pager_can_fly_is_flown() -> None:
    for method in METHODS:
        assert ("paced" in method.modes) == (not method.choice and not method.mesh)
        assert method.is_ours == (method.name == "geopage")
    strict = next(method for method in METHODS if method.policy == "strict")
    assert strict.settings(16.0, MIB).policy == "strict"
    assert Method("x", "y").modes == ("settled", "paced")


def test_the_store_is_as_it_was(session: Session, grids: Remeshed) -> None:
    """What another mesh errs is noted in its own session alone."""
    assert isinstance(session.store.path, Path)
    one, other = (s.pager.forests[Lane.TERRAIN].records for s in (session, grids))
    assert (one["cell"] == other["cell"]).all()
    assert (one["error_m"] != other["error_m"]).any()
    assert (one["error_m"] == session.surface.forest.records["error_m"]).all()

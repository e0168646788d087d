# SPDX-License-Identifier: Apache-2.0
"""The eye is never below or inside of what is drawn."""

from dataclasses import replace

import numpy as np
import pytest

from tests.geopage.worlds import globe_cells, terrain_records
from tests.viewer.conftest import Make
from tests.viewer.worlds import World, make_world, one_colour, terrain_tile, whole_list
from tiles import cells, geodesy
from tiles.forest import Forest, build_forest
from tiles.frames import Ecef
from tiles.lanes import Lane
from viewer.camera import Pose, view_state
from viewer.clearance import ABOVE_M, LEAN, Clearance, Drawn, above_m
from viewer.draw_record import INSTANCE_FLOATS
from viewer.slots import make_slots

LON, LAT = 0.3, 0.7
STEP, DEPTH, ENTRY, LEANING = 3, 7, 12, 14
SKIRT_M = 100.0
GROUND_M, ERROR_M, FINE_M = 1000.0, 400.0, 5.0


def world() -> tuple[Forest, np.ndarray]:
    """Two levels of the globe; relief up to 1,000 m above the ellipsoid."""
    records = terrain_records(globe_cells(2))
    records["max_height_m"] = GROUND_M
    inner = cells.level(records["cell"]) == 0
    records["error_m"] = np.where(inner, ERROR_M, FINE_M)
    slots = make_slots(len(records))
    slots["box_rad"] = np.stack(cells.bounds_rad(build_forest(records).records["cell"]), 1)
    return build_forest(records), slots


def draws(forest: Forest, rows: np.ndarray, eye: Ecef) -> np.ndarray:
    """Records of draws as `cull_terrain` writes them."""
    found = np.zeros((len(rows), INSTANCE_FLOATS), np.float32)
    found[:, :3] = forest.centre[rows] - eye
    found[:, 4:7] = (
        forest.centre[rows] / np.linalg.norm(forest.centre[rows], axis=1)[:, None]
    )
    found[:, STEP], found[:, DEPTH], found[:, LEANING] = 0.1, SKIRT_M, LEAN
    found[:, ENTRY] = np.arange(len(rows))
    return found


class Known(Clearance):
    """One whose tiles are all as far above the eye as stated."""

    def __init__(self, down_m: float) -> None:
        self._meshes, self.known_m = {}, down_m

    def _down_m(self, *_: object) -> float:
        return self.known_m


def kept_clear(
    rows: np.ndarray, place: tuple[float, float, float], down_m: float = 300.0
) -> tuple[np.ndarray, np.ndarray]:
    """Return the records, and how far each sank."""
    forest, slots = world()
    before = draws(forest, rows, geodesy.to_ecef(*place))
    after, up = before.copy(), geodesy.up(*place[:2])
    drawn = Drawn(rows.astype(np.int32), slots, forest.records, forest.children)
    sunk_m = Known(down_m).apply(after, drawn, place)
    moved = (before[:, :3] - after[:, :3]) @ up
    assert sunk_m == pytest.approx(moved.max(initial=0.0), abs=1.0)
    assert np.allclose(after[:, DEPTH] - SKIRT_M, sunk_m, atol=1.0)
    return after, moved


def rows_at(level: int) -> np.ndarray:
    forest, _ = world()
    return np.flatnonzero(cells.level(forest.records["cell"]) == level)


def row_at(rows: np.ndarray, lon: float, lat: float) -> int:
    """Entry of the draw that holds a place."""
    forest, _ = world()
    cell = forest.records["cell"][rows]
    return int(np.flatnonzero(cells.contains(cell, cells.cell_at(lon, lat, 9)))[0])


def test_a_stand_in_that_holds_the_eye_sinks_alone() -> None:
    rows = rows_at(0)
    entry = row_at(rows, LON, LAT)
    _, moved = kept_clear(rows, (LON, LAT, 100.0))
    assert moved[entry] == pytest.approx(300.0, abs=1.0)
    assert (np.delete(moved, entry) == 0).all()


def test_nothing_sinks_under_an_eye_above_all_ground() -> None:
    _, moved = kept_clear(rows_at(0), (LON, LAT, GROUND_M + 1.0))
    assert (moved == 0).all()


def test_how_far_a_mesh_is_above_the_eye(rng: np.random.Generator) -> None:
    """A plane over a square around the eye, in many triangles."""
    at = np.stack(np.meshgrid(*[np.linspace(-7.0, 9.0, 9)] * 2), -1).reshape(-1, 2)
    slope = rng.normal(size=2)
    points = np.column_stack([at, at @ slope + 3.5])
    i = np.arange(81).reshape(9, 9)
    low, high = i[:-1, :-1].ravel(), i[1:, 1:].ravel()
    east, north = i[:-1, 1:].ravel(), i[1:, :-1].ravel()
    corners = np.concatenate(
        [np.stack([low, east, high], 1), np.stack([low, high, north], 1)]
    ).astype(np.uint16)
    assert above_m(points, corners) == pytest.approx(3.5)
    assert above_m(points - (100.0, 0, 0), corners) == -np.inf
    assert above_m(points, corners[:, ::-1].copy()) == -np.inf


def test_the_finest_tiles_stay_where_they_are() -> None:
    _, moved = kept_clear(rows_at(1), (LON, LAT, 10.0))
    assert (moved == 0).all()


@pytest.mark.parametrize("away_m", [3.0, 10.0, 60.0, 150.0, 1000.0])
def test_a_skirt_ends_before_an_eye_that_is_beside_the_tile(away_m: float) -> None:
    """Just west of a meridian between two leaves."""
    edge = np.pi / 8
    place = edge - away_m / (6.37e6 * np.cos(LAT)), LAT, 10.0
    rows = rows_at(1)
    after, moved = kept_clear(rows, place)
    own, other = row_at(rows, *place[:2]), row_at(rows, edge + 0.01, LAT)
    assert after[own, LEANING] == LEAN
    reach_m = after[other, LEANING] * after[other, DEPTH]
    assert reach_m == pytest.approx(min(LEAN * SKIRT_M, 0.5 * away_m), rel=0.02)
    assert (moved == 0).all()


def test_skirts_lean_all_the_way_when_the_eye_is_above() -> None:
    place = np.pi / 8 - 1e-7, LAT, GROUND_M + 1.0
    after, moved = kept_clear(rows_at(1), place)
    assert (after[:, LEANING] == np.float32(LEAN)).all()
    assert (moved == 0).all()


def test_a_neighbour_whose_edge_is_rounded_across_the_eye_sinks() -> None:
    place = np.pi / 8 - 1e-8, LAT, 10.0
    rows = rows_at(1)
    _, moved = kept_clear(rows, place)
    assert moved[row_at(rows, np.pi / 8 + 0.01, LAT)] == pytest.approx(300.0, abs=1)
    assert (moved > 0).sum() == 1


@pytest.mark.parametrize("stands_m", [-500.0, 300.0, 700.0])
def test_the_eye_sees_a_stand_in_from_above(make_renderer: Make, stands_m: float) -> None:
    """A zone at a height above the eye or below it, with finer tiles in the index."""
    cell = int(cells.cell_at(LON, LAT, 0))

    def height(lon: np.ndarray, lat: np.ndarray) -> np.ndarray:
        return np.full(np.broadcast(lon, lat).shape, 100.0 + stands_m)

    made = terrain_tile(cell, one_colour((99, 99, 99)), 65, height)
    whole = make_world([made])
    records = terrain_records(globe_cells(2))
    records["max_height_m"], records["error_m"] = 3000.0, 5000.0
    forest = build_forest(records)
    row = int(forest.row_of(cell))
    forests = {**whole.forests, Lane.TERRAIN: forest}
    renderer = make_renderer(World(forests, {row: made}, {}))
    view = view_state(Pose(LON, LAT, 100.0, 0.0, -np.pi / 2), (320, 240))
    drawn = replace(whole_list(whole, view), terrain=np.array([row], np.int32))
    renderer.draw(drawn, view)
    assert (renderer.read_ids() == 1).all()
    away_m = np.linalg.norm(renderer.read_positions()[120, 160] - view.eye)
    sagitta_m = 1200.0
    if stands_m > 0:
        assert away_m == pytest.approx(ABOVE_M, abs=0.1)
    else:
        assert -stands_m - 1 < away_m < -stands_m + sagitta_m

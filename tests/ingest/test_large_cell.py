# SPDX-License-Identifier: Apache-2.0
"""A large cell's lattice misses summits; where it does, its mesh is mended."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import trimesh

from ingest import terrain_build, terrain_pyramid
from ingest.large_cell import mended
from ingest.terrain import ingest_rasters
from ingest.terrain_mesh import Surface
from tests.ingest.rasters import ELLIPSOID, Floats, ecef, north_up, write
from tiles import cells, geodesy, terrain
from tiles.check import warnings_of
from tiles.lanes import Lane
from tiles.store import Store

SIDE, STEP, WEST, NORTH = 500, 0.01, 10.0, 48.0
PEAKS, WIDE = 60, 2.5


class Peaked(NamedTuple):
    """A store of a plain with peaks a few posts wide."""

    store: Path
    peaks: Floats
    """(n, 3) ECEF m"""
    mended: dict[int, float]
    """The cells that were mended, with the error that came of it"""


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Peaked:
    folder, rng = tmp_path_factory.mktemp("peaks"), np.random.default_rng(11)
    posts = np.zeros((SIDE, SIDE), np.float32)
    row, col = rng.integers(20, SIDE - 20, (2, PEAKS))
    y, x = np.mgrid[:SIDE, :SIDE]
    for r, c, height_m in zip(row, col, rng.uniform(3000, 5000, PEAKS), strict=True):
        far = ((y - r) ** 2 + (x - c) ** 2) / (2 * WIDE**2)
        posts = np.maximum(posts, height_m * np.exp(-far).astype(np.float32))
    path = write(folder / "peaks.tif", posts, north_up(WEST, NORTH, STEP), "EPSG:4326")
    lon, lat = WEST + (col + 0.5) * STEP, NORTH - (row + 0.5) * STEP
    found = {}

    def seen(cell: int, *rest: object) -> tuple[Surface, float]:
        surface, error_m = mended(cell, *rest)  # type: ignore[arg-type]
        found[cell] = error_m
        return surface, error_m

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(terrain_build, "PART_LEAVES", 8)
        patch.setattr(terrain_pyramid, "mended", seen)
        ingest_rasters(folder / "a.geopage", [(path, ELLIPSOID)], workers=1)
    return Peaked(folder / "a.geopage", ecef(lon, lat, posts[row, col]), found)


def test_lattices_miss_peaks_and_are_mended(world: Peaked) -> None:
    assert world.mended
    for cell, error_m in world.mended.items():
        bound_m = min(float(geodesy.cell_edge_m(cell)) / 256, 3000.0)
        assert error_m <= bound_m * (1 + 1e-9)


def test_no_inner_cell_states_more_than_its_bound(world: Peaked) -> None:
    with Store(world.store) as store:
        assert list(warnings_of(store)) == []


def test_every_peak_is_within_the_error_that_a_mended_tile_states(world: Peaked) -> None:
    """Shortest distances, by trimesh, to the triangles as they are stored."""
    with Store(world.store) as store:
        index = store.index(Lane.TERRAIN)
        for record in index[np.isin(index["cell"], list(world.mended))]:
            west, south, east, north = cells.bounds_rad(record["cell"])
            lon, lat, _ = geodesy.to_geodetic(world.peaks)
            inside = (lon > west) & (lon < east) & (lat > south) & (lat < north)
            assert inside.any()
            row, check = int(record["row"]), int(record["check"])
            body = store.checked_body(Lane.TERRAIN, int(record["cell"]), row, check)
            tile = terrain.decode(body)
            mesh = trimesh.Trimesh(tile.mesh.local, tile.surface(), process=False)
            places = world.peaks[inside] - tile.mesh.centre
            far_m = trimesh.proximity.closest_point_naive(mesh, places)[1]
            assert far_m.max() <= record["error_m"] <= 1.0001 * bound_m_of(record)


def bound_m_of(record: np.void) -> float:
    return float(min(geodesy.cell_edge_m(record["cell"]) / 256, 3000.0))

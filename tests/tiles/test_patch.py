# SPDX-License-Identifier: Apache-2.0
"""Heights on one tile's triangles, at a pole as elsewhere, are those of what is drawn."""

import numpy as np
import pytest

from ingest.terrain_mesh import Places
from tests.ingest.rasters import build_surface
from tiles import cells, geodesy
from tiles.frames import Floats
from tiles.mesh import UV_ONE
from tiles.patch import heights_on, patch_of
from tiles.terrain import TEXTURE_BYTES, TerrainTile

CORNERS = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])


def four_corners(cell: int, height_m: Floats) -> TerrainTile:
    """Return a tile of a cell's corners alone: south-west, south-east, north-east, ..."""
    west, south, east, north = (float(side) for side in cells.bounds_rad(cell))
    u, v = CORNERS.T
    points = geodesy.to_ecef(
        west + u * (east - west), south + v * (north - south), height_m
    )
    surface = build_surface(cell, Places.of(CORNERS * UV_ONE, points), 1.0)
    texture = np.zeros(TEXTURE_BYTES, np.uint8)
    return TerrainTile(cell, surface.mesh, 3 * len(surface.shown[0]), 1.0, 0.0, texture)


def struck_m(tile: TerrainTile, lon: Floats, lat: Floats) -> Floats:
    """Return where upright lines meet a tile's triangles, by Cramer's rule; NaN nowhere."""
    foot = np.asarray(geodesy.to_ecef(lon, lat, np.zeros_like(lon))) - tile.mesh.centre
    found = np.full(len(lon), np.nan)
    for a, b, c in tile.mesh.local[tile.surface()]:
        for i, up in enumerate(geodesy.up(lon, lat)):
            sides = np.stack([b - a, c - a, -up], axis=1)
            if abs(np.linalg.det(sides)) > 1.0:
                s, t, height_m = np.linalg.solve(sides, foot[i] - a)
                if min(s, t, 1 - s - t) > -1e-6:
                    found[i] = height_m
    return found


@pytest.mark.parametrize("lat_deg", [89.99, -89.99, 40.0])
def test_heights_are_those_where_an_upright_line_meets_what_is_drawn(
    lat_deg: float, rng: np.random.Generator
) -> None:
    cell = int(cells.cell_at(0.1, np.radians(lat_deg), 8))
    at_pole = {89.99: [0, 0, 1, 1], -89.99: [1, 1, 0, 0], 40.0: [0, 0, 0, 0]}[lat_deg]
    height_m = np.where(at_pole, 500.0, [0.0, 3000.0, 2000.0, 1000.0])
    tile = four_corners(cell, height_m)
    assert len(tile.surface()) == (2 if lat_deg == 40.0 else 1)
    west, south, east, north = (float(side) for side in cells.bounds_rad(cell))
    lon, lat = rng.uniform(west, east, 200), rng.uniform(south, north, 200)
    height_m, expected = np.empty(200), struck_m(tile, lon, lat)
    heights_on(patch_of(tile), lon, lat, height_m)
    seen = np.isfinite(expected)
    assert seen.mean() > 0.95
    # Of a cell as large, parallels and meridians are no straight lines: a few metres.
    assert np.abs(height_m - expected)[seen].max() < 10.0

# SPDX-License-Identifier: Apache-2.0
"""Cells where a bound is hard to keep: it is kept all the same."""

from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from rasterio.transform import Affine

from ingest.fitting import fitted
from ingest.truth import places_of, truth_of
from tests.ingest.rasters import ELLIPSOID, between, hills, mosaic_of, pixels, write
from tiles import cells, geodesy

SIDE, STEP_M = 140, 1000.0
BOUND_M = STEP_M / 100


@pytest.mark.parametrize("lon_deg", [91.0, -136.0])
def test_a_leaf_at_a_pole_keeps_its_bound_on_a_polar_grid(
    lon_deg: float, tmp_path: Path, rng: np.random.Generator
) -> None:
    """The drawn triangles' own points are held against the file's triangles."""
    posts = hills((SIDE, SIDE), 1.0, 300.0) + rng.normal(0, 150, (SIDE, SIDE)).astype("f4")
    half = SIDE * STEP_M / 2
    where = Affine(STEP_M, 0, -half, 0, -STEP_M, half)
    file = write(tmp_path / "cap.tif", posts, where, "EPSG:3413")
    cell = int(cells.cell_at(np.radians(lon_deg), np.radians(89.9), 5))
    mosaic, connection = mosaic_of(tmp_path / "a.geopage", [(file, ELLIPSOID)])
    with closing(connection):
        truth = truth_of(mosaic, cell, 45)
        surface, error_m = fitted(cell, places_of(truth), BOUND_M, [truth], leaf=True)
    assert error_m <= BOUND_M
    assert 50 < len(surface.triangles) < 3 * len(places_of(truth).at)
    corner = surface.points[surface.triangles] + surface.centre
    weights = rng.dirichlet(np.ones(3), (len(corner), 12))
    drawn = (weights @ corner).reshape(-1, 3)
    lon, lat, height_m = geodesy.to_geodetic(drawn)
    col, row = pixels(file, np.degrees(lon), np.degrees(lat))
    gap_m = np.abs(height_m - between(posts.astype(float), col, row))
    inside = np.isfinite(gap_m)
    assert inside.sum() > 500
    assert gap_m[inside].max() <= 1.2 * error_m

# SPDX-License-Identifier: Apache-2.0
"""No post lies outside the bounds of its raster; beyond a map's edge there is none."""

from pathlib import Path

import numpy as np
import pyproj
import pytest
import rasterio

from ingest.dem import describe
from ingest.mosaic import Mosaic
from ingest.raster_plan import plan
from ingest.terrain import copy, editing
from tests.ingest.rasters import (
    ELLIPSOID,
    Floats,
    hills,
    north_up,
    source_height_m,
    write,
)
from tiles.errors import InputError

CONTINENTS = {
    "Europe": ("EPSG:3034", 2.02e6, 5.2e6, 50_000, 40_000),
    "North America": ("EPSG:5070", -2.38e6, 3.2e6, 47_000, 29_500),
    "Greenland": ("EPSG:3413", -6.9e5, -6e5, 16_000, 28_000),
    "Arctic": ("EPSG:3413", -3e6, 3e6, 60_000, 60_000),
}
STEP_M = 100.0
MOLLWEIDE = "+proj=moll +datum=WGS84"
GLOBES = {
    MOLLWEIDE: 18_040_096.0,
    "+proj=sinu +datum=WGS84": 20_015_109.0,
    "+proj=robin +datum=WGS84": 17_005_833.0,
    "+proj=eqearth +lon_0=150 +datum=WGS84": 17_243_959.0,
}


def beyond_m(path: Path, x: Floats, y: Floats) -> Floats:
    """Return how far outside a file's bounds its posts at x, y are, (n,) m."""
    with rasterio.open(path) as dataset:
        info = describe(path, dataset, None)
    crs = pyproj.CRS.from_wkt(info.crs)
    turn = pyproj.Transformer.from_crs(crs, 4326, always_xy=True)
    lon, lat = turn.transform(x, y)
    there = np.isfinite(lon)
    lon, lat = lon[there], lat[there]
    back = turn.transform(lon, lat, direction="INVERSE")
    same = np.hypot(back[0] - x[there], back[1] - y[there]) < 1.0
    lon, lat = lon[same], lat[same]
    assert len(lon) > len(x) / 2
    west, south, east, north = info.bounds_deg
    off = np.abs((lon - (west + east) / 2 + 180) % 360 - 180) - (east - west) / 2
    outside = np.stack([off * np.cos(np.radians(lat)), lat - north, south - lat])
    return np.asarray(111e3 * outside.max(axis=0))


@pytest.mark.parametrize("name", CONTINENTS)
def test_all_posts_of_a_continent_lie_in_its_bounds(name: str, tmp_path: Path) -> None:
    """Its sides are curved on the earth: 41 places along each left out up to 300 m."""
    crs, west, north, width, height = CONTINENTS[name]
    profile = {"driver": "GTiff", "width": width, "height": height, "count": 1}
    profile |= {"dtype": "int16", "crs": crs, "sparse_ok": True, "tiled": True}
    profile |= {"blockxsize": 4096, "blockysize": 4096}
    where = north_up(west, north, STEP_M)
    with rasterio.open(tmp_path / "a.tif", "w", **profile, transform=where):
        pass
    cols, rows = (STEP_M * (np.arange(n) + 0.5) for n in (width, height))
    x = west + np.concatenate([cols, cols, 0 * rows + cols[0], 0 * rows + cols[-1]])
    y = north - np.concatenate([0 * cols + rows[0], 0 * cols + rows[-1], rows, rows])
    assert beyond_m(tmp_path / "a.tif", x, y).max() <= 0.0


@pytest.mark.parametrize("crs", GLOBES)
def test_all_posts_of_a_globe_lie_in_its_bounds(crs: str, tmp_path: Path) -> None:
    """Its sides and corners have no place."""
    step_m = GLOBES[crs] / 100.3
    where = north_up(-GLOBES[crs], 41 * step_m, step_m)
    write(tmp_path / "a.tif", hills((75, 201), 1.0, 100.0), where, crs)
    col, row = np.meshgrid(np.arange(201) + 0.5, np.arange(75) + 0.5)
    x, y = where.c + step_m * col.ravel(), where.f - step_m * row.ravel()
    assert beyond_m(tmp_path / "a.tif", x, y).max() <= 0.0


def test_a_globe_is_as_its_file_up_to_the_edge_of_the_map(
    tmp_path: Path, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Along the earth, as here; flat triangles have a test of their own.
    monkeypatch.setattr("ingest.layer.CURVED_M", np.inf)
    half, step_m = GLOBES[MOLLWEIDE], GLOBES[MOLLWEIDE] / 100.3
    posts, where = hills((91, 201), 1.0, 100.0), north_up(-half, half / 2.2, step_m)
    path = write(tmp_path / "a.tif", posts, where, MOLLWEIDE)
    x = where.c + step_m * (np.arange(201) + 0.5)
    y = where.f - step_m * (np.arange(91)[:, None] + 0.5)
    on_map = (x / half) ** 2 + (2 * y / half) ** 2 <= 1
    with editing(tmp_path / "a.geopage") as writer:
        source = copy(writer, plan(path, ELLIPSOID), lambda done, total, what: None)
        lon, lat = 180 - rng.exponential(8, 400), rng.uniform(-60, 60, 400)
        lon *= rng.choice((-1, 1), 400)
        found = (
            Mosaic(writer.connection, [source])
            .layers[0]
            .heights(np.radians(lon), np.radians(lat), 0.0)
        )
    beyond = on_map.size - np.count_nonzero(on_map)
    assert source["posts"]["skipped"] == {"beyond the edge of its map": beyond}
    truth = source_height_m(path, lon, lat)
    known = np.isfinite(found)
    np.testing.assert_allclose(found[known], truth[known], atol=1e-3)
    # Unknown only where one of the posts around has no place.
    x, y = pyproj.Transformer.from_crs(4326, MOLLWEIDE, always_xy=True).transform(lon, lat)
    inside = ((np.abs(x) + step_m) / half) ** 2 + ((np.abs(y) + step_m) * 2 / half) ** 2 < 1
    assert known[inside].all()
    assert 50 < np.count_nonzero(known & (np.abs(lon) > 170)) < np.count_nonzero(known)


@pytest.mark.parametrize("centre", [40, 0])
def test_a_map_of_half_the_globe_is_refused(centre: int, tmp_path: Path) -> None:
    crs = f"+proj=ortho +lat_0={centre} +lon_0=10 +datum=WGS84"
    where = north_up(-6.35e6, 6.3e6, 1.05e5)
    path = write(tmp_path / "a.tif", hills((120, 120), 1.0, 100.0), where, crs)
    with pytest.raises(InputError, match=r"a\.tif: .*map.*; .*(gdalwarp|--crs)"):
        plan(path, ELLIPSOID)

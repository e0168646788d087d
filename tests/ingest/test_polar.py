# SPDX-License-Identifier: Apache-2.0
from pathlib import Path

import numpy as np
import pytest

from ingest.drape import SHARE, drape
from ingest.layer import Layer
from ingest.polar import FROM_RAD, is_polar, lon_at, texel_lattice
from ingest.relief import lattice_slopes
from ingest.terrain import RasterOptions, editing, plan
from ingest.terrain import copy as copy_source
from tests.ingest.rasters import north_up, write
from tiles import cells
from tiles.frames import WGS84_A_M
from tiles.terrain import TEXTURE_SIDE

POLAR = [(level, lat) for level in (0, 1, 4) for lat in (89.99, -89.99)]


def cell_of(level: int, lat_deg: float) -> int:
    return int(cells.cell_at(np.radians(20.0), np.radians(lat_deg), level))


@pytest.mark.parametrize(("level", "lat_deg"), [*POLAR, (1, 50.0), (3, 70.0), (9, -89.5)])
def test_texels_near_a_pole_are_never_much_narrower_than_high(
    level: int, lat_deg: float
) -> None:
    cell = cell_of(level, lat_deg)
    west, south, east, north = (float(edge) for edge in cells.bounds_rad(cell))
    lat = south + (np.arange(TEXTURE_SIDE) + 0.5) / TEXTURE_SIDE * (north - south)
    u = 0.5 + np.array([[-0.5], [0.5]]) / TEXTURE_SIDE
    lon = lon_at(cell, u, lat)
    across = (lon[1] - lon[0]) * np.cos(lat) / ((north - south) / TEXTURE_SIDE)
    assert is_polar(cell)
    # The last texels at a pole would span more than a cell beside it.
    assert across[2:-2].min() > 0.7
    assert across.max() < 1.01
    np.testing.assert_allclose(lon.mean(axis=0), (west + east) / 2, rtol=1e-12)


def test_texels_elsewhere_divide_the_longitudes_evenly() -> None:
    for level, lat_deg in ((2, 40.0), (7, -44.99), (1, 0.0)):
        cell = cell_of(level, lat_deg)
        west, _, east, _ = (float(edge) for edge in cells.bounds_rad(cell))
        u = np.array([0.0, 0.25, 1.0])
        assert not is_polar(cell)
        assert (lon_at(cell, u, np.zeros(3)) == west + u * (east - west)).all()


def test_an_edge_of_a_cell_is_a_straight_line_in_its_texture() -> None:
    for level, lat_deg in POLAR:
        cell = cell_of(level, lat_deg)
        west, south, east, north = (float(edge) for edge in cells.bounds_rad(cell))
        edge = np.abs(np.array([south, north])).min()
        part = np.linspace(0.0, 0.9, 7)
        lat = np.sign(south + north) * (edge + part * (north - south))
        away = 0.5 * (np.pi / 2 - np.abs(lat)) / (np.pi / 2 - FROM_RAD)
        np.testing.assert_allclose(lon_at(cell, 0.5 - away, lat), west, atol=1e-12)
        np.testing.assert_allclose(lon_at(cell, 0.5 + away, lat), east, atol=1e-12)


@pytest.mark.parametrize(("level", "lat_deg"), [(2, 75.0), (5, 85.0), (9, -70.0)])
def test_slopes_of_a_leaning_lattice_are_those_of_the_ground(
    level: int, lat_deg: float
) -> None:
    cell = cell_of(level, lat_deg)
    lon, lat = texel_lattice(cell, 64)
    heights = 1e5 * (lon + 2.0 * lat)
    found = lattice_slopes(lon, lat, heights)
    inner = lat[1:-1, 1:-1]
    east, north = -1e5 / (WGS84_A_M * np.cos(inner)), np.full_like(inner, -2e5 / WGS84_A_M)
    # Columns far out are held back beside a pole.
    seen = np.s_[1:-1, 16:-16]
    np.testing.assert_allclose(found[seen][..., 0], east[seen], rtol=1e-6)
    np.testing.assert_allclose(found[seen][..., 1], north[seen], rtol=0.02)


def test_a_texel_is_the_mean_of_what_a_narrow_picture_has_there(tmp_path: Path) -> None:
    """Near a pole, pixels of a picture in degrees are narrower than texels."""
    stripes = np.zeros((3, 360, 720), np.uint8)
    stripes[:, :, ::2], stripes[:, :, 1::2] = 60, 180
    file = write(tmp_path / "stripes.tif", stripes, north_up(-180, 90, 0.5), "EPSG:4326")
    with editing(tmp_path / "world.geopage") as writer:
        planned = plan(file, RasterOptions("imagery"))
        layer = Layer(writer.connection, copy_source(writer, planned, lambda *_: None))
        shown = drape(cell_of(0, 89.0), [layer])
    seen = shown[-20:, 100:156, 0] / shown[-20:, 100:156, SHARE]
    assert seen.std() < 8.0  # of single samples: 34

# SPDX-License-Identifier: Apache-2.0
"""The measured deviation is never less than what brute force finds, nor absurdly more."""

import sqlite3
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from ingest.deviation import deviation_m, overlay_deviation_m
from ingest.layer import Layer
from ingest.terrain import RasterOptions, editing, plan
from ingest.terrain import copy as copy_source
from ingest.terrain_mesh import Surface, build_surface, lattice_of, lattice_places
from tests.ingest.rasters import (
    EGM96,
    UTM,
    Floats,
    geoid_m,
    hills,
    north_up,
    source_height_m,
    write,
)
from tiles import cells, geodesy
from tiles.frames import Ecef

PLACE = np.radians(11.3), np.radians(46.2)


def layer_of(
    path: Path, options: RasterOptions = EGM96
) -> tuple[Layer, sqlite3.Connection]:
    """Copy a file into a new store and open it as a layer."""
    with editing(path.with_suffix(".geopage")) as writer:
        source = copy_source(writer, plan(path, options), lambda done, total, what: None)
    connection = sqlite3.connect(path.with_suffix(".geopage"))
    return Layer(connection, source), connection


def surface_of(level: int, side: int, bound_m: float, seed: int) -> Surface:
    cell = int(cells.cell_at(*PLACE, level))
    lon, lat = lattice_places(cell, side)
    noise = np.random.default_rng(seed).normal(800, 60, lon.shape)
    lattice = lattice_of(cell, lon, lat, noise)
    return build_surface(lattice, np.zeros(lon.shape, np.bool_), bound_m)


def drawn(surface: Surface, uv: Floats) -> Floats:
    """Points of a surface's triangles at fractions of its cell, by brute force, ECEF."""
    out = np.full((len(uv), 3), np.nan)
    for triangle in surface.triangles:
        a, b, c = surface.uv[triangle]
        weights = np.linalg.solve(np.stack([b - a, c - a]).T, (uv - a).T).T
        weights = np.column_stack([1 - weights.sum(axis=1), weights])
        inside = (weights >= -1e-12).all(axis=1)
        out[inside] = weights[inside] @ surface.points[triangle]
    return out + surface.mesh.centre


def lattice_point(truth: Ecef, uv: Floats) -> Floats:
    """Points of a lattice joined by triangles, diagonal from south-west to north-east."""
    last = truth.shape[0] - 1
    at = uv * last
    c, r = np.minimum(at.astype(int), last - 1).T
    fx, fy = (at - np.stack([c, r], axis=1)).T[..., None]
    sw, se, nw, ne = truth[r, c], truth[r, c + 1], truth[r + 1, c], truth[r + 1, c + 1]
    lower = sw + fx * (se - sw) + fy * (ne - se)
    upper = sw + fy * (nw - sw) + fx * (ne - nw)
    return np.asarray(np.where(fx > fy, lower, upper))


@pytest.mark.parametrize("bound_m", [10.0, 60.0])
def test_a_lattice_deviation_bounds_random_samples(
    bound_m: float, rng: np.random.Generator
) -> None:
    surface = surface_of(10, 8, bound_m, 1)
    finer = lattice_places(int(cells.cell_at(*PLACE, 10)), 20)
    truth = geodesy.to_ecef(*finer, rng.normal(800, 60, finer[0].shape))
    found = deviation_m(surface, (0.0, 0.0, 1.0), truth)
    uv = rng.uniform(size=(10_000, 2))
    gap = np.linalg.norm(drawn(surface, uv) - lattice_point(truth, uv), axis=1)
    assert gap.max() <= found
    assert found < 1.6 * gap.max()


def test_a_lattice_of_the_surface_itself_deviates_by_its_rounding_only() -> None:
    cell = int(cells.cell_at(*PLACE, 12))
    lon, lat = lattice_places(cell, 4)
    lattice = lattice_of(cell, lon, lat, np.linspace(0, 500, 25).reshape(5, 5) ** 1.1)
    surface = build_surface(lattice, np.zeros((5, 5), np.bool_), 0.0)
    at_posts = np.linalg.norm(
        drawn(
            surface, np.stack(np.meshgrid(*2 * [np.linspace(0, 1, 5)]), -1).reshape(-1, 2)
        )
        - lattice.points.reshape(-1, 3),
        axis=1,
    )
    assert at_posts.max() <= surface.mesh.scale_m


def test_a_window_of_the_cell_is_measured_where_it_lies(rng: np.random.Generator) -> None:
    surface = surface_of(10, 8, 20.0, 2)
    child = int(cells.children(int(cells.cell_at(*PLACE, 10)))[3])  # north-east
    lon, lat = lattice_places(child, 8)
    truth = geodesy.to_ecef(lon, lat, rng.normal(800, 60, lon.shape))
    found = deviation_m(surface, (0.5, 0.5, 0.5), truth)
    uv = rng.uniform(size=(4000, 2))
    gap = drawn(surface, 0.5 + uv / 2) - lattice_point(truth, uv)
    most = np.linalg.norm(gap, axis=1).max()
    assert most <= found < 1.6 * most


def overlay_gaps(
    path: Path, layer: Layer, surface: Surface, cell: int, uv: Floats
) -> tuple[float, NDArray[np.float64]]:
    """Return the measured overlay deviation, and the gaps at places of the cell."""
    west, south, east, north = cells.bounds_rad(cell)
    span = np.array([east - west, north - south])
    lon_lat = np.array([west, south]) + surface.uv * span
    found = overlay_deviation_m(surface, layer, lon_lat)
    assert found is not None
    place = np.array([west, south]) + uv * span
    lon_deg, lat_deg = np.degrees(place).T
    height = source_height_m(path, lon_deg, lat_deg) + geoid_m(lon_deg, lat_deg)
    gap = drawn(surface, uv) - geodesy.to_ecef(*place.T, height)
    return found, np.linalg.norm(gap, axis=1)


@pytest.mark.parametrize("crs", ["EPSG:4326", UTM])
def test_an_overlay_deviation_bounds_random_samples(
    crs: str, tmp_path: Path, rng: np.random.Generator
) -> None:
    posts = hills((90, 110), 1.0, 200.0)
    where = north_up(11.0, 46.5, 0.005)
    if crs == UTM:
        where = north_up(660_000.0, 5_150_000.0, 500.0)
    path = write(tmp_path / "dem.tif", posts, where, crs)
    layer, connection = layer_of(path)
    for level, bound_m in ((10, 30.0), (11, 5.0), (12, 1.0), (14, 0.1)):
        cell = int(cells.cell_at(*PLACE, level))
        lon, lat = lattice_places(cell, 16)
        heights = layer.heights(lon.ravel(), lat.ravel(), 0.0).reshape(lon.shape)
        lattice = lattice_of(cell, lon, lat, heights)
        surface = build_surface(lattice, np.zeros(lon.shape, np.bool_), bound_m)
        uv = rng.uniform(size=(10_000, 2))
        found, gap = overlay_gaps(path, layer, surface, cell, uv)
        assert gap.max() <= found
        assert found < 1.3 * gap.max() + 0.1
    connection.close()


def test_an_overlay_counts_the_bend_of_a_wide_projection(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    """A coarse raster far from its projection's middle: edges bend by parts of a post."""
    posts = np.zeros((70, 70), np.float32)
    posts[:, ::2] = 3000.0
    where = north_up(3_900_000.0, 3_400_000.0, 20_000.0)
    path = write(tmp_path / "wide.tif", posts, where, "EPSG:3035")
    layer, connection = layer_of(path, RasterOptions(datum="ellipsoid"))
    cell = int(cells.cell_at(np.radians(14.0), np.radians(47.0), 3))
    lon, lat = lattice_places(cell, 16)
    heights = layer.heights(lon.ravel(), lat.ravel(), 0.0).reshape(lon.shape)
    lattice = lattice_of(cell, lon, lat, heights)
    surface = build_surface(lattice, np.zeros(lon.shape, np.bool_), 500.0)
    west, south, east, north = cells.bounds_rad(cell)
    lon_lat = np.array([west, south]) + surface.uv * [east - west, north - south]
    found = overlay_deviation_m(surface, layer, lon_lat)
    uv = rng.uniform(size=(10_000, 2))
    place = np.array([west, south]) + uv * [east - west, north - south]
    height = source_height_m(path, *np.degrees(place).T)
    assert np.isfinite(height).all()
    gap = drawn(surface, uv) - geodesy.to_ecef(*place.T, height)
    assert found is not None
    assert np.linalg.norm(gap, axis=1).max() <= found
    connection.close()


def test_an_overlay_beyond_the_source_is_not_measured(tmp_path: Path) -> None:
    path = write(
        tmp_path / "dem.tif",
        hills((20, 20), 1, 50),
        north_up(11.0, 46.5, 0.01),
        "EPSG:4326",
    )
    layer, connection = layer_of(path)
    surface = surface_of(8, 8, 10.0, 3)
    west, south, east, north = cells.bounds_rad(int(cells.cell_at(*PLACE, 8)))
    lon_lat = np.array([west, south]) + surface.uv * [east - west, north - south]
    assert overlay_deviation_m(surface, layer, lon_lat) is None
    connection.close()

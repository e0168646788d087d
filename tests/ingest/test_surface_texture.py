# SPDX-License-Identifier: Apache-2.0
"""Tiles show the pictures where they are opaque, and tint and relief where none is."""

import sqlite3
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import pytest
import rasterio
from numpy.typing import NDArray
from rasterio.enums import ColorInterp

from ingest.coast import KNOWN, SURE
from ingest.drape import CLEAR, COARSE_M, SHARE, drape, parts_under
from ingest.layer import Layer
from ingest.relief import lattice_slopes, steeper_of
from ingest.surface_texture import colours, texel_m_of
from ingest.terrain import RasterOptions, editing, plan
from ingest.terrain import copy as copy_source
from ingest.terrain_mesh import lattice_places
from ingest.tints import TINT_M
from tests.ingest.rasters import Floats, north_up, write
from tiles import cells, geodesy
from tiles.errors import InputError
from tiles.terrain import TEXTURE_SIDE

Opener = Callable[..., Layer]
Picture = NDArray[np.uint8]
LON_DEG, LAT_DEG = 11.0, 46.0
BLUE, RED = (40, 60, 220), (230, 30, 30)


def cell_of(level: int, lon_deg: float = LON_DEG, lat_deg: float = LAT_DEG) -> int:
    return int(cells.cell_at(np.radians(lon_deg), np.radians(lat_deg), level))


def plain(colour: tuple[int, int, int], side: int = 60, bands: int = 3) -> Picture:
    full = np.array((*colour, 255)[:bands], np.uint8)
    return np.broadcast_to(full[:, None, None], (bands, side, side)).copy()


def texel_places(cell: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    west, south, east, north = cells.bounds_rad(cell)
    middle = (np.arange(256) + 0.5) / 256
    u, lat = np.meshgrid(middle, south + middle * (north - south))
    # Beyond 45 degrees texels draw together towards the pole, linearly in latitude.
    share = np.minimum((np.pi / 2 - np.abs(lat)) / (np.pi / 4), 1.0)
    away = np.clip((u - 0.5) / share * (east - west), -0.75 * np.pi, 0.75 * np.pi)
    return (west + east) / 2 + away, lat


@pytest.fixture
def opened(tmp_path: Path) -> Iterator[Opener]:
    """Write a picture, copy it into a store, open it."""
    connections = []

    def opener(bands: Picture, where: Any, crs: str = "EPSG:4326", **more: Any) -> Layer:
        path = tmp_path / f"picture{len(connections)}.tif"
        write(path, bands, where, crs, more.get("nodata"))
        with rasterio.open(path, "r+") as file:
            file.colorinterp = [*ColorInterp][3 : 3 + len(bands)]
            if "mask" in more:
                file.write_mask(more["mask"])
        with editing(tmp_path / "world.geopage") as writer:
            planned = plan(path, RasterOptions("imagery"))
            source = copy_source(writer, planned, lambda done, all_, what: None)
        connections.append(sqlite3.connect(tmp_path / "world.geopage"))
        return Layer(connections[-1], source)

    yield opener
    for connection in connections:
        connection.close()


def paint(
    cell: int,
    height_m: Floats,
    elevation_m: Floats,
    pictures: list[Layer],
    spacing_m: float = np.inf,
    knows: float | None = None,
) -> Any:
    """Paint a cell from a lattice of heights with one more post all round."""
    lon, lat = lattice_places(cell, len(height_m) - 3, margin=1)
    slopes = np.empty((len(height_m) - 2, len(height_m) - 2, 3))
    slopes[..., :2] = lattice_slopes(lon, lat, height_m)
    slopes[..., 2] = steeper_of(np.asarray(geodesy.cell_edge_m(cell)) / TEXTURE_SIDE)
    inner = np.asarray(elevation_m)[1:-1, 1:-1]
    known = float(spacing_m < COARSE_M) if knows is None else knows
    knowing = np.full(inner.shape, known, np.float32)
    return colours(cell, slopes, inner, pictures, knowing)


@pytest.mark.parametrize(
    ("crs", "where", "level"),
    [
        ("EPSG:4326", north_up(10.5, 46.6, 0.004), 6),
        ("EPSG:4326", north_up(370.5, 46.6, 0.004), 6),  # counted on from 360
        ("EPSG:32632", north_up(640_000.0, 5_140_000.0, 300.0), 6),
        ("EPSG:3857", north_up(1_180_000.0, 5_850_000.0, 500.0), 5),
        ("EPSG:3035", north_up(4_385_000.0, 2_559_000.0, 100.0), 9),
    ],
)
def test_texels_are_the_pictures_own_colours_in_any_crs(
    opened: Opener, crs: str, where: Any, level: int, rng: np.random.Generator
) -> None:
    """Oracle: pyproj at every texel, bilinear between the file's texels."""
    bands = rng.integers(1, 256, (3, 300, 280)).astype(np.uint8)
    bands = np.asarray((bands.astype(float) + np.roll(bands, 1, 2)) / 2, np.uint8)
    layer, cell = opened(bands, where, crs), cell_of(level)
    lon, lat = np.degrees(texel_places(cell))
    if crs == "EPSG:4326":
        lon = lon + (360 if where.c > 180 else 0)
        x, y = lon, lat
    else:
        x, y = pyproj.Transformer.from_crs(4326, crs, always_xy=True).transform(lon, lat)
    col, row = (x - where.c) / where.a - 0.5, (y - where.f) / where.e - 0.5
    # Its rims are faded.
    inside = (col > 20) & (col < 259) & (row > 20) & (row < 279)
    assert inside.sum() > 2000
    c, r = col[inside].astype(int), row[inside].astype(int)
    fx, fy = col[inside] - c, row[inside] - r
    at = bands.astype(float)
    north = at[:, r, c] * (1 - fx) + at[:, r, c + 1] * fx
    south = at[:, r + 1, c] * (1 - fx) + at[:, r + 1, c + 1] * fx
    wanted = (north * (1 - fy) + south * fy).T
    coarse = float(geodesy.cell_edge_m(cell)) / TEXTURE_SIDE >= 2 * layer.spacing_m
    assert not coarse, "the oracle knows the finest copy only"
    found = drape(cell, [layer])
    # A texel of noise changes by 100 and more: a tenth of a texel off would show.
    assert np.abs(found[inside][:, :3] - wanted).max() < 12
    assert np.abs(found[inside][:, :3] - wanted).mean() < 1
    far = (col < -1) | (col > 280) | (row < -1) | (row > 300)
    assert not found[far][:, : SHARE + 1].any()
    assert (found[far][:, CLEAR] == 1).all()


def holed(kind: str, opened: Opener, where: Any) -> Layer:
    """A red picture with a hole in its middle, said in one of four ways."""
    bands, hole = plain(RED), np.s_[20:40, 20:40]
    bands[:, *hole] = 0
    mask = np.full((60, 60), 255, np.uint8)
    mask[hole] = 0
    if kind == "alpha":
        return opened(np.concatenate([bands, mask[None]]), where)
    if kind == "nodata":
        return opened(bands, where, nodata=0)
    return opened(bands, where, mask=mask)


@pytest.mark.parametrize("kind", ["alpha", "nodata", "mask"])
@pytest.mark.parametrize("level", [5, 8])  # from a halved copy, and from the picture itself
def test_a_transparent_place_shows_the_coarser_picture_and_no_dark_rim(
    kind: str, level: int, opened: Opener
) -> None:
    west, south, _, north = np.degrees(cells.bounds_rad(cell_of(level)))
    step = (north - south) / 60
    fine = holed(kind, opened, north_up(west, north, step))
    wide = opened(plain(BLUE), north_up(west - 1, north + 1, (north - south + 2) / 60))
    found = drape(cell_of(level), [wide, fine])
    full = found[..., :3] / found[..., [SHARE]]
    assert found[..., CLEAR].max() < 1e-6
    low, high = np.minimum(BLUE, RED), np.maximum(BLUE, RED)
    assert (full > low - 0.1).all()
    assert (full < high + 0.1).all()
    # Every texel is a mixture of the two: no third colour, so no rim.
    part = (full - BLUE) @ (np.subtract(RED, BLUE)) / np.sum(np.subtract(RED, BLUE) ** 2.0)
    mixed = BLUE + part[..., None] * np.subtract(RED, BLUE)
    assert np.abs(full - mixed).max() < 0.1
    assert np.abs(full[128, 128] - BLUE).max() < 0.1
    assert np.abs(full[20, 20] - RED).max() < 0.1


def test_a_transparent_place_without_another_picture_shows_the_tint(
    opened: Opener,
) -> None:
    cell = cell_of(8)
    west, south, _, north = np.degrees(cells.bounds_rad(cell))
    layer = holed("alpha", opened, north_up(west, north, (north - south) / 60))
    flat = np.full((67, 67), 400.0)
    painted, bare = paint(cell, flat, flat, [layer]), paint(cell, flat, flat, [])
    np.testing.assert_allclose(painted[128, 128], bare[128, 128], atol=0.01)
    np.testing.assert_allclose(painted[20, 20], RED, atol=0.01)


def test_black_is_a_colour(opened: Opener) -> None:
    cell = cell_of(8)
    west, _, _, north = np.degrees(cells.bounds_rad(cell))
    found = drape(
        cell, [opened(plain((0, 0, 0)), north_up(west - 0.05, north + 0.05, 0.3 / 60))]
    )
    assert found[..., SHARE].min() > 0.999
    assert found[..., :3].max() < 1.001


def test_a_picture_with_nothing_opaque_is_refused(opened: Opener) -> None:
    with pytest.raises(InputError, match="holds no data"):
        opened(np.zeros((4, 9, 9), np.uint8), north_up(2, 3, 0.1))


def test_a_picture_across_the_antimeridian_has_no_gap(opened: Opener) -> None:
    layer = opened(plain(BLUE), north_up(179.75, 46.25, 0.008))
    for lon in (179.9, -179.9):
        found = drape(cell_of(8, lon), [layer])
        assert found[..., SHARE].min() > 0.999
        assert np.abs(found[..., :3] - BLUE).max() < 0.1


def test_a_picture_of_the_whole_earth_covers_it_up_to_the_poles(opened: Opener) -> None:
    bands = np.broadcast_to(np.array(BLUE, np.uint8)[:, None, None], (3, 90, 180))
    layer = opened(bands, north_up(-180.0, 90.0, 2.0))
    for lon, lat in ((179.9, 10.0), (-179.9, -10.0), (20.0, 89.9), (20.0, -89.9)):
        for level in (0, 3):
            share = drape(cell_of(level, lon, lat), [layer])[..., SHARE]
            assert share.min() > 0.999 * share.max() > 0.5


def test_the_rectangles_under_a_box_hold_every_texel_in_it(
    rng: np.random.Generator,
) -> None:
    for _ in range(200):
        west, south = rng.uniform(-200, 200), rng.uniform(-90, 80)
        box = (west, south, west + rng.uniform(0.1, 359), south + rng.uniform(0.1, 60))
        cell = cell_of(int(rng.integers(4)), rng.uniform(-180, 180), rng.uniform(-90, 90))
        lon, lat = np.degrees(texel_places(cell))
        inside = ((lon - box[0]) % 360 < box[2] - box[0]) & (lat > box[1]) & (lat < box[3])
        # What lies beside the cell is only blended into its edge.
        edge = np.degrees(cells.bounds_rad(cell))
        inside &= (lon > edge[0]) & (lon < edge[2])
        held = np.zeros((256, 256), bool)
        for x0, x1, y0, y1 in parts_under(cell, box):
            held[y0:y1, x0:x1] = True
        assert held[inside].all()


def test_slopes_towards_the_light_are_brighter_and_flat_ground_is_as_it_is(
    opened: Opener,
) -> None:
    cell = cell_of(9)
    layer = opened(
        plain((120, 120, 120)), north_up(LON_DEG - 0.15, LAT_DEG + 0.15, 0.3 / 60)
    )
    step_m = float(geodesy.cell_edge_m(cell)) / 64
    row, col = np.mgrid[:67, :67] * step_m
    shown = {
        name: float(paint(cell, height, height, [layer]).mean())
        for name, height in (
            ("flat", 0 * row + 500.0),
            ("north-west", 0.4 * (col - row)),  # falls to the north-west
            ("south-east", 0.4 * (row - col)),
        )
    }
    assert abs(shown["flat"] - 120) < 0.01
    assert shown["north-west"] > 125
    assert shown["south-east"] < 95


GREEN = (60, 110, 50)


@pytest.mark.parametrize(
    ("colour", "height_m"), [(BLUE, 20.0), (GREEN, 0.0), (GREEN, -40.0)]
)
def test_where_a_coarse_picture_and_the_height_differ_on_the_sea_one_of_them_counts(
    opened: Opener, colour: tuple[int, int, int], height_m: float
) -> None:
    layer = opened(plain(colour), north_up(5.0, 52.0, 0.2))
    cell, level = cell_of(9), np.full((19, 19), height_m)
    tint = paint(cell, level, level, [])
    coarse = paint(cell, level, level, [layer])
    fine = paint(cell, level, level, [layer], 90.0)
    assert np.abs(coarse - np.array(colour)).max() < 2
    if height_m < -1.0:  # there is land below the sea's level
        assert np.abs(fine - np.array(colour)).max() < 2
    else:
        assert (fine < tint).all()
        assert (
            np.abs(
                fine / fine.sum(-1, keepdims=True) - tint / tint.sum(-1, keepdims=True)
            ).max()
            < 0.02
        )


def test_where_a_coarse_picture_and_the_height_agree_both_count(opened: Opener) -> None:
    layer = opened(plain(BLUE), north_up(5.0, 52.0, 0.2))
    cell, level = cell_of(9), np.full((19, 19), -100.0)
    tint = paint(cell, level, level, [])
    for spacing_m in (90.0, 1e4):
        found = paint(cell, level, level, [layer], spacing_m)
        assert np.abs(found - (0.75 * np.array(BLUE) + 0.25 * tint)).max() < 2


def test_posts_far_apart_draw_no_coast_into_a_coarse_picture(opened: Opener) -> None:
    cell, ramp = cell_of(6), np.add.outer(np.zeros(19), np.linspace(-40.0, 40.0, 19))
    layer = opened(plain((90, 100, 60)), north_up(5.0, 52.0, 0.2))
    for spacing_m, is_drawn in ((90.0, True), (1e4, False)):
        row = paint(cell, ramp * 0, ramp, [layer], spacing_m)[128]
        steps = np.abs(np.diff(row, axis=0)).max()
        assert (steps > 4) == is_drawn
        assert steps < 1 or is_drawn


def test_a_picture_has_no_land_where_posts_say_that_all_is_sea(opened: Opener) -> None:
    land = (90, 100, 60)
    layer = opened(plain(land), north_up(5.0, 52.0, 0.2))
    cell, deep = cell_of(9), np.full((19, 19), -500.0)
    assert np.abs(paint(cell, deep, deep, [layer], knows=KNOWN) - land).max() < 2
    found = paint(cell, deep, deep, [layer], knows=SURE)
    assert (found[..., 2] > 2 * found[..., 0]).all()


def test_ground_under_the_sea_shows_a_third_of_its_relief() -> None:
    cell = cell_of(9)
    ramp = np.add.outer(np.zeros(19), np.arange(19.0)) * -100.0
    dark = [
        paint(cell, ramp, np.full((19, 19), height_m), []).mean()
        / paint(cell, ramp * 0, np.full((19, 19), height_m), []).mean()
        for height_m in (1000.0, -1000.0)
    ]
    assert dark[0] < 0.95
    assert dark[1] - 1 == pytest.approx(0.35 * (dark[0] - 1), abs=0.02)


def test_the_tint_has_no_steps_above_the_shore() -> None:
    """Neighbouring texels of a steady rise differ by what a rise of 1 % explains."""
    cell = cell_of(7)
    for low, high in pairwise(TINT_M[4:]):
        rise = np.linspace(float(low), float(high), 67)
        lattice = np.broadcast_to(rise, (67, 67))
        flat = np.zeros((67, 67))
        found = paint(cell, flat, lattice, [])
        assert np.abs(np.diff(found[128], axis=0)).max() < 2


def test_high_and_polar_ground_is_white_and_the_sea_never() -> None:
    def mean_rgb(lat_deg: float, height_m: float) -> NDArray[np.float64]:
        flat = np.full((67, 67), height_m)
        found = paint(cell_of(7, LON_DEG, lat_deg), flat, flat, [])
        return found.mean(axis=(0, 1), dtype=np.float64)

    for lat_deg, height_m in ((-75, 20), (-80, 2500), (75, 2000), (45, 4000), (0, 5800)):
        assert mean_rgb(lat_deg, height_m).min() > 200
    for lat_deg, height_m in ((60, 100), (45, 1500), (0, 4000), (28, 4500)):
        assert mean_rgb(lat_deg, height_m).max() < 180
    for lat_deg in (-75, 0, 80):
        red, _, blue = mean_rgb(lat_deg, -3000)
        assert blue > 2 * red


@pytest.mark.parametrize("level", [6, 8, 9, 10, 12])
def test_a_texel_counts_where_a_picture_below_shows_more(
    level: int, opened: Opener
) -> None:
    layer = opened(plain(BLUE), north_up(LON_DEG - 0.05, LAT_DEG + 0.05, 0.1 / 60))
    cell, flat = cell_of(level), np.zeros((67, 67))
    texel_m = float(geodesy.cell_edge_m(cell)) / 256
    finer = layer.spacing_m < 0.7 * texel_m
    assert texel_m_of(cell, flat, [], [layer]) == (texel_m if finer else 0.0)
    assert texel_m_of(cell_of(level, LON_DEG + 60), flat, [], [layer]) == 0.0


def test_a_texel_counts_where_finer_relief_lies_below_but_not_on_a_plain(
    opened: Opener, rng: np.random.Generator
) -> None:
    layer = opened(plain(BLUE), north_up(LON_DEG - 0.05, LAT_DEG + 0.05, 0.1 / 60))
    hills, plain_ = rng.uniform(0, 50, (67, 67)), rng.uniform(0, 0.1, (67, 67))
    for level in range(5, 12):
        cell = cell_of(level)
        texel_m = float(geodesy.cell_edge_m(cell)) / 256
        # The relief of every cell is made from 128 posts along its edge.
        finer = layer.spacing_m < 0.999 * 2 * texel_m
        assert texel_m_of(cell, hills, [layer], []) == (texel_m if finer else 0.0)
        assert texel_m_of(cell, plain_, [layer], []) == 0.0


def test_colours_between_posts_are_as_if_each_texel_was_painted(opened: Opener) -> None:
    """A transparent picture has every texel painted on its own."""
    cell = cell_of(9)
    row, col = np.mgrid[:67, :67] / 64.0
    height = 1000.0 + 1300.0 * np.sin(9.0 * row + 2.0 * col) * np.cos(11.0 * col)
    clear = plain(RED, bands=4)
    clear[3, 1:] = 0
    west, south, _, _ = np.degrees(cells.bounds_rad(cell))
    layer = opened(clear, north_up(west - 0.5, south, 1e-3))
    posts, texels = (paint(cell, height, height, one) for one in ([], [layer]))
    assert height.min() < -100.0
    assert np.abs(posts - texels).mean() < 1
    assert np.sqrt(((posts - texels) ** 2).mean()) < 1.5

# SPDX-License-Identifier: Apache-2.0
"""A cell's surface is within its bound of all it stands for, and says how close it is."""

import math
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from ingest.boxes import window_in
from ingest.fitting import Fitting, fitted, on_rim
from ingest.mosaic import Mosaic
from ingest.rungs import Rung, joined_mesh, laddered, laddered_inner
from ingest.terrain_mesh import CORNERS, Places, Surface, snapped
from ingest.terrain_tile import (
    LARGEST_BOUND_M,
    inner_bound_m,
    joined,
    lattice_of,
)
from ingest.triangulation import Triangulation
from ingest.truth import Truth, places_of, truth_of
from tests.ingest.rasters import (
    ELLIPSOID,
    UTM,
    Floats,
    drawn,
    ecef,
    hills,
    leaf_at,
    mosaic_of,
    north_up,
    own_surface_m,
    places_deg,
    write,
)
from tests.tiles.places import uv_in_cell
from tiles import cells, geodesy
from tiles.mesh import UV_ONE
from tiles.terrain import TerrainTile

Opener = Callable[..., tuple[Mosaic, Path]]
SHAPE = 200, 240
SIDE = 90


def rough() -> NDArray[np.float32]:
    return np.random.default_rng(3).normal(500, 200, SHAPE).astype(np.float32)


def smooth() -> NDArray[np.float32]:
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    return np.asarray(800 + 500 * np.sin(x / 23) * np.cos(y / 31), np.float32)


def cliff() -> NDArray[np.float32]:
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    return np.asarray(np.where(x + 0.37 * y > 140, 900, 0), np.float32)


GROUNDS = {
    "rough": rough(),
    "hills": hills(SHAPE, 1.0, 200.0),
    "smooth": smooth(),
    "cliff": cliff(),
    "flat": np.full(SHAPE, 123, np.float32),
}


@pytest.fixture
def opened(tmp_path: Path) -> Iterator[Opener]:
    connections = []

    def opener(posts: NDArray[np.float32], crs: str = "EPSG:4326") -> tuple[Mosaic, Path]:
        where = north_up(11.0, 46.5, 0.005)
        if crs == UTM:
            where = north_up(660_000.0, 5_150_000.0, 500.0)
        path = write(tmp_path / "dem.tif", posts, where, crs)
        mosaic, connection = mosaic_of(tmp_path / "a.geopage", [(path, ELLIPSOID)])
        connections.append(connection)
        return mosaic, path

    yield opener
    for connection in connections:
        connection.close()


def leaf_of(mosaic: Mosaic) -> Truth:
    return truth_of(mosaic, leaf_at(11.55, 46.1, mosaic.layers[0].spacing_m), SIDE)


def worst_m(path: Path, surface: Surface, cell: int, uv: Floats) -> float:
    """Largest difference in height from a file's own triangles at fractions of a cell."""
    lon, lat = places_deg(cell, uv)
    there = ecef(lon, lat, own_surface_m(path, lon, lat, egm96=False))
    up = geodesy.up(np.radians(lon), np.radians(lat))
    gap = np.abs(((drawn(surface, uv) - there) * up).sum(axis=1))
    assert np.isfinite(gap).all()
    return float(gap.max())


@pytest.mark.parametrize("crs", ["EPSG:4326", UTM])
@pytest.mark.parametrize("ground", GROUNDS)
def test_a_leaf_is_within_its_bound_and_no_place_is_further_off_than_it_says(
    ground: str, crs: str, opened: Opener, rng: np.random.Generator
) -> None:
    mosaic, path = opened(GROUNDS[ground], crs)
    truth, bound_m = leaf_of(mosaic), mosaic.layers[0].spacing_m / 100
    surface, error_m = fitted(truth.cell, places_of(truth), bound_m, [truth], leaf=True)
    assert 0 < error_m <= bound_m
    worst = worst_m(path, surface, truth.cell, rng.uniform(size=(4000, 2)))
    # Places in a projection may be off by a twentieth of the bound.
    assert worst <= error_m + (bound_m / 20 if crs == UTM else 0.0)


@pytest.mark.parametrize("ground", GROUNDS)
def test_the_error_of_a_leaf_is_not_made_up(
    ground: str, opened: Opener, rng: np.random.Generator
) -> None:
    """Some post or some middle between two posts is nearly as far off as it says."""
    mosaic, path = opened(GROUNDS[ground])
    truth, bound_m = leaf_of(mosaic), mosaic.layers[0].spacing_m / 100
    surface, error_m = fitted(truth.cell, places_of(truth), bound_m, [truth], leaf=True)
    flat = truth.uv.reshape(-1, 2)
    posts = flat[((flat >= 0) & (flat <= 1)).all(axis=1)]
    edges = surface.uv[surface.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)]
    share = rng.uniform(size=(len(edges), 1))
    along = edges[:, 0] + share * (edges[:, 1] - edges[:, 0])
    uv = np.concatenate([posts, along, rng.uniform(size=(3000, 2))])
    assert error_m <= 1.5 * worst_m(path, surface, truth.cell, uv) + truth.slack_m


@pytest.mark.parametrize("ground", GROUNDS)
def test_the_surface_covers_its_cell_once(ground: str, opened: Opener) -> None:
    truth = leaf_of(opened(GROUNDS[ground], UTM)[0])
    surface, _ = fitted(truth.cell, places_of(truth), 5.0, [truth], leaf=True)
    a, b, c = np.moveaxis(np.rint(surface.uv * UV_ONE)[surface.triangles], 1, 0)
    twice = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    assert (twice > 0).all()
    assert twice.sum() == 2 * UV_ONE * UV_ONE
    indices = surface.mesh.indices[: surface.triangles.size].reshape(-1, 3)
    np.testing.assert_array_equal(indices, surface.triangles)


@pytest.mark.parametrize(
    ("ground", "most"), [("rough", 1.15), ("hills", 2.25), ("smooth", 1.5), ("flat", 60)]
)
def test_the_bound_between_posts_costs_few_triangles(
    ground: str, most: float, opened: Opener
) -> None:
    """Insertion over the posts alone misses up to several times the bound."""
    mosaic, _ = opened(GROUNDS[ground])
    truth, bound_m = leaf_of(mosaic), mosaic.layers[0].spacing_m / 100
    places = places_of(truth)
    surface, _ = fitted(truth.cell, places, bound_m, [truth], leaf=True)
    inner = np.flatnonzero(((places.at > 0) & (places.at < UV_ONE)).all(axis=1))
    chosen = np.concatenate([np.arange(4), inner])
    points = np.ascontiguousarray(places.points[chosen] - truth.centre)
    at = np.ascontiguousarray(places.at[chosen])
    net = Triangulation(at, at / UV_ONE, points)
    net.refine(bound_m)
    triangles = net.result().triangles
    assert len(surface.triangles) <= most * len(triangles)


def family(mosaic: Mosaic, depth: int) -> tuple[int, list[int]]:
    """Return a cell well inside the raster, and the leaves in it."""
    leaf = leaf_at(11.55, 46.1, mosaic.layers[0].spacing_m / 2**depth)
    level = int(cells.level(leaf))
    below = [int(cells.ancestor(leaf, level - depth))]
    for _ in range(depth):
        below = [int(child) for cell in below for child in cells.children(cell)]
    return int(cells.ancestor(leaf, level - depth)), below


def inner_of(mosaic: Mosaic, share: float = 1.0) -> tuple[int, Places, float, list[Truth]]:
    """Return a cell above four leaves, its places, its bound, and what it stands for.

    Parameters
    ----------
    share : of the bound that such a cell has
    """
    cell, leaves = family(mosaic, 1)
    truths = [truth_of(mosaic, leaf, SIDE) for leaf in leaves]
    children = [
        (one.cell, fitted(one.cell, places_of(one), 5.0, [one], leaf=True)[0])
        for one in truths
    ]
    bound_m = share * inner_bound_m(cell)
    return cell, joined(cell, children, bound_m), bound_m, truths


@pytest.mark.parametrize("ground", ["rough", "hills", "smooth", "cliff", "flat"])
def test_an_inner_cell_is_within_its_bound_of_all_posts_below(
    ground: str, opened: Opener, rng: np.random.Generator
) -> None:
    mosaic, path = opened(GROUNDS[ground])
    cell, places, bound_m, truths = inner_of(mosaic)
    surface, error_m = fitted(cell, places, bound_m, truths, leaf=False)
    assert 0 < error_m <= bound_m
    assert worst_m(path, surface, cell, rng.uniform(size=(4000, 2))) <= error_m


def test_an_inner_cell_two_levels_up_is_honest_too(
    opened: Opener, rng: np.random.Generator
) -> None:
    mosaic, path = opened(GROUNDS["hills"])
    top, leaves = family(mosaic, 2)
    truths = {leaf: truth_of(mosaic, leaf, SIDE) for leaf in leaves}
    surfaces = {
        leaf: fitted(leaf, places_of(one), 5.0, [one], leaf=True)[0]
        for leaf, one in truths.items()
    }
    middle = [int(child) for child in cells.children(top)]
    for cell in (*middle, top):
        below = [int(child) for child in cells.children(cell)]
        held = [one for leaf, one in truths.items() if cells.contains(cell, leaf)]
        bound_m = inner_bound_m(cell)
        places = joined(cell, [(one, surfaces[one]) for one in below], bound_m)
        surfaces[cell], error_m = fitted(cell, places, bound_m, held, leaf=False)
        assert error_m <= bound_m
    assert worst_m(path, surfaces[top], top, rng.uniform(size=(4000, 2))) <= error_m
    assert len(surfaces[top].triangles) < 1.2 * len(surfaces[middle[0]].triangles) * 4


def test_a_bound_that_can_not_be_kept_is_not_claimed(
    opened: Opener, rng: np.random.Generator
) -> None:
    """Positions have 16 bits: asked for a millimetre, the error says what came of it."""
    mosaic, path = opened(GROUNDS["rough"])
    truth = leaf_of(mosaic)
    surface, error_m = fitted(truth.cell, places_of(truth), 1e-3, [truth], leaf=True)
    assert error_m > 0.1
    assert worst_m(path, surface, truth.cell, rng.uniform(size=(4000, 2))) <= error_m


def test_an_inner_bound_is_a_texel_but_the_globe_stays_round() -> None:
    leaf = int(cells.cell_at(0.1, 0.8, 12))
    assert inner_bound_m(leaf) == pytest.approx(geodesy.cell_edge_m(leaf) / 256)
    assert inner_bound_m(int(cells.ancestor(leaf, 0))) == LARGEST_BOUND_M


def test_a_cell_lies_in_its_ancestor_where_longitudes_and_latitudes_say(
    rng: np.random.Generator,
) -> None:
    for _ in range(50):
        level = int(rng.integers(1, 20))
        cell = int(cells.cell_at(rng.uniform(-3, 3), rng.uniform(-1.5, 1.5), level))
        ancestor = int(cells.ancestor(cell, int(rng.integers(0, level + 1))))
        u, v, size = window_in(ancestor, cell)
        west, south, east, north = cells.bounds_rad(cell)
        edges = np.array([west, east]), np.array([south, north])
        left, low = uv_in_cell(ancestor, *edges)
        np.testing.assert_allclose(left, [u, u + size], atol=1e-9)
        np.testing.assert_allclose(low, [v, v + size], atol=1e-9)


def towards(cell: int, uv: tuple[float, float], depth: int) -> list[int]:
    """Return leaves that cover a cell, smaller and smaller towards a place in it."""
    if depth == 0:
        return [cell]
    found = []
    for child in (int(one) for one in cells.children(cell)):
        u, v, size = window_in(cell, child)
        past = (uv[0] - u) / size, (uv[1] - v) / size
        inside = min(past) >= 0 and max(past) < 1
        found += towards(child, past, depth - 1) if inside else [child]
    return found


def test_a_place_moved_to_the_edge_is_read_from_the_leaf_that_holds_it(
    opened: Opener, rng: np.random.Generator
) -> None:
    """Leaves beside the edge may be smaller than the strip that counts as beside it."""
    mosaic, _ = opened(GROUNDS["hills"])
    cell = family(mosaic, 1)[0]
    leaves = towards(cell, (0.31, 0.006), 7)
    truths = [truth_of(mosaic, leaf, SIDE) for leaf in leaves]
    corners = ecef(*places_deg(cell, CORNERS), np.full(4, 500.0))
    fitting = Fitting(cell, Places.of(snapped(CORNERS), corners), truths, leaf=False)
    uv = on_rim(np.stack([0.31 + rng.uniform(-0.02, 0.02, 50), np.full(50, 0.006)], axis=1))
    lon, lat = np.radians(places_deg(cell, uv + np.array([0.0, 1e-9])))
    held = [leaves[k] for k in fitting.holding(uv)]
    level = int(cells.level(leaves).max())
    assert cells.contains(np.array(held), cells.cell_at(lon, lat, level)).all()
    assert len(set(held)) > 3


def test_places_beside_an_edge_are_put_on_it() -> None:
    uv = np.array([(0.01, 0.3), (0.4, 0.99), (0.001, 0.999)])
    np.testing.assert_array_equal(on_rim(uv), [(0, 0.3), (0.4, 1), (0, 1)])


def test_a_lattice_has_its_corners_first_and_the_mosaics_heights(opened: Opener) -> None:
    mosaic, _ = opened(GROUNDS["hills"])
    cell = family(mosaic, 1)[0]
    places = lattice_of(mosaic, cell)
    assert places.at[:4].tolist() == [[0, 0], [UV_ONE, 0], [UV_ONE, UV_ONE], [0, UV_ONE]]
    assert len(np.unique(places.at, axis=0)) == len(places.at) >= 129 * 129
    lon, lat = places_deg(cell, places.at / UV_ONE)
    heights = mosaic.heights(
        np.radians(lon), np.radians(lat), float(geodesy.cell_edge_m(cell)) / 128
    )
    gap = np.linalg.norm(places.points - ecef(lon, lat, heights), axis=1)
    # A place is rounded to 1 / 32768 of the cell, its point is not.
    assert gap.max() < 2 * float(geodesy.cell_edge_m(cell)) / UV_ONE


def test_the_vertices_of_four_children_become_places_of_the_cell(opened: Opener) -> None:
    mosaic, path = opened(GROUNDS["hills"])
    cell, leaves = family(mosaic, 1)
    truths, children = [truth_of(mosaic, leaf, SIDE) for leaf in leaves], []
    for leaf, truth in zip(leaves, truths, strict=True):
        found = fitted(leaf, places_of(truth), 20.0, [truth], leaf=True)[0]
        children.append((leaf, found))
    places = joined(cell, children, 0.0)
    assert places.at[:4].tolist() == [[0, 0], [UV_ONE, 0], [UV_ONE, UV_ONE], [0, UV_ONE]]
    lon, lat = places_deg(cell, places.at / UV_ONE)
    there = ecef(lon, lat, own_surface_m(path, lon, lat, egm96=False))
    gap = np.linalg.norm(places.points - there, axis=1)
    rounding_m = max(child.mesh.scale_m for _, child in children)
    # Halved fractions are rounded again: to 1 / 65536 of the cell.
    near_m = 2 * rounding_m + 2 * float(geodesy.cell_edge_m(cell)) / UV_ONE
    assert (gap <= near_m).mean() > 0.99
    # Between the places of a lattice that is a leaf's own, its surface is off by that.
    assert gap.max() <= near_m + max(truth.slack_m for truth in truths)
    counts = [len(child.used) for _, child in children]
    assert 0.9 * sum(counts) < len(places.at) <= sum(counts)


@pytest.mark.parametrize(
    ("ground", "crs"),
    [(one, crs) for one in ("rough", "hills") for crs in ("EPSG:4326", UTM)]
    + [("cliff", "EPSG:4326")],
)
def test_rungs_are_no_further_off_than_they_say_with_fewer_triangles(
    ground: str, crs: str, opened: Opener, rng: np.random.Generator
) -> None:
    mosaic, path = opened(GROUNDS[ground], crs)
    truth, bound_m = leaf_of(mosaic), mosaic.layers[0].spacing_m / 100
    whole, error_m, rungs = laddered(truth.cell, places_of(truth), bound_m, [truth])
    # Of noise, and of a cliff, no mesh in between saves enough.
    assert rungs or ground != "hills"
    assert 0 < error_m <= bound_m
    before = Rung(whole, error_m)
    for rung in rungs:
        assert rung.error_m > before.error_m
        count = len(rung.surface.triangles)
        assert 1 < count <= 0.7 * len(before.surface.triangles)
        worst = worst_m(path, rung.surface, truth.cell, rng.uniform(size=(4000, 2)))
        assert 0.3 * rung.error_m < worst <= rung.error_m + 0.5 * (crs == UTM)
        before = rung


@pytest.mark.parametrize("ground", ["rough", "hills"])
def test_an_inner_cell_has_a_rung_that_is_no_further_off_than_it_says(
    ground: str, opened: Opener, rng: np.random.Generator
) -> None:
    """Posts below, and places along the rung's edges, by the file's own triangles."""
    mosaic, path = opened(GROUNDS[ground])
    # On gentle ground a cell would have too few triangles for a rung.
    cell, places, bound_m, truths = inner_of(mosaic, 1.0 if ground == "rough" else 0.3)
    whole, error_m, rungs = laddered_inner(cell, places, bound_m, truths)
    assert error_m <= bound_m
    (rung,) = rungs
    surface = rung.surface
    assert error_m < rung.error_m <= math.sqrt(2) * bound_m
    assert len(surface.triangles) < 0.9 * len(whole.triangles)
    mine = set(map(tuple, surface.at.tolist()))
    # Few of its vertices are not among those that are stored anyway.
    assert len(mine - set(map(tuple, whole.at.tolist()))) < 0.2 * len(mine)
    posts = np.concatenate([uv_in(cell, one) for one in truths])
    edges = surface.uv[surface.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)]
    share = rng.uniform(size=(len(edges), 1))
    along = edges[:, 0] + share * (edges[:, 1] - edges[:, 0])
    nearest = [
        nearest_m(path, surface, cell, uv)
        for uv in (rng.choice(posts, 200), rng.choice(along, 200))
    ]
    assert 0.2 * rung.error_m < max(nearest) <= rung.error_m


def test_an_inner_cell_gives_up_vertices_that_it_does_not_need(
    opened: Opener, monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator
) -> None:
    """Fewer triangles than without, and as near to posts and along edges as it says."""
    mosaic, path = opened(GROUNDS["hills"])
    cell, places, bound_m, truths = inner_of(mosaic, 0.3)
    surface, error_m = fitted(cell, places, bound_m, truths, leaf=False)
    posts = np.concatenate([uv_in(cell, one) for one in truths])
    edges = surface.uv[surface.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)]
    share = rng.uniform(size=(len(edges), 1))
    along = edges[:, 0] + share * (edges[:, 1] - edges[:, 0])
    for uv in (rng.choice(posts, 200), rng.choice(along, 200)):
        assert nearest_m(path, surface, cell, uv) <= error_m <= bound_m
    monkeypatch.setattr("ingest.fitting.THINNINGS", 0)
    fuller = fitted(cell, places, bound_m, truths, leaf=False)[0]
    assert len(surface.triangles) < 0.9 * len(fuller.triangles)


def uv_in(cell: int, truth: Truth) -> Floats:
    """Return the posts of a leaf that lie in it, as fractions of a cell above, (n, 2)."""
    flat = truth.uv.reshape(-1, 2)
    u, v, size = window_in(cell, truth.cell)
    inside = ((flat >= 0) & (flat <= 1)).all(axis=1)
    return np.asarray(np.array([u, v]) + size * flat[inside])


def nearest_m(path: Path, surface: Surface, cell: int, uv: Floats) -> float:
    """Return how far true places at fractions of a cell are from a surface, at most."""
    lon, lat = places_deg(cell, uv)
    there = ecef(lon, lat, own_surface_m(path, lon, lat, egm96=False)) - surface.centre
    corners = surface.points[surface.triangles]
    far_m = []
    for place in there:
        every = np.tile(place, (len(corners), 1))
        gap = trimesh.triangles.closest_point(corners, every) - place
        far_m.append(np.linalg.norm(gap, axis=1).min())
    return max(far_m)


def test_flat_ground_has_no_rungs(opened: Opener) -> None:
    mosaic, _ = opened(GROUNDS["flat"])
    truth = leaf_of(mosaic)
    whole, _, rungs = laddered(truth.cell, places_of(truth), 5.0, [truth])
    assert not rungs
    mesh, table = joined_mesh(whole, rungs)
    assert mesh.indices.tolist() == whole.mesh.indices.tolist()
    assert not len(table)


def test_every_part_of_a_leaf_covers_it_once_and_hangs_its_own_skirt(
    opened: Opener,
) -> None:
    mosaic, _ = opened(GROUNDS["hills"])
    truth = leaf_of(mosaic)
    whole, error_m, rungs = laddered(truth.cell, places_of(truth), 5.0, [truth])
    mesh, table = joined_mesh(whole, rungs)
    count = 3 * len(whole.triangles)
    tile = TerrainTile(truth.cell, mesh, count, error_m, 0.0, np.zeros(0, np.uint8), table)
    at, flags = mesh.vertices["detail"].astype(np.int64), mesh.vertices["flags"]
    surfaces = [whole, *(rung.surface for rung in rungs)]
    for part, surface in zip(tile.parts(), surfaces, strict=True):
        first, end = int(part["first_index"]), int(part["surface_index_count"])
        triangles = mesh.indices[first : first + end].reshape(-1, 3)
        walls = mesh.indices[first + end : first + int(part["index_count"])].reshape(-1, 3)
        assert (at[triangles] == surface.at[surface.triangles]).all()
        points = mesh.local[triangles] - surface.points[surface.triangles]
        assert np.abs(points).max() <= 1.01 * (mesh.scale_m + surface.mesh.scale_m) / 2
        assert not flags[triangles].any()
        assert len(walls) == 2 * len(surface.border)
        rim = np.unique(at[walls].reshape(-1, 2), axis=0)
        assert (rim % UV_ONE == 0).any(axis=1).all()
        own = np.unique(surface.at[surface.border].reshape(-1, 2), axis=0)
        assert rim.tolist() == own.tolist()

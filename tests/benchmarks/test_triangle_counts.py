# SPDX-License-Identifier: Apache-2.0
"""How many triangles the terrain takes, against floors and against regular grids.

With `-s` the figures are printed. A tile keeps its bound everywhere; plain greedy
insertion, the floor that tiles are counted against, keeps it at the posts only, so it is
measured between them too. The triangles of a view are counted against two meshes made for
that view alone: one that keeps the threshold over posts and the triangles' interiors, and
one that keeps it at posts only. `GEOPAGE_STORE=world.geopage` measures a store made of the
sample files instead.
"""

import math
import os
import sys
from bisect import bisect_left
from collections.abc import Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import rasterio
from numpy.typing import NDArray

from geopage.screen_error import lens_of
from geopage.selection import ideal
from geopage.tree import tree_of
from geopage.view import ViewState
from ingest.boxes import window_in
from ingest.layer import Layer
from ingest.mosaic import Mosaic
from ingest.terrain import ingest_rasters
from ingest.terrain_mesh import CORNERS, Meshing, Places, Surface, snapped
from ingest.terrain_tile import LEAF_SIDE, inner_bound_m
from ingest.truth import Truth, places_of, points_at, truth_of
from tests.benchmarks.test_sampled_heights import cut
from tests.benchmarks.view_exact import Ground, Meshed, in_picture
from tests.geopage.screen_error_oracle import scales_of
from tests.geopage.worlds import view_at
from tests.ingest.rasters import EGM96, Floats, deviation_of, leaf_at
from tiles import cells, terrain
from tiles.forest import build_forest
from tiles.lanes import Lane
from tiles.mesh import STEPS, UV_ONE
from tiles.samples import SAMPLES
from tiles.store import Store
from tiles.terrain import TEXTURE_BYTES, TerrainTile, in_pieces
from viewer.cull import Eye, Lists, eye_of, is_visible, terrain_runs
from viewer.runs import MOST_RUNS
from viewer.slots import make_pieces, make_slots, put_parts

TAU_PX = 2.0
REGION_POSTS = 360
MARGIN_POSTS = 12
MOST_DRAWN = 2.2
"""Triangles of a settled view, by those of a greedy mesh made for it alone"""
MOST_SIDE = 240
"""Squares along an edge of the finest regular grid that is tried"""
SOME_SIDES = (1, 2, 3, 4, 6, 8, 11, 16, 23, 32, 45, 64, 91, 128, 181, MOST_SIDE)
MOST_BELOW = 200_000
"""Posts below an inner cell that is still meshed anew"""
BETWEEN = 100_000
"""Random places of a region at which view-exact meshes are measured"""


class World:
    """The terrain of a store, and what its tiles stand for."""

    def __init__(self, store: Store, source: str) -> None:
        self.store = store
        self.mosaic = Mosaic(store.connection, store.sources("terrain"))
        self.layer: Layer = next(one for one in self.mosaic.layers if one.name == source)
        self.forest = build_forest(store.index(Lane.TERRAIN))
        self.records = self.forest.records
        self.tree = tree_of(self.forest, Lane.TERRAIN)
        self._truths: dict[int, Truth] = {}
        self._tiles: dict[int, TerrainTile] = {}
        self.grids: dict[tuple[int, float], TerrainTile] = {}

    def rows(self, *, leaves: bool) -> list[int]:
        """Return tiles that lie wholly in the source, none finer being there.

        Leaves that are made of a lattice of their own instead of posts are left out.
        """
        west, south, east, north = np.radians(self.layer.bounds_deg)
        box = np.stack(cells.bounds_rad(self.records["cell"]), axis=-1)
        inside = (box[:, :2] > (west, south)).all(axis=1)
        inside &= (box[:, 2:] < (east, north)).all(axis=1)
        inside &= (self.records["children"] == 0) == leaves
        found = np.flatnonzero(inside).tolist()
        finer = [one for one in self.mosaic.layers if one.spacing_m < self.layer.spacing_m]
        found = [row for row in found if not any(self._near(one, row) for one in finer)]
        return [row for row in found if not leaves or self._has_posts(row)]

    def _near(self, layer: Layer, row: int) -> bool:
        return layer.holds([float(x) for x in cells.bounds_rad(self.cell(row))])

    def _has_posts(self, row: int) -> bool:
        first = self.truths(self.cell(row))[0].uv[0, 0]
        return bool((np.abs(first) > 1e-9).any())

    def cell(self, row: int) -> int:
        return int(self.records["cell"][row])

    def triangles(self, row: int, rung: int = 0) -> int:
        """Return the triangles of a stored tile's mesh or rung, skirts apart."""
        return len(self.tile(row).surface(rung))

    def tile(self, row: int) -> TerrainTile:
        """Return a stored tile."""
        if row not in self._tiles:
            body = self.store.body(int(self.records["row"][row]))
            self._tiles[row] = terrain.decode(body)
        return self._tiles[row]

    def drawn(self, row: int, tile: TerrainTile, rung: int, eye: Eye) -> int:
        """Return the triangles that a renderer draws of a mesh, skirts apart.

        Parameters
        ----------
        row : whose place and index record count
        """
        slots, pieces = self._uploaded
        slots["centre"][row], slots["scale_m"][row] = tile.mesh.centre, tile.mesh.scale_m
        put_parts(slots[row], pieces[0], tile)
        spheres = self.forest.centre, self.forest.radius_m
        flat = np.zeros((0, 3), np.float32)
        lists = Lists(np.zeros(0, np.int32), slots, *spheres, flat, self.records, pieces)
        runs = np.empty((MOST_RUNS, 2), np.int64)
        ends = runs[: terrain_runs(lists, row, rung, 0.0, eye, runs)].cumsum(axis=1)
        surface = 3 * len(tile.surface(rung))
        return int(np.diff(np.minimum(ends, surface), axis=1).sum()) // 3

    @cached_property
    def _uploaded(self) -> tuple[NDArray[np.void], NDArray[np.void]]:
        slots = make_slots(len(self.records))
        slots["box_rad"] = np.stack(cells.bounds_rad(self.records["cell"]), axis=-1)
        return slots, make_pieces(1)

    def truths(self, cell: int) -> list[Truth]:
        """Return what the leaves in a cell stand for."""
        first, last = int(cells.range_min(cell)), int(cells.range_max(cell))
        mine = (self.records["cell"] >= first) & (self.records["cell"] <= last)
        leaves = self.records["cell"][mine & (self.records["children"] == 0)]
        for leaf in leaves.tolist():
            if leaf not in self._truths:
                self._truths[leaf] = truth_of(self.mosaic, leaf, LEAF_SIDE)
        return [self._truths[leaf] for leaf in leaves.tolist()]

    def posts(self, cell: int, *, rim: bool) -> Places:
        """Return a cell's posts and corners, and the places on its edges if asked."""
        at, points = [], []
        for truth in self.truths(cell):
            places, (u, v, size) = places_of(truth), window_in(cell, truth.cell)
            there = snapped(np.array([u, v]) + size * places.at / UV_ONE)
            on_rim = (there % UV_ONE == 0).any(axis=1)
            is_corner = (there % UV_ONE == 0).all(axis=1)
            is_post = (places.at % UV_ONE != 0).all(axis=1)
            take = is_post | is_corner | (on_rim & rim)
            at.append(there[take])
            points.append(places.points[take])
        places_at, ecef = np.concatenate(at), np.concatenate(points)
        corners = (CORNERS * UV_ONE).astype(np.int64)
        first = [np.flatnonzero((places_at == one).all(axis=1))[0] for one in corners]
        order = np.concatenate([first, np.arange(len(places_at))])
        return Places.of(places_at[order], ecef[order])


def plain(cell: int, places: Places, bound_m: float, *, leaf: bool) -> Surface:
    """Insert greedily, at exactly the bound: no room is left for rounded positions."""
    reach_m = float(np.abs(places.points - places.points[:4].mean(axis=0)).max())
    meshing = Meshing(cell, places, upright=leaf)
    meshing.refine(bound_m + np.sqrt(3) / 2 * reach_m / STEPS)
    return meshing.surface()


def error_of(surface: Surface, cell: int, truths: list[Truth], *, leaf: bool) -> float:
    """Return a surface's largest distance from what a cell stands for."""
    both = [(window_in(cell, truth.cell), truth) for truth in truths]
    return max(deviation_of(surface, *one, upright=leaf).largest_m for one in both)


def some(rows: list[int], count: int) -> list[int]:
    """Return so many of the rows, spread evenly."""
    return [
        rows[i] for i in np.linspace(0, len(rows) - 1, min(count, len(rows))).astype(int)
    ]


def per_tile(world: World, count: int, *, leaf: bool) -> dict[str, Floats]:
    """Return tile ÷ floor for some tiles, and how far floors break the bound.

    `stated`, `bound`: over posts alone, at the tile's stated error and at its bound;
    `edges`: at the stated error, the places along the tile's edges counted too;
    `breach`: largest error of the latter ÷ the stated error;
    `floor_of_grid`: the floor at the stated error ÷ a grid of all posts;
    `bent`: of a leaf the share of posts that no plane holds with both neighbours in any
    of the four directions, so that an edge goes between the three in each.
    """
    names = "stated", "bound", "edges", "breach", "floor_of_grid", "bent"
    found: dict[str, list[float]] = {name: [] for name in names}
    for row in some(world.rows(leaves=leaf), count):
        cell, truths = world.cell(row), world.truths(world.cell(row))
        if sum(truth.points[..., 0].size for truth in truths) > MOST_BELOW:
            continue
        stated_m = float(world.records["error_m"][row])
        source_m = max(world.layer.spacing_m / 100, world.layer.vertical_step_m / 2)
        bound_m = min(inner_bound_m(cell), source_m if leaf else np.inf)
        posts, mine = world.posts(cell, rim=False), world.triangles(row)
        floor = plain(cell, posts, stated_m, leaf=leaf)
        loose = plain(cell, posts, bound_m, leaf=leaf)
        edged = plain(cell, world.posts(cell, rim=True), stated_m, leaf=leaf)
        surfaces = zip(("stated", "bound", "edges"), (floor, loose, edged), strict=True)
        for name, one in surfaces:
            found[name].append(mine / len(one.triangles))
        found["breach"].append(error_of(edged, cell, truths, leaf=leaf) / stated_m)
        found["floor_of_grid"].append(len(floor.triangles) / (2 * len(posts.at)))
        if leaf:
            found["bent"].append(bent(truths[0], stated_m))
    return {name: np.array(values) for name, values in found.items()}


def bent(truth: Truth, error_m: float) -> float:
    """Return the share of posts that lie in no plane with neighbours, in no direction.

    Off by a quarter of their second difference is the plane nearest to three in a row.
    """
    up = truth.centre / np.linalg.norm(truth.centre)
    high_m = truth.points.astype(np.float64) @ up
    middle, apart = high_m[1:-1, 1:-1], []
    for row, col in ((0, 1), (1, 0), (1, 1), (1, -1)):
        one, other = (
            np.roll(high_m, (sign * row, sign * col), (0, 1))[1:-1, 1:-1]
            for sign in (1, -1)
        )
        apart.append(np.abs(one + other - 2 * middle) / 4)
    return float((np.min(apart, axis=0) > error_m).mean())


def grid_triangles(world: World, row: int) -> int:
    """Return the triangles of the coarsest regular grid that is as good as a tile.

    At most as many as the posts themselves make, or as the finest grid tried.
    """
    every = range(1, MOST_SIDE + 1)
    high = grid_side(world, row, float(world.records["error_m"][row]), every)
    posts = 2 * len(world.posts(world.cell(row), rim=False).at)
    return min(2 * high * high, posts)


def grid_side(world: World, row: int, goal_m: float, tried: Sequence[int]) -> int:
    """Return the squares along an edge of the coarsest regular grid within an error.

    Of those that are tried, ascending, one more than the finest that is not within it.
    """
    cell = world.cell(row)
    truths, leaf = world.truths(cell), not world.records["children"][row]

    def is_within(side: int) -> bool:
        return error_of(lattice(cell, truths, side), cell, truths, leaf=leaf) <= goal_m

    found = bisect_left(tried[:-1], 1, key=is_within)
    return tried[found - 1] + 1 if found else tried[0]


def grid_tile(world: World, row: int, goal_m: float) -> TerrainTile:
    """Return a tile's regular grid within an error, in blocks as a tile is.

    At most about as many squares as the cell has posts.
    """
    if (row, goal_m) not in world.grids:
        cell = world.cell(row)
        posts = math.isqrt(len(world.posts(cell, rim=False).at))
        side = min(grid_side(world, row, goal_m, SOME_SIDES), posts)
        made = lattice(cell, world.truths(cell), side)
        none = np.zeros(TEXTURE_BYTES, np.uint8)
        count = 3 * len(made.triangles)
        tile = TerrainTile(cell, made.mesh, count, goal_m, 0.0, none)
        world.grids[row, goal_m] = in_pieces(tile)
    return world.grids[row, goal_m]


def lattice(cell: int, truths: list[Truth], side: int) -> Surface:
    """Mesh a cell as side x side squares, all in the source's surface."""
    steps = np.arange(side + 1) / side
    uv = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    at, points = surface_at(cell, truths, uv)
    corners = np.array([0, side, -1, -1 - side]) % (side + 1) ** 2
    order = np.concatenate([corners, np.setdiff1d(np.arange(len(uv)), corners)])
    meshing = Meshing(cell, Places.of(at[order], points[order]))
    meshing.refine_wholly()
    return meshing.surface()


class Greedy(NamedTuple):
    """One greedy mesh of what a view sees of a region."""

    triangles: int
    breach: float
    """largest error at its posts and where its edges cross lines between posts, by the
    threshold"""
    at_random: float
    """largest error at random places: looked for in another way"""


class View(NamedTuple):
    """What a settled view draws of a region, and its floors, in triangles."""

    drawn: int
    uncut: int
    """if tiles were drawn whole, what is outside of the picture too"""
    whole_tiles: int
    """if no rungs were drawn either"""
    tiles: int
    kinds: dict[str, int]
    """what the triangles drawn are of"""
    in_picture: int
    """of the meshes drawn, triangles with a corner in the picture; blocks draw more"""
    untextured: int
    """drawn if a tile's texture could be as coarse as it likes"""
    grids: int
    """drawn if each tile was the coarsest regular grid with its measured error"""
    pieces: int
    """greedy over each tile's posts, at what the view allows at its nearest point"""
    pieces_shown: int
    """of these, triangles with a corner in the picture"""
    posts: Greedy
    """one greedy mesh of all visible posts, each within the threshold at its own depth"""
    kept: Greedy
    """the same, refined until it keeps the threshold between posts too, as tiles do"""


def visible(
    world: World, region: int, view: ViewState, *, textured: bool = True
) -> dict[int, int]:
    """Return the rungs of what is drawn of a region and lies in the picture, by row."""
    records = world.records.copy()
    records["texel_m"] *= textured
    forests = dict.fromkeys(Lane, build_forest(records))
    drawn = ideal(forests, view, TAU_PX, TAU_PX)
    eye, found = eye_of(view), {}
    for row, rung in zip(drawn.terrain.tolist(), drawn.rungs().tolist(), strict=True):
        sphere = world.forest.centre[row], float(world.forest.radius_m[row])
        if bool(cells.contains(region, world.cell(row))) and is_visible(*sphere, eye):
            found[row] = rung
    return found


def per_view(world: World, ground: Ground, view: ViewState) -> View:
    """Count a view's triangles, and those of its floors."""
    seen = visible(world, ground.region, view)
    rows, eye = list(seen), eye_of(view)
    scale = scales_of(lens_of(view), world.tree)[rows]
    pieces = pieces_shown = in_picture = 0
    counts = {"whole leaves": 0, "rungs of leaves": 0, "inner cells": 0}
    for row, px_per_m in zip(rows, scale.tolist(), strict=True):
        cell, leaf = world.cell(row), not world.records["children"][row]
        bound_m = max(TAU_PX / px_per_m, float(world.records["error_m"][row]) * leaf)
        tile, posts = world.tile(row), world.posts(cell, rim=False)
        piece = plain(cell, posts, bound_m, leaf=leaf)
        pieces += len(piece.triangles)
        pieces_shown += shown(piece.points + piece.centre, piece.triangles, view)
        in_picture += shown(
            tile.mesh.local + tile.mesh.centre, tile.surface(seen[row]), view
        )
        whole = "rungs of leaves" if seen[row] else "whole leaves"
        counts[whole if leaf else "inner cells"] += world.drawn(row, tile, seen[row], eye)
    fewer = visible(world, ground.region, view, textured=False)
    return View(
        sum(counts.values()),
        sum(world.triangles(*one) for one in seen.items()),
        sum(map(world.triangles, rows)),
        len(rows),
        counts,
        in_picture,
        sum(world.drawn(row, world.tile(row), rung, eye) for row, rung in fewer.items()),
        grids_of(world, seen, eye),
        pieces,
        pieces_shown,
        *view_exact(ground, view),
    )


def shown(points: Floats, triangles: NDArray[Any], view: ViewState) -> int:
    """Count triangles with a corner in the picture, as a view's own mesh counts them."""
    return int(in_picture(points, view)[triangles].any(axis=1).sum())


def grids_of(world: World, seen: dict[int, int], eye: Eye) -> int:
    """Return what is drawn of the regular grids that are as good as some meshes."""
    found = 0
    for row, rung in seen.items():
        errors_m = world.tile(row).parts()["error_m"]
        goal_m = float(errors_m[min(rung, len(errors_m) - 1)])
        found += world.drawn(row, grid_tile(world, row, goal_m), 0, eye)
    return found


def ground_of(world: World, region: int) -> Ground:
    """Return what a view's greedy mesh of a region is made of."""
    west, south, east, north = (float(x) for x in cells.bounds_rad(region))
    lon, lat = np.array([west, east, west]), np.array([south, south, north])
    place = np.array(world.layer.pixels(lon, lat))
    lattice = place @ np.array([[1, -1, -1], [0, 1, 0], [0, 0, 1]])
    return Ground(region, world.posts(region, rim=False), world.truths(region), lattice)


def view_exact(ground: Ground, view: ViewState) -> tuple[Greedy, Greedy]:
    """Mesh all visible posts of a region, each within the threshold at its own depth.

    Returns
    -------
    One mesh that keeps the threshold at posts alone, and one that keeps it everywhere
    """
    uv = np.random.default_rng(1).random((BETWEEN, 2))
    shown = uv[in_picture(ground.surface(uv), view)]
    mesh, found = Meshed(ground, view, TAU_PX), []
    for close in (False, True):
        if close:
            mesh.close()
        at_random = float(mesh.errors_px(shown).max()) / TAU_PX
        found.append(Greedy(*mesh.exact(), at_random))
    return found[0], found[1]


def surface_at(
    cell: int, truths: list[Truth], uv: Floats
) -> tuple[NDArray[np.int64], Floats]:
    """Return places (n, 2) and points (n, 3) of the posts' surface at fractions of it."""
    at, points = snapped(uv), np.full((len(uv), 3), np.nan)
    for truth in truths:
        u, v, size = window_in(cell, truth.cell)
        there = (at / UV_ONE - (u, v)) / size
        mine = ((there >= 0) & (there <= 1)).all(axis=1)
        points[mine] = points_at(truth, there[mine]) + truth.centre
    return at, points


def views_of(world: World, region: int) -> Iterator[tuple[str, ViewState]]:
    """Views of a region: from high, from its edge, and low from before its edge.

    None is so near that a leaf would have to be finer than it is.
    """
    west, south, east, north = (float(x) for x in cells.bounds_rad(region))
    lon, size_m = (west + east) / 2, (north - south) * 6.37e6
    record = world.records[world.records["cell"] == region][0]
    top_m = float(record["max_height_m"])
    for share in (1.5, 0.7, 0.35):
        place = lon, (south + north) / 2
        yield f"down from {share} edges", view_at(top_m + share * size_m, place)
    for share, pitch_deg in ((0.25, -35.0), (0.03, -10.0)):
        place = lon, south - share * (north - south)
        view = view_at(top_m + share * size_m, place, pitch_deg)
        yield f"{pitch_deg:.0f} degrees from {share} edges above", view


def quantiles(values: Floats) -> str:
    """Return the middle, p90 and maximum as text."""
    p50, p90 = np.quantile(values, (0.5, 0.9))
    return f"median {p50:.2f}, p90 {p90:.2f}, max {values.max():.2f}"


def say(line: str) -> None:
    sys.stdout.write(f"\n{line}")


def report_tiles(world: World, count: int) -> dict[bool, dict[str, Floats]]:
    """Measure and print leaves and inner tiles."""
    found = {leaf: per_tile(world, count, leaf=leaf) for leaf in (True, False)}
    for leaf, parts in found.items():
        kind = "leaves" if leaf else "inner tiles"
        for name, values in parts.items():
            if len(values):
                say(f"{world.layer.name}: {len(values)} {kind}: {name} {quantiles(values)}")
    return found


def report_grids(world: World, count: int) -> dict[bool, Floats]:
    """Measure and print tiles against regular grids."""
    found = {}
    for leaf in (True, False):
        rows = [
            row
            for row in some(world.rows(leaves=leaf), count)
            if sum(t.points[..., 0].size for t in world.truths(world.cell(row)))
            < MOST_BELOW
        ]
        mine = np.array([world.triangles(row) for row in rows], float)
        found[leaf] = mine / np.array([grid_triangles(world, row) for row in rows], float)
        if rows:
            kind = "leaves" if leaf else "inner tiles"
            say(f"{world.layer.name}: {len(rows)} {kind} ÷ grid: {quantiles(found[leaf])}")
    return found


def report_views(world: World, region: int) -> list[View]:
    """Measure and print some views."""
    found, ground = [], ground_of(world, region)
    for name, view in views_of(world, region):
        one = per_view(world, ground, view)
        posts, kept = one.posts, one.kept
        found.append(one)
        say(
            f"{world.layer.name}: {name}: {one.drawn} triangles of {one.tiles} tiles "
            f"({one.kinds}; {one.untextured} by error), "
            f"÷ regular grids of the same errors {one.drawn / one.grids:.2f}, "
            f"÷ greedy by tiles {one.drawn / one.pieces:.2f}, "
            f"÷ one view-exact mesh {one.drawn / kept.triangles:.2f} "
            f"(in whole tiles {one.uncut / kept.triangles:.2f}, "
            f"without rungs {one.whole_tiles / kept.triangles:.2f}), "
            f"÷ one that keeps the threshold at posts alone "
            f"{one.drawn / posts.triangles:.2f} "
            f"(and errs by {posts.at_random:.2f} thresholds between them): that is "
            f"{one.pieces_shown / posts.triangles:.2f} for a bound a tile and its edges, "
            f"x {one.in_picture / one.pieces_shown:.2f} for its rungs and what is between "
            f"posts, x {one.drawn / one.in_picture:.2f} for blocks beside the picture"
        )
    return found


def region_of(world: World) -> int:
    """Return the largest inner cell in the source that may be meshed anew."""
    inner = world.rows(leaves=False)
    inner.sort(key=lambda row: int(cells.level(world.cell(row))))
    for row in inner:
        truths = world.truths(world.cell(row))
        if sum(truth.points[..., 0].size for truth in truths) <= MOST_BELOW:
            return world.cell(row)
    raise AssertionError


def around(path: Path, source: Path) -> Path:
    """Cut the posts of one cell, and a few around it, out of the middle of a raster."""
    with rasterio.open(source) as whole:
        lon, lat = whole.xy(whole.height // 2, whole.width // 2)
        cell = leaf_at(lon, lat, whole.res[1] * 111_000, REGION_POSTS)
        west, south, east, north = np.degrees(cells.bounds_rad(cell))
        a, _, left, _, e, top = tuple(whole.transform)[:6]
    first_col, last_col = int((west - left) / a), int((east - left) / a)
    first_row, last_row = int((north - top) / e), int((south - top) / e)
    corner = first_col - MARGIN_POSTS, first_row - MARGIN_POSTS
    shape = last_row - first_row + 2 * MARGIN_POSTS, last_col - first_col + 2 * MARGIN_POSTS
    return cut(path, source, corner, shape)


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Iterator[World]:
    """A bare store of a cell's worth of mountains, about 30 m apart."""
    folder = tmp_path_factory.mktemp("counts")
    source = around(folder / "langtang.tif", SAMPLES / "langtang.tif")
    path = folder / "world.geopage"
    ingest_rasters(path, [(source, EGM96)], workers=1)
    with Store(path) as store:
        yield World(store, "langtang")


@pytest.mark.slow
def test_tiles_take_few_more_triangles_than_greedy_insertion_over_posts(
    world: World,
) -> None:
    found = report_tiles(world, 12)
    assert np.median(found[True]["stated"]) < 1.15
    assert np.median(found[False]["stated"]) < 1.15
    # What the triangles above the floor are for.
    assert found[True]["breach"].max() > 1.0


@pytest.mark.slow
def test_tiles_take_fewer_triangles_than_regular_grids(world: World) -> None:
    found = report_grids(world, 2)
    # A rough leaf needs all posts, and its edges cut squares in two.
    assert found[True].max() < 1.15
    assert found[False].max() < 0.4


@pytest.mark.slow
def test_views_take_few_more_triangles_than_view_exact_meshes_and_far_fewer_than_grids(
    world: World,
) -> None:
    found = report_views(world, region_of(world))
    assert all(one.untextured <= one.drawn for one in found)
    # The mesh that a view's triangles count against keeps what tiles keep; and one that
    # does so at posts alone, which takes fewer, is no excuse either.
    assert all(one.kept.breach < 1.001 and one.kept.at_random < 1.1 for one in found)
    assert all(one.drawn <= MOST_DRAWN * one.kept.triangles for one in found)
    assert all(one.drawn <= MOST_DRAWN * one.posts.triangles for one in found)
    assert all(one.posts.breach > 1.0 for one in found)
    # A cell is finer than what its parent's bound asks for: rungs lie between.
    assert all(one.drawn <= one.uncut <= one.whole_tiles for one in found)
    assert any(one.drawn < 0.6 * one.whole_tiles for one in found)
    # Tiles at the picture's edges are drawn in part.
    assert any(one.drawn < 0.7 * one.uncut for one in found)
    assert all(one.drawn <= 0.2 * one.grids for one in found)


@pytest.mark.slow
@pytest.mark.skipif("GEOPAGE_STORE" not in os.environ, reason="names no store")
@pytest.mark.parametrize("name", ["langtang", "himalaya", "earth"])
def test_a_store_of_the_samples(name: str) -> None:
    with Store(os.environ["GEOPAGE_STORE"]) as store:
        one = World(store, name)
        if name != "earth":  # `view_exact` takes the ground as flat
            found = report_views(one, region_of(one))
            assert all(view.kept.breach < 1.001 for view in found)
            floors = [min(view.kept.triangles, view.posts.triangles) for view in found]
            both = zip(found, floors, strict=True)
            assert all(view.drawn <= MOST_DRAWN * floor for view, floor in both)
        report_tiles(one, 24)
        report_grids(one, 6)

# SPDX-License-Identifier: Apache-2.0
"""No background shows through the terrain, whatever is drawn beside what."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import moderngl
import numpy as np
import pytest

from geopage.draw_list import DrawList
from geopage.screen_error import lens_of
from geopage.selection import Flags, Thresholds, everything, select, trees_of
from geopage.tree import Tree
from tests.viewer.rough_world import make_store
from tiles import cells, terrain
from tiles.forest import Forest, build_forest
from tiles.index_tree import INDEX
from tiles.lanes import Lane
from tiles.store import Store
from tiles.surface import Surface
from viewer.arena import ArenaSize
from viewer.camera import Pose, view_state
from viewer.holes import hole_pixels
from viewer.renderer import Renderer

SIZE = (160, 120)
VIEWS, PARTS = 2000, 8
MOST_GONE = 6


@dataclass(frozen=True)
class Scene:
    """A store with all its terrain on the GPU."""

    renderer: Renderer
    surface: Surface
    trees: dict[Lane, Tree]
    forest: Forest
    lowest_m: float

    def list_for(self, pose: Pose, tau: float, uploaded: Flags) -> DrawList:
        """Select as the pager does, with some of the tiles."""
        view, limits = view_state(pose, SIZE), Thresholds(tau, tau)
        chosen = select(self.trees, lens_of(view), uploaded, limits)
        return chosen.draw_list(1, view, limits, settled=False)

    def holes(self, drawn: DrawList, pose: Pose) -> int:
        view = view_state(pose, SIZE)
        self.renderer.draw(drawn, view)
        return hole_pixels(self.renderer, view, self.lowest_m)


@pytest.fixture(scope="module")
def scene(
    gl_context: moderngl.Context, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Scene]:
    path = make_store(tmp_path_factory.mktemp("rough"))
    with Store(path) as store:
        forest = build_forest(store.index(Lane.TERRAIN))
        forests = {Lane.TERRAIN: forest, Lane.OBJECTS: build_forest(np.zeros(0, INDEX))}
        room = ArenaSize(96 << 20, 48 << 20, len(forest.records), 64)
        renderer = Renderer(forests, SIZE, room, context=gl_context)
        for row, record in enumerate(forest.records):
            key = int(record["cell"]), int(record["row"]), int(record["check"])
            tile = terrain.decode(store.checked_body(Lane.TERRAIN, *key))
            assert renderer.upload(Lane.TERRAIN, row, tile)
        lowest_m = float(forest.records["min_height_m"].min())
        yield Scene(renderer, Surface(store), trees_of(forests), forest, lowest_m)
        renderer.release()


def near(rng: np.random.Generator, lowest: float, highest: float) -> float:
    """A distance in radians, of any order of size, to either side."""
    return float(rng.choice([-1, 1]) * 10.0 ** rng.uniform(lowest, highest))


def random_place(scene: Scene, rng: np.random.Generator) -> tuple[float, float]:
    """Longitude and latitude: anywhere, fine ground, poles, antimeridian, zone corners."""
    kind = rng.integers(5)
    if kind == 0:
        return float(rng.uniform(-np.pi, np.pi)), float(np.arcsin(rng.uniform(-1, 1)))
    if kind == 1:
        fine = np.flatnonzero(cells.level(scene.forest.records["cell"]) >= 3)
        west, south, east, north = cells.bounds_rad(
            scene.forest.records["cell"][rng.choice(fine)]
        )
        return float(rng.uniform(west, east)), float(rng.uniform(south, north))
    if kind == 2:
        pole = rng.choice([-1, 1]) * (np.pi / 2 - abs(near(rng, -6, -0.5)))
        return float(rng.uniform(-np.pi, np.pi)), float(pole)
    if kind == 3:
        return near(rng, -7, -1) % (2 * np.pi) - np.pi, float(0.1 * rng.normal())
    corner = np.radians(45.0 * rng.integers((-3, -1), (4, 2)))
    return float(corner[0]) + near(rng, -7, -1), float(corner[1]) + near(rng, -7, -1)


def random_pose(scene: Scene, rng: np.random.Generator) -> Pose:
    """From 10 m above the finest ground to 10,000 km, looking anywhere."""
    lon, lat = random_place(scene, rng)
    height_m = scene.surface.height_at(lon, lat) + 10.0 ** rng.uniform(1, 7)
    pitch = np.radians(rng.uniform(-90, 30))
    if rng.random() < 0.3:
        pitch = min(-np.pi / 2 + rng.exponential(0.2), 0.5)
    return Pose(lon, lat, height_m, float(rng.uniform(0, 2 * np.pi)), float(pitch))


def some_tiles(scene: Scene, pose: Pose, rng: np.random.Generator) -> Flags:
    """Flags without all that lies below a few cells, most of them near the eye.

    What is drawn there instead lies beside the finest tiles: any pair of levels.
    """
    there = everything(scene.trees)
    cell = scene.forest.records["cell"]
    for _ in range(rng.integers(0, MOST_GONE)):
        top = int(rng.choice(cell))
        if rng.random() < 0.6:
            lon = pose.lon_rad + near(rng, -5, -1)
            lat = float(np.clip(pose.lat_rad + near(rng, -5, -1), -1.57, 1.57))
            top = int(cells.cell_at(lon, lat, int(rng.integers(0, 8))))
        there[Lane.TERRAIN][cells.contains(top, cell) & (cell != top)] = 0
    if rng.random() < 0.3:
        gone = rng.random(len(cell)) < 0.6 * rng.random()
        there[Lane.TERRAIN][gone & (cells.level(cell) > 0)] = 0
    return there


@pytest.mark.parametrize("part", range(PARTS))
def test_no_view_of_any_draw_list_has_a_hole(scene: Scene, part: int) -> None:
    rng = np.random.default_rng(part)
    holes, pairs = {}, set()
    level = cells.level(scene.forest.records["cell"])
    for i in range(VIEWS // PARTS):
        pose = random_pose(scene, rng)
        tau = float(10.0 ** rng.uniform(-0.5, 2.5))
        drawn = scene.list_for(pose, tau, some_tiles(scene, pose, rng))
        if found := scene.holes(drawn, pose):
            holes[i] = found, pose
        pairs |= neighbours(scene, drawn, level)
    assert holes == {}
    # Of levels 0 to 7, nearly all the 36 pairs met.
    assert len(pairs) >= 20


def neighbours(scene: Scene, drawn: DrawList, level: np.ndarray) -> set[tuple[int, int]]:
    """The pairs of levels that lie beside each other in a list, coarser first."""
    place = np.zeros(len(level), bool)
    place[drawn.terrain] = True
    row = np.repeat(drawn.terrain, 4)
    other = scene.forest.links[drawn.terrain].ravel()
    while (up := (other >= 0) & ~place[other]).any():
        other = np.where(up, scene.forest.parent[other], other)
    met = other >= 0
    return set(zip(level[other[met]].tolist(), level[row[met]].tolist(), strict=True))


def test_without_skirts_there_are_holes(scene: Scene) -> None:
    """The test above can fail."""
    rng, found = np.random.default_rng(1), 0
    for _ in range(60):
        pose = random_pose(scene, rng)
        drawn = scene.list_for(pose, 2.0, some_tiles(scene, pose, rng))
        drawn = replace(drawn, skirt_m=np.zeros_like(drawn.skirt_m))
        found += scene.holes(drawn, pose) > 0
    assert found > 3


def test_a_list_has_no_hole_in_other_views_either(scene: Scene) -> None:
    """The head turns and the eye moves on while a list is drawn."""
    rng = np.random.default_rng(7)
    for _ in range(150):
        pose = random_pose(scene, rng)
        drawn = scene.list_for(pose, 2.0, some_tiles(scene, pose, rng))
        turned = pose.heading_rad + float(rng.uniform(-3, 3))
        higher = pose.height_m + 10.0 ** rng.uniform(0, 6)
        assert not scene.holes(
            drawn, Pose(pose.lon_rad, pose.lat_rad, higher, turned, pose.pitch_rad)
        )

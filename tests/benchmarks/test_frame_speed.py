# SPDX-License-Identifier: Apache-2.0
"""What a frame costs with everything resident, on made-up tiles.

Run `pytest tests/benchmarks --benchmark-enable`; otherwise each runs once, as a test.
"""

import math
from collections.abc import Callable, Iterator

import moderngl
import numpy as np
import pytest

from tests.viewer.worlds import (
    ROOTS,
    World,
    boxes_tile,
    checker,
    make_world,
    terrain_tile,
    whole_list,
)
from tiles import cells
from tiles.lanes import Lane
from viewer.arena import ArenaSize
from viewer.camera import Pose, view_state
from viewer.frame_stats import FrameStats
from viewer.renderer import Renderer

SIZE = (960, 540)
ROOM = ArenaSize(vertex_bytes=64 << 20, index_bytes=32 << 20, layers=64, objects=1 << 16)
LON, LAT = 0.3, 0.2
BLOCKS, PER_BLOCK = 14, 25
VIEWS = {
    "globe": Pose(LON, LAT, 1e7, 0.0, -math.pi / 2),
    "low": Pose(LON, LAT, 2e4, 0.0, -0.7),
    "city": Pose(LON, LAT - 1.2e-4, 300.0, 0.0, -0.35),
    "street": Pose(LON, LAT, 10.0, 0.5, -0.05),
}
Benchmark = Callable[..., FrameStats]


def city() -> World:
    """A globe of 65 x 65 posts a zone, and 4,900 boxes in 196 tiles."""
    rng = np.random.default_rng(2)
    ground = [
        terrain_tile(int(cell), checker((90, 110, 70), (120, 110, 90)), 65)
        for cell in ROOTS
    ]
    step = 2e-5
    blocks = {}
    for row, col in np.ndindex(BLOCKS, BLOCKS):
        lon = LON + (col - BLOCKS / 2) * step
        lat = LAT + (row - BLOCKS / 2) * step
        i = np.arange(PER_BLOCK)
        places = np.zeros((PER_BLOCK, 3))
        places[:, 0] = lon + i % 5 * step / 6
        places[:, 1] = lat + i // 5 * step / 6
        sizes = rng.uniform((9, 9, 6), (15, 15, 30), (PER_BLOCK, 3))
        cell = int(cells.cell_at(lon + step / 3, lat + step / 3, 16))
        blocks.setdefault(cell, (places, sizes))
    return make_world(ground, [boxes_tile(cell, *block) for cell, block in blocks.items()])


@pytest.fixture(scope="module")
def scene(gl_context: moderngl.Context) -> Iterator[tuple[Renderer, World]]:
    world = city()
    renderer = Renderer(world.forests, SIZE, ROOM, context=gl_context)
    for row, ground in world.terrain.items():
        assert renderer.upload(Lane.TERRAIN, row, ground)
    for row, block in world.objects.items():
        assert renderer.upload(Lane.OBJECTS, row, block)
    yield renderer, world
    renderer.release()


@pytest.mark.parametrize("name", VIEWS)
def test_frame(benchmark: Benchmark, scene: tuple[Renderer, World], name: str) -> None:
    renderer, world = scene
    view = view_state(VIEWS[name], SIZE)
    drawn = whole_list(world, view, 0.5)
    stats = benchmark(renderer.draw, drawn, view)
    assert stats.triangles > 2000
    if name in ("city", "street"):
        assert stats.objects > 500
        assert (renderer.read_ids() < 0).mean() > 0.05


def test_pixels_without_depth_are_read_fast(
    benchmark: Callable[..., np.ndarray], scene: tuple[Renderer, World]
) -> None:
    renderer, world = scene
    view = view_state(VIEWS["globe"], SIZE)
    renderer.draw(whole_list(world, view), view)
    assert benchmark(renderer.read_empty).mean() > 0.3

# SPDX-License-Identifier: Apache-2.0
"""Renderers of small pictures over made-up worlds."""

from collections.abc import Callable, Iterator
from pathlib import Path

import moderngl
import pytest

from tests.viewer.screen import Screen, open_screen
from tests.viewer.small_world import make_store
from tests.viewer.worlds import World
from tiles.lanes import Lane
from viewer.arena import ArenaSize
from viewer.renderer import Renderer

SMALL = ArenaSize(vertex_bytes=16 << 20, index_bytes=8 << 20, layers=64, objects=4096)
Make = Callable[..., Renderer]


@pytest.fixture(scope="session")
def hill_store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a store of hills and a few blocks, for tests that only read it."""
    return make_store(tmp_path_factory.mktemp("hills"))


@pytest.fixture(scope="session")
def screen(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Screen]:
    """One virtual screen for all tests of windows."""
    with open_screen(tmp_path_factory.mktemp("screen")) as made:
        yield made


@pytest.fixture
def make_renderer(gl_context: moderngl.Context) -> Iterator[Make]:
    """Make a renderer with all tiles of a world uploaded."""
    made: list[Renderer] = []

    def make(
        world: World, size_px: tuple[int, int] = (320, 240), supersample: int = 1
    ) -> Renderer:
        renderer = Renderer(world.forests, size_px, SMALL, supersample, gl_context)
        made.append(renderer)
        for row, tile in world.terrain.items():
            assert renderer.upload(Lane.TERRAIN, row, tile)
        for row, tile in world.objects.items():
            assert renderer.upload(Lane.OBJECTS, row, tile)
        return renderer

    yield make
    for renderer in made:
        renderer.release()

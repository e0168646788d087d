# SPDX-License-Identifier: Apache-2.0
import resource
from pathlib import Path

import moderngl
import numpy as np
import pytest
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule
from PIL import Image

from tests.viewer.worlds import ROOTS, checker, globe, make_world, one_colour, terrain_tile
from tiles import cells
from tiles.lanes import Lane
from tiles.terrain import MIP_BYTES
from viewer.allocator import FirstFit
from viewer.arena import Arena, ArenaSize
from viewer.buffers import PINNED, LargeBuffer
from viewer.gl import Gl
from viewer.slots import FAR_PERIOD, NEAR_PERIOD, noise_of
from viewer.textures import decode_bc1

SIZE = 64


class AllocatorMachine(RuleBasedStateMachine):
    """Compare the allocator with a row of marked elements."""

    def __init__(self) -> None:
        super().__init__()
        self.room = FirstFit(SIZE)
        self.marks = np.zeros(SIZE, np.int64)
        self.taken: dict[int, int] = {}

    @rule(count=st.integers(1, 24))
    def take(self, count: int) -> None:
        free = [i for i in range(SIZE - count + 1) if not self.marks[i : i + count].any()]
        start = self.room.take(count)
        assert start == (free[0] if free else None)
        if start is not None:
            self.marks[start : start + count] = 1
            self.taken[start] = count

    @precondition(lambda self: self.taken)
    @rule(data=st.data())
    def give_back(self, data: st.DataObject) -> None:
        start = data.draw(st.sampled_from(sorted(self.taken)))
        count = self.taken.pop(start)
        self.room.give_back(start, count)
        self.marks[start : start + count] = 0

    @invariant()
    def free_ranges_are_the_unmarked_ones(self) -> None:
        edges = np.flatnonzero(np.diff(np.concatenate([[1], self.marks, [1]])))
        assert self.room.free == [tuple(pair) for pair in edges.reshape(-1, 2).tolist()]
        assert self.room.used == self.marks.sum()


TestAllocator = AllocatorMachine.TestCase


def test_giving_back_twice_is_refused() -> None:
    room = FirstFit(8)
    assert room.take(4) == 0
    room.give_back(0, 4)
    with pytest.raises(ValueError, match="free already"):
        room.give_back(0, 4)


def test_decoded_blocks_are_what_pillow_decodes(rng: np.random.Generator) -> None:
    blocks = rng.integers(0, 256, MIP_BYTES[2]).astype(np.uint8)
    oracle = np.asarray(
        Image.frombytes("RGBA", (64, 64), blocks.tobytes(), "bcn", 1, "DXT1")
    )
    ours = decode_bc1(blocks, 64)
    # Pillow may make the fourth colour of a three-colour block transparent black.
    assert np.abs(ours[..., :3].astype(int) - oracle[..., :3]).max() <= 1


def test_a_full_arena_takes_nothing(gl_context: moderngl.Context) -> None:
    world = globe(9)
    size = ArenaSize(vertex_bytes=16 * 250, index_bytes=1 << 16, layers=8, objects=8)
    arena = Arena(Gl(gl_context), world.forests, size)
    assert arena.put(Lane.TERRAIN, 0, world.terrain[0])
    assert arena.put(Lane.TERRAIN, 1, world.terrain[1])
    used = arena.used_bytes
    assert not arena.put(Lane.TERRAIN, 2, world.terrain[2])
    assert arena.used_bytes == used
    arena.free(Lane.TERRAIN, 0)
    assert arena.put(Lane.TERRAIN, 2, world.terrain[2])
    arena.release()


def test_an_arena_without_layers_gives_the_mesh_back(gl_context: moderngl.Context) -> None:
    world = globe(9)
    arena = Arena(Gl(gl_context), world.forests, ArenaSize(1 << 20, 1 << 20, 1, 8))
    assert arena.put(Lane.TERRAIN, 0, world.terrain[0])
    used = arena.used_bytes
    assert not arena.put(Lane.TERRAIN, 1, world.terrain[1])
    assert arena.used_bytes == used
    arena.release()


def test_used_bytes_are_those_of_the_tiles(gl_context: moderngl.Context) -> None:
    tile = terrain_tile(int(ROOTS[3]), one_colour((9, 9, 9)), 9)
    world = make_world([tile])
    arena = Arena(Gl(gl_context), world.forests, ArenaSize(1 << 20, 1 << 20, 4, 8))
    arena.put(Lane.TERRAIN, 0, tile)
    assert arena.used_bytes == tile.mesh.gpu_bytes + tile.texture.nbytes
    arena.release()


def test_a_tile_is_uploaded_once(gl_context: moderngl.Context) -> None:
    world = globe(5)
    arena = Arena(Gl(gl_context), world.forests, ArenaSize(1 << 20, 1 << 20, 4, 8))
    arena.put(Lane.TERRAIN, 0, world.terrain[0])
    with pytest.raises(ValueError, match="uploaded already"):
        arena.put(Lane.TERRAIN, 0, world.terrain[0])
    with pytest.raises(ValueError, match="not uploaded"):
        arena.free(Lane.TERRAIN, 1)
    arena.release()


def test_the_arena_shares_out_its_budget() -> None:
    size = ArenaSize.for_budget(512 << 20)
    textures = size.layers * sum(MIP_BYTES)
    assert size.vertex_bytes + size.index_bytes + textures <= 512 << 20
    assert 1000 < size.layers <= 2048


def test_grain_of_touching_cells_meets() -> None:
    west = int(cells.cell_at(0.3, 0.2, 18))
    east = int(cells.from_global(18, *np.add(cells.global_row_col(west), (0, 1))))
    parent = int(cells.ancestor(west, cells.level(west) - 1))
    west_u, _, patches = noise_of(west)
    assert FAR_PERIOD % NEAR_PERIOD == 0
    assert (west_u + patches) % FAR_PERIOD == noise_of(east)[0] % FAR_PERIOD
    assert noise_of(parent)[2] == 2 * patches


def test_checker_has_two_colours() -> None:
    texels = decode_bc1(checker((200, 0, 0), (0, 0, 200))[: MIP_BYTES[0]], 256)
    assert len(np.unique(texels.reshape(-1, 4), axis=0)) == 2


def resident_bytes() -> int:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize()


def test_room_costs_memory_only_where_a_tile_is(gl_context: moderngl.Context) -> None:
    gl = Gl(gl_context)
    if not gl.is_software or PINNED not in gl_context.extensions:
        pytest.skip("the driver keeps buffers in its own memory")
    before = resident_bytes()
    buffer = LargeBuffer(gl, 256 << 20)
    data = np.arange(1 << 20, dtype=np.uint8)
    gl.call("glNamedBufferSubData", buffer.name, 99 << 20, data.nbytes, data.ctypes.data)
    back = np.zeros(16, np.uint8)
    where = buffer.name, 99 << 20, back.nbytes, back.ctypes.data
    gl.call("glGetNamedBufferSubData", *where)
    assert np.array_equal(back, np.arange(16))
    assert resident_bytes() - before < 32 << 20
    buffer.release()

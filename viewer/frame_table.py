# SPDX-License-Identifier: Apache-2.0
"""A frame's GL calls: its programs, buffers and target, and the table that draws it."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from tiles.lanes import Lane
from viewer import gl, grain, passes
from viewer.arena import Arena
from viewer.gl import CallTable, Gl
from viewer.look import FRAME_ROWS, HEIGHT, HIGH_M
from viewer.target import Target

FIRST_DRAWS = 2048
PARTS = (*(Lane.OBJECTS,) * 3, *(Lane.TERRAIN,) * 5)
"""The frame's multi-draws, as `FrameTable._set_draws` fills them."""
JOINED = 3, 5
"""Parts that are shaded with the next one: every flush costs a little."""
PART_NAMES = (
    "objects",
    "objects",
    "objects that fade",
    "ground with grain and water",
    "ground with grain",
    "ground with water",
    "plain ground",
    "plain ground",
)


class FrameTable:
    """Everything on the GPU that draws a frame, tiles apart.

    `block` is the frame block of `frame.glsl`; a frame is drawn with what it holds then.
    With `one_by_one` the driver ends each part before the next, so that each has a time
    of its own; a frame then takes longer.
    """

    def __init__(self, calls: Gl, arena: Arena, size_px: tuple[int, int]) -> None:
        self._gl, self._arena, self._one_by_one = calls, arena, False
        self.target = Target(calls, size_px, (gl.RGBA8,))
        self.lanes = {
            lane: passes.LanePass(calls, arena, lane, FIRST_DRAWS) for lane in Lane
        }
        self._skies = [passes.make_sky_program(calls.context, one) for one in passes.SKIES]
        self._grain = grain.make_texture(calls)
        self._no_vertices = calls.create("glCreateVertexArrays")
        self.block = np.zeros(4 * FRAME_ROWS, np.float32)
        self._block_buffer = calls.context.buffer(reserve=self.block.nbytes)
        self._palette = calls.context.buffer(bytes(passes.PALETTE_BYTES))
        self._build()
        self._warm_up()

    def _build(self) -> None:
        """Write the table."""
        table = self._table = CallTable(self._gl)
        table.stamp()
        self.share(table)
        self._uploads = {lane: p.add_upload(table) for lane, p in self.lanes.items()}
        self.target.begin(table)
        if self._one_by_one:
            table.add("glFinish")
        table.stamp()
        self._draws = []
        for i, lane in enumerate(PARTS):
            program = self.lanes[lane].programs[0][0]
            self._draws.append(self.lanes[lane].add_draw(table, program))
            # A software driver then shades this part while it transforms the next.
            if self._one_by_one:
                table.add("glFinish")
            elif i not in JOINED:
                table.add("glFlush")
            table.stamp()
        self._sky = passes.add_sky(table, self._skies[0], self._no_vertices)
        table.stamp()
        table.add("glFinish")
        table.stamp()

    def set_one_by_one(self, *, is_on: bool) -> None:
        """Let the driver end each part before the next, or let parts overlap again."""
        self._one_by_one = is_on
        self._build()

    @property
    def stages_ms(self) -> dict[str, float]:
        """Time of each part of the last frame's GL calls."""
        names = ("draws' data, clearing", *PART_NAMES, "sky", "finish")
        found = dict.fromkeys(names, 0.0)
        for name, ns in zip(names, np.diff(self._table.stamps_ns).tolist(), strict=True):
            found[name] += ns / 1e6
        return found

    def _warm_up(self) -> None:
        """Draw an empty triangle with every program: drivers compile at the first use."""
        table = CallTable(self._gl)
        self.share(table)
        self.target.begin(table)
        for lane in self.lanes.values():
            lane.add_warm_up(table)
        for sky in self._skies:
            passes.add_sky(table, sky, self._no_vertices)
        table.add("glFinish")
        table.run()

    def is_back(self) -> bool:
        """Say whether GL is done and the frame waits for the GIL. Thread: any."""
        return self._table.is_back()

    def share(self, table: CallTable) -> None:
        """Append the calls that all passes share."""
        size = self.block.nbytes
        name = self._block_buffer.glo
        table.add("glNamedBufferSubData", name, 0, size, self.block.ctypes.data)
        table.add("glBindBufferBase", gl.UNIFORM_BUFFER, 0, name)
        table.add("glBindBufferBase", gl.UNIFORM_BUFFER, 1, self._palette.glo)
        table.add("glBindTextureUnit", 0, self._arena.textures.name)
        table.add("glBindTextureUnit", 1, self._grain)
        table.add("glBindTextureUnit", 2, self._arena.coats.name)
        passes.add_state(table)

    def set_palette(self, colours: NDArray[np.uint8]) -> None:
        """Take the colours of styled objects, (256, 3) uint8 sRGB."""
        whole = np.zeros((len(colours), 4), np.float32)
        whole[:, :3] = colours / 255
        self._palette.write(whole.tobytes())

    def resize(self, size_px: tuple[int, int]) -> None:
        """Draw into a target of another size from now on."""
        self.target.release()
        self.target = Target(self._gl, size_px, (gl.RGBA8,))
        self._build()

    def grow(self, draws: Mapping[Lane, int]) -> None:
        """Make room for a number of draws in each lane."""
        grown = [self.lanes[lane].grow(count) for lane, count in draws.items()]
        if any(grown):
            self._build()

    def run(
        self, counts: Mapping[Lane, int], fading: int, kinds: tuple[int, int, int]
    ) -> tuple[int, int]:
        """Draw; returns ns in GL, and ns from then until this thread had the GIL.

        Parameters
        ----------
        counts : draws of each lane
        fading : object draws at the end that fade
        kinds : terrain draws with grain and water, with grain, with water; others follow
        """
        self._set_draws(counts, fading, kinds)
        gil_ns = self._table.run()
        stamps = self._table.stamps_ns
        return int(stamps[-1] - stamps[0]), gil_ns

    def _set_draws(
        self, counts: Mapping[Lane, int], fading: int, kinds: tuple[int, int, int]
    ) -> None:
        for lane, count in counts.items():
            passes.set_upload(self._table, self._uploads[lane], count)
        is_high = int(self.block[HEIGHT] > HIGH_M)
        plain, wet, rough, wet_rough = self.lanes[Lane.TERRAIN].programs[is_high]
        solid, faded = self.lanes[Lane.OBJECTS].programs[0]
        programs = solid, solid, faded, wet_rough, rough, wet, plain, plain
        parts = passes.parts_of(counts[Lane.OBJECTS], fading, counts[Lane.TERRAIN], kinds)
        passes.set_sky(self._table, self._sky, self._skies[is_high], is_high)
        for draw, program, part in zip(self._draws, programs, parts, strict=True):
            passes.set_part(self._table, draw, program, *part)

    def release(self) -> None:
        """Free the GPU's memory."""
        self.target.release()
        for one in self.lanes.values():
            one.release()
        for sky in self._skies:
            sky.release()
        grain.release_texture(self._gl, self._grain)
        self._block_buffer.release()
        self._palette.release()

# SPDX-License-Identifier: Apache-2.0
"""The passes of a frame: their programs, and the GL calls that run them.

Each pass of a lane is one glMultiDrawElementsIndirect over the arena. Order: objects,
terrain, sky, so that what is near hides what is far before it is shaded.
"""

from importlib.resources import files
from itertools import chain

import moderngl
import numpy as np

from tiles.lanes import Lane
from tiles.mesh import VERTEX
from viewer import gl
from viewer.arena import Arena
from viewer.cull import COMMAND_WORDS, make_room
from viewer.draw_record import INSTANCE_FLOATS
from viewer.gl import CallTable, Gl

COMMAND_BYTES = 4 * COMMAND_WORDS
INSTANCE_BYTES = 4 * INSTANCE_FLOATS
BYTE, SHORT = 0x1400, 0x1402
# location, components, type, byte offset, kept as integers
VERTEX_INPUTS = (
    (0, 3, SHORT, 0, True),
    (1, 1, SHORT, 6, True),
    (2, 2, gl.UNSIGNED_SHORT, 8, True),
    (3, 3, BYTE, 12, False),
)
VARIANTS = {
    Lane.TERRAIN: (
        ("", "WATER", "GRAIN", "GRAIN WATER"),
        ("HIGH", "HIGH WATER", "HIGH GRAIN", "HIGH GRAIN WATER"),
    ),
    Lane.OBJECTS: (("", "FADE"),),
}
"""Of the terrain's shaders: near the ground, and above; plain, with water, with grain, and
with both. Of the objects': solid, and fading."""
SKIES = "", "HIGH"
SKY_VERTICES = 3, 194
"""Of one triangle, and of a ring; the sun's follow (sky.vert)."""
SCREEN = "pattern.glsl", "screen.glsl"
PROGRAM_ROW = -3
"""Where a multi-draw's glUseProgram is, seen from the multi-draw."""
LANE_NAME = {Lane.TERRAIN: "terrain", Lane.OBJECTS: "objects"}


def source(*names: str, define: str = "") -> str:
    """Return shader files joined; defines go after the first one."""
    folder = files("viewer.shaders")
    parts = [(folder / f"{name}").read_text("utf-8") for name in names]
    return "\n".join([parts[0], *(f"#define {one}" for one in define.split()), *parts[1:]])


def make_program(
    context: moderngl.Context, lane: Lane, define: str = ""
) -> moderngl.Program:
    """Return the program that shades a lane, in one of the `VARIANTS`."""
    name = LANE_NAME[lane]
    light = "frame.glsl", "colour.glsl", "air.glsl"
    vertex = *light, "vertex_inputs.glsl", f"{name}.vert"
    fragment = *light, "way.glsl", "water.glsl", "grain.glsl", *SCREEN
    return context.program(
        vertex_shader=source(*vertex, define=define),
        fragment_shader=source(*fragment, f"{name}.frag", define=define),
    )


def make_probe_program(context: moderngl.Context, lane: Lane) -> moderngl.Program:
    """Return the program that writes positions and ids of a lane."""
    names = "frame.glsl", "vertex_inputs.glsl", "probe.vert"
    return context.program(
        vertex_shader=source(*names, define=lane.name),
        geometry_shader=source("frame.glsl", "probe.geom"),
        fragment_shader=source("frame.glsl", "way.glsl", "pattern.glsl", "probe.frag"),
    )


def make_sky_program(context: moderngl.Context, define: str = "") -> moderngl.Program:
    """Return the program that shades what no tile covers, in one of `SKIES`."""
    names = "frame.glsl", "way.glsl", "air.glsl", *SCREEN, "sky.frag"
    return context.program(
        vertex_shader=source("frame.glsl", "sky.vert", define=define),
        fragment_shader=source(*names, define=define),
    )


class LanePass:
    """One lane's draws: commands, per-draw records, vertex layout, program."""

    def __init__(self, calls: Gl, arena: Arena, lane: Lane, draws: int) -> None:
        self._gl, self._arena = calls, arena
        self.programs = [
            [make_program(calls.context, lane, name) for name in names]
            for names in VARIANTS[lane]
        ]
        self.probe_program = make_probe_program(calls.context, lane)
        self.name = calls.create("glCreateVertexArrays")
        self._lay_out()
        self._make(draws)

    def _lay_out(self) -> None:
        add = self._gl.call
        buffers = self._arena.vertices.name, self._arena.indices.name
        add("glVertexArrayVertexBuffer", self.name, 0, buffers[0], 0, VERTEX.itemsize)
        add("glVertexArrayElementBuffer", self.name, buffers[1])
        for location, size, kind, offset, is_integer in VERTEX_INPUTS:
            head = self.name, location, size, kind
            if is_integer:
                add("glVertexArrayAttribIFormat", *head, offset)
            else:
                add("glVertexArrayAttribFormat", *head, 1, offset)
            add("glVertexArrayAttribBinding", self.name, location, 0)
            add("glEnableVertexArrayAttrib", self.name, location)
        for i in range(INSTANCE_FLOATS // 4):
            add("glVertexArrayAttribFormat", self.name, 4 + i, 4, gl.FLOAT, 0, 16 * i)
            add("glVertexArrayAttribBinding", self.name, 4 + i, 1)
            add("glEnableVertexArrayAttrib", self.name, 4 + i)
        add("glVertexArrayBindingDivisor", self.name, 1, 1)

    def grow(self, draws: int) -> bool:
        """Make room for a number of draws; says whether anything changed."""
        if draws <= len(self.room.keys):
            return False
        self.commands.release()
        self.instances.release()
        self._make(draws)
        return True

    def _make(self, draws: int) -> None:
        self.room = make_room(draws)
        context = self._gl.context
        self.commands = context.buffer(reserve=draws * COMMAND_BYTES, dynamic=True)
        self.instances = context.buffer(reserve=draws * INSTANCE_BYTES, dynamic=True)
        self._gl.call(
            "glVertexArrayVertexBuffer", self.name, 1, self.instances.glo, 0, INSTANCE_BYTES
        )

    def release(self) -> None:
        """Free the GPU's memory."""
        for part in (self.probe_program, self.commands, self.instances):
            part.release()
        for program in chain(*self.programs):
            program.release()
        names = np.array([self.name], np.uint32)
        self._gl.call("glDeleteVertexArrays", 1, names.ctypes.data)

    def add_upload(self, table: CallTable) -> tuple[int, int]:
        """Append the copies to the GPU; returns their rows, for `set_upload`."""
        rows = []
        for buffer, array in (
            (self.commands, self.room.commands),
            (self.instances, self.room.instances),
        ):
            where = buffer.glo, 0, 0, array.ctypes.data
            rows.append(table.add("glNamedBufferSubData", *where))
        return rows[0], rows[1]

    def add_draw(self, table: CallTable, program: moderngl.Program) -> int:
        """Append the multi-draw; returns its row, for `set_part`."""
        table.add("glUseProgram", program.glo)
        table.add("glBindVertexArray", self.name)
        table.add("glBindBuffer", gl.DRAW_INDIRECT_BUFFER, self.commands.glo)
        draw = gl.TRIANGLES, gl.UNSIGNED_SHORT, 0, 0, COMMAND_BYTES
        return table.add("glMultiDrawElementsIndirect", *draw)

    def add_warm_up(self, table: CallTable) -> None:
        """Append a draw of one triangle without area with every program."""
        self.room.commands[0] = (3, 1, 0, 0, 0)
        self.room.instances[0] = 0
        set_upload(table, self.add_upload(table), 1)
        for program in chain(*self.programs):
            set_part(table, self.add_draw(table, program), program, 0, 1)


def set_upload(table: CallTable, uploads: tuple[int, int], count: int) -> None:
    """Set how many draws a pass copies to the GPU."""
    table.change(uploads[0], 2, count * COMMAND_BYTES)
    table.change(uploads[1], 2, count * INSTANCE_BYTES)


def set_part(
    table: CallTable, draw: int, program: moderngl.Program, first: int, count: int
) -> None:
    """Set program and draws of a multi-draw that takes a part of a pass's commands."""
    table.change(draw + PROGRAM_ROW, 0, program.glo)
    table.change(draw, 2, first * COMMAND_BYTES)
    table.change(draw, 3, count)


def parts_of(
    objects: int, fading: int, terrain: int, kinds: tuple[int, int, int]
) -> tuple[tuple[int, int], ...]:
    """Return first draw and number of draws of each part of a frame.

    Halves of the solid objects, fading objects, three kinds of terrain (so many draws
    with grain and water, with grain, with water), and halves of the rest: a software
    driver shades one part while it transforms the vertices of the next.
    """
    fixed, ends = objects - fading, np.cumsum(kinds).tolist()
    half, middle = fixed // 2, (ends[2] + terrain) // 2
    return (
        (0, half),
        (half, fixed - half),
        (fixed, fading),
        *zip((0, *ends), kinds, strict=False),
        (ends[2], middle - ends[2]),
        (middle, terrain - middle),
    )


def add_state(table: CallTable) -> None:
    """Append the state that all passes share: reversed depth, culled backs, no blending."""
    table.add("glClipControl", gl.LOWER_LEFT, gl.ZERO_TO_ONE)
    table.add("glEnable", gl.DEPTH_TEST)
    table.add("glDepthFunc", gl.GEQUAL)
    table.add("glDepthMask", 1)
    table.add("glEnable", gl.CULL_FACE)
    table.add("glDisable", gl.BLEND)


def add_sky(table: CallTable, program: moderngl.Program, vertex_array: int) -> int:
    """Append the sky, where the depth is still infinite; returns its row, for `set_sky`."""
    table.add("glDepthMask", 0)
    table.add("glDisable", gl.CULL_FACE)
    row = table.add("glUseProgram", program.glo)
    table.add("glBindVertexArray", vertex_array)
    table.add("glDrawArrays", gl.TRIANGLE_STRIP, 0, SKY_VERTICES[0])
    table.add("glDrawArrays", gl.TRIANGLE_STRIP, SKY_VERTICES[1], 4)
    return row


def set_sky(table: CallTable, row: int, program: moderngl.Program, is_high: int) -> None:
    """Set the sky's program: one of the `SKIES`."""
    table.change(row, 0, program.glo)
    table.change(row + 2, 2, SKY_VERTICES[is_high])
    table.change(row + 3, 2, 4 * is_high)


PALETTE_BYTES = 256 * 16

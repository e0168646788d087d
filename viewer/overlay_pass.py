# SPDX-License-Identifier: Apache-2.0
"""Draws overlays on a finished frame: its own draws once more, and boxes of tiles."""

from collections.abc import Mapping

import moderngl
import numpy as np
from numpy.typing import NDArray

from geopage.draw_list import DrawList
from tiles.frames import WGS84_A_M, Ecef, Floats
from tiles.lanes import Lane
from viewer import gl, passes
from viewer.frame_table import FrameTable
from viewer.gl import CallTable, Gl
from viewer.overlay import Overlay

ENTRY = 12  # of an instance (viewer/draw_record.py)
ALL_OBJECTS = -1
WIRE = {Lane.TERRAIN: (1.0, 0.86, 0.25, 0.55), Lane.OBJECTS: (0.3, 0.95, 1.0, 0.6)}
HEAT = (0.0, 0.0, 0.0, 0.6)
"""Colours come from the error."""
PICKED = (1.0, 0.55, 0.05, 0.75)
BOX_FLOATS = 12
BOX_INPUTS = ((0, 0), (1, 16), (2, 32))
"""Location and byte offset of centre from the eye; half sides and stand-in; up."""
CORNERS = 24
"""Ends of the twelve edges of a box."""


def make_program(context: moderngl.Context, lane: Lane) -> moderngl.Program:
    """Return the program that paints a lane's draws in one colour each."""
    return context.program(
        vertex_shader=passes.source(
            "frame.glsl", "vertex_inputs.glsl", "overlay.vert", define=lane.name
        ),
        fragment_shader=passes.source("frame.glsl", "overlay.frag"),
    )


def make_box_program(context: moderngl.Context) -> moderngl.Program:
    """Return the program that draws the edges of boxes."""
    return context.program(
        vertex_shader=passes.source("frame.glsl", "box.vert"),
        fragment_shader=passes.source("frame.glsl", "overlay.frag"),
    )


class OverlayPass:
    """Programs and buffers of the overlays, made when the first one is switched on.

    Parameters
    ----------
    centre, box_m : (n, 3) and (n, 5) of the boxes of the terrain's rows, `tree.boxes_m`
    """

    def __init__(
        self, calls: Gl, frame: FrameTable, centre: Floats, box_m: NDArray[np.float32]
    ) -> None:
        self._gl, self._frame = calls, frame
        self._centre, self._box_m = centre, box_m
        self._programs = {lane: make_program(calls.context, lane) for lane in Lane}
        self._box_program = make_box_program(calls.context)
        self._boxes = calls.context.buffer(reserve=BOX_FLOATS * 4, dynamic=True)
        self._box_inputs = self._lay_out()

    def _lay_out(self) -> int:
        name = self._gl.create("glCreateVertexArrays")
        for location, offset in BOX_INPUTS:
            place = name, location
            self._gl.call("glVertexArrayAttribFormat", *place, 4, gl.FLOAT, 0, offset)
            self._gl.call("glVertexArrayAttribBinding", *place, 0)
            self._gl.call("glEnableVertexArrayAttrib", *place)
        self._gl.call("glVertexArrayBindingDivisor", name, 0, 1)
        return name

    def draw(
        self, shown: Overlay, drawn: DrawList, counts: Mapping[Lane, int], eye: Ecef
    ) -> None:
        """Draw what is on over the frame in the target.

        Parameters
        ----------
        drawn : the list that the frame was drawn from
        counts : draws of each lane
        eye : of the frame
        """
        self._eye = eye
        for what, is_on in (
            (self._heat, shown.heat),
            (self._picked, shown.picked is not None),
            (self._wireframe, shown.wireframe),
            (self._bounds, shown.bounds),
        ):
            if is_on:
                table = CallTable(self._gl)
                self._begin(table)
                what(table, shown, drawn, counts)
                table.add("glDisable", gl.BLEND)
                table.add("glFinish")
                table.run()

    def _begin(self, table: CallTable) -> None:
        self._frame.share(table)
        self._frame.target.bind(table)
        table.add("glDepthMask", 0)
        table.add("glEnable", gl.BLEND)
        blended = gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ZERO, gl.ONE
        table.add("glBlendFuncSeparate", *blended)

    def _paint(
        self,
        table: CallTable,
        lane: Lane,
        part: tuple[int, int],
        paint: tuple[float, ...],
        threshold_px: float = 0.0,
        only: int = ALL_OBJECTS,
    ) -> None:
        """Append draws of a lane, first and number, in one colour."""
        program = self._programs[lane]
        program["paint"], program["threshold_px"] = paint, threshold_px
        if lane is Lane.OBJECTS:
            program["only"] = only
        draw = self._frame.lanes[lane].add_draw(table, program)
        passes.set_part(table, draw, program, *part)

    def _heat(
        self, table: CallTable, _: Overlay, drawn: DrawList, counts: Mapping[Lane, int]
    ) -> None:
        part = 0, counts[Lane.TERRAIN]
        self._paint(table, Lane.TERRAIN, part, HEAT, max(drawn.threshold_px, 1e-3))

    def _wireframe(
        self, table: CallTable, _: Overlay, __: DrawList, counts: Mapping[Lane, int]
    ) -> None:
        table.add("glPolygonMode", gl.FRONT_AND_BACK, gl.LINE)
        for lane, count in counts.items():
            self._paint(table, lane, (0, count), WIRE[lane])
        table.add("glPolygonMode", gl.FRONT_AND_BACK, gl.FILL)

    def _picked(
        self,
        table: CallTable,
        shown: Overlay,
        drawn: DrawList,
        counts: Mapping[Lane, int],
    ) -> None:
        assert shown.picked
        row, ordinal = shown.picked
        room, count = self._frame.lanes[Lane.OBJECTS].room, counts[Lane.OBJECTS]
        entries = room.instances[room.commands[:count, 4], ENTRY].astype(np.int64)
        for at in np.flatnonzero(drawn.objects[entries] == row).tolist():
            self._paint(table, Lane.OBJECTS, (at, 1), PICKED, only=ordinal)

    def _bounds(
        self,
        table: CallTable,
        _: Overlay,
        drawn: DrawList,
        counts: Mapping[Lane, int],
    ) -> None:
        boxes = self._boxes_of(drawn, counts[Lane.TERRAIN])
        self._boxes.orphan(max(boxes.nbytes, 1))
        self._boxes.write(boxes.tobytes())
        inputs = self._box_inputs, 0, self._boxes.glo, 0, BOX_FLOATS * 4
        table.add("glVertexArrayVertexBuffer", *inputs)
        table.add("glUseProgram", self._box_program.glo)
        table.add("glBindVertexArray", self._box_inputs)
        table.add("glDrawArraysInstanced", gl.LINES, 0, CORNERS, len(boxes))

    def _boxes_of(self, drawn: DrawList, count: int) -> NDArray[np.float32]:
        room = self._frame.lanes[Lane.TERRAIN].room
        entries = np.unique(room.instances[room.commands[:count, 4], ENTRY])
        entries = entries.astype(np.int64)
        rows = drawn.terrain[entries]
        boxes = np.zeros((len(rows), BOX_FLOATS), np.float32)
        boxes[:, :3] = self._centre[rows] - self._eye
        boxes[:, 4:7] = self._box_m[rows, :3]
        boxes[:, 7] = drawn.stand_in[entries]
        boxes[:, 8:11] = self._centre[rows] / WGS84_A_M
        return boxes

    def release(self) -> None:
        """Free the GPU's memory."""
        for program in (*self._programs.values(), self._box_program):
            program.release()
        self._boxes.release()
        names = np.array([self._box_inputs], np.uint32)
        self._gl.call("glDeleteVertexArrays", 1, names.ctypes.data)

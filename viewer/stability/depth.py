# SPDX-License-Identifier: Apache-2.0
"""Depth from ten metres to ten thousand kilometres: which of two surfaces is in front."""

import math
from functools import partial

import numpy as np

from viewer import gl, passes
from viewer.camera import Pose, view_state
from viewer.gl import CallTable, Gl
from viewer.look import Look, frame_block
from viewer.stability.place import FOCAL_PX, Place
from viewer.stability.row import Finding, Row, first_bad
from viewer.target import Target

SIDE_PX = 4
TRIALS = 12
NEAR_M, FAR_M = 1.0, 2e7
VERTEX = """in vec3 seen; in float shade; out float grey;
void main() { grey = shade; gl_Position = to_clip(seen); }"""
FRAGMENT = """#version 430 core
in float grey; out vec4 colour; void main() { colour = vec4(grey, grey, grey, 1.0); }"""
CORNERS = np.array(((-9, -9), (9, -9), (9, 9), (-9, -9), (9, 9), (-9, 9)), np.float64)
QUAD = len(CORNERS)


class Depths:
    """Two quads, one behind the other, drawn with the renderer's projection and depth."""

    def __init__(self, calls: Gl) -> None:
        self._gl, context = calls, calls.context
        text = passes.source("frame.glsl") + VERTEX
        self._program = context.program(vertex_shader=text, fragment_shader=FRAGMENT)
        self._view = view_state(Pose(0.0, 0.0, 0.0, 0.0, 0.0), (SIDE_PX, SIDE_PX))
        self._block = context.buffer(frame_block(self._view, Look()).tobytes())
        self._buffer = context.buffer(reserve=2 * QUAD * 16, dynamic=True)
        layout = [(self._buffer, "3f 1f", "seen", "shade")]
        self._quads = context.vertex_array(self._program, layout)
        self._target = Target(calls, (SIDE_PX, SIDE_PX), (gl.RGBA8,))
        self._table = self._build()

    def _build(self) -> CallTable:
        table = CallTable(self._gl)
        self._target.begin(table)
        passes.add_state(table)
        table.add("glBindBufferBase", gl.UNIFORM_BUFFER, 0, self._block.glo)
        table.add("glUseProgram", self._program.glo)
        table.add("glBindVertexArray", self._quads.glo)
        table.add("glDrawArrays", gl.TRIANGLES, 0, 2 * QUAD)
        table.add("glFinish")
        return table

    def separates(self, away_m: float, gap_m: float) -> bool:
        """Say whether the nearer quad hides the other, whichever is drawn first."""
        return all(self._shows_nearer(away_m, gap_m, first) for first in (0, 1))

    def _shows_nearer(self, away_m: float, gap_m: float, first: int) -> bool:
        both = [self._quad(away_m, 1.0), self._quad(away_m + gap_m, 0.0)]
        data = np.concatenate((both[first], both[1 - first])).astype(np.float32)
        self._buffer.write(data.tobytes())
        self._table.run()
        whole = np.empty((SIDE_PX, SIDE_PX, 4), np.uint8)
        shown = self._target.read(0, (gl.RGBA, gl.UNSIGNED_BYTE), whole)
        return bool((shown[..., 0] == 255).all())

    def _quad(self, away_m: float, shade: float) -> np.ndarray:
        camera = np.column_stack((CORNERS * away_m, np.full(QUAD, -away_m)))
        return np.column_stack((camera @ self._view.rotation, np.full(QUAD, shade)))

    def release(self) -> None:
        """Free the GPU's memory."""
        self._target.release()
        for one in (self._quads, self._buffer, self._block, self._program):
            one.release()


def standard_gap_m(away_m: float) -> float:
    """Return the least gap that a standard projection and 24 bits of depth separate."""

    def stored(d: float) -> int:
        return round(FAR_M / (FAR_M - NEAR_M) * (1.0 - NEAR_M / d) * 2**24)

    gap_m = first_bad(lambda g: stored(away_m) == stored(away_m + g), 1e-9 * away_m, FAR_M)
    return FAR_M if math.isnan(gap_m) else gap_m


def separation(place: Place, away_m: float) -> Finding:
    """Move the farther quad closer until one of some trials is wrong."""
    tried_m = (away_m * np.random.default_rng(2).uniform(1.0, 1.5, TRIALS)).tolist()
    depths, pixel_m = Depths(place.session.renderer.gl), away_m / FOCAL_PX
    wrong = sum(not depths.separates(d, pixel_m) for d in tried_m)
    gaps_m = [least_gap_m(depths, d, pixel_m) for d in tried_m]
    depths.release()
    others_m = [standard_gap_m(d) for d in tried_m]
    most_m = max(others_m)
    note = "the worst practical case is the width of one pixel at that distance; standard"
    note += (
        f" depth needs {most_m:,.2g} m" if most_m < FAR_M else " depth tells nothing apart"
    )
    lost = sum(gap_m > pixel_m for gap_m in others_m)
    return Finding(pixel_m, wrong, max(gaps_m), others=lost, note=note)


def least_gap_m(depths: Depths, away_m: float, most_m: float) -> float:
    """Return the least gap that is separated at a distance."""
    gap_m = first_bad(lambda g: not depths.separates(away_m, g), 1e-9 * away_m, most_m)
    return most_m if math.isnan(gap_m) else gap_m


ROWS = tuple(
    Row(
        f"depth at {name}",
        "near and far surfaces mix: standard depth, 24 bits, near plane at 1 m",
        "gap between two surfaces, m",
        f"pairs of {TRIALS} of which the farther one shows",
        0.0,
        partial(separation, away_m=away_m),
        more_is_harder=False,
    )
    for name, away_m in (("10 m", 1e1), ("1 km", 1e3), ("100 km", 1e5), ("10,000 km", 1e7))
)

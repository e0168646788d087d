# SPDX-License-Identifier: Apache-2.0
"""Copies a picture to a window with the steps of its edges softened."""

import moderngl
import numpy as np

from geopage.view import ViewState
from viewer import gl, passes
from viewer.gl import CallTable, Gl
from viewer.target import Target


def make_program(context: moderngl.Context) -> moderngl.Program:
    """Return the program that softens edges."""
    return context.program(
        vertex_shader=passes.source("frame.glsl", "sky.vert"),
        fragment_shader=passes.source("frame.glsl", "smooth.frag"),
    )


def is_same(view: ViewState, other: ViewState) -> bool:
    """Say whether two views show the same from the same place."""
    same = np.array_equal(view.eye, other.eye)
    return same and np.array_equal(view.rotation, other.rotation)


class Smoother:
    """The pass that stands for a plain copy."""

    def __init__(self, calls: Gl) -> None:
        self._gl = calls
        self._program = make_program(calls.context)
        self._no_vertices = calls.context.vertex_array(self._program, [])

    def copy(self, picture: Target, framebuffer: int) -> None:
        """Draw a target's first attachment into a framebuffer of the same size."""
        self._program["pixel"] = 1 / picture.width_px, 1 / picture.height_px
        table = CallTable(self._gl, 16)
        table.add("glBindFramebuffer", gl.FRAMEBUFFER, framebuffer)
        table.add("glViewport", 0, 0, picture.width_px, picture.height_px)
        for state in (gl.FRAMEBUFFER_SRGB, gl.DEPTH_TEST, gl.CULL_FACE, gl.BLEND):
            table.add("glDisable", state)
        table.add("glBindTextureUnit", 0, picture.textures[0])
        table.add("glUseProgram", self._program.glo)
        table.add("glBindVertexArray", self._no_vertices.glo)
        table.add("glDrawArrays", gl.TRIANGLES, 0, 3)
        table.run()

    def release(self) -> None:
        """Free the GPU's memory."""
        self._no_vertices.release()
        self._program.release()

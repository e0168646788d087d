# SPDX-License-Identifier: Apache-2.0
"""Framebuffers with a 32-bit float depth, and reading them back without the GIL."""

import numpy as np
from numpy.typing import NDArray

from viewer import gl
from viewer.gl import CallTable, Gl

NO_COLOUR = np.zeros(4, np.float32)
NO_ID = np.zeros(4, np.int32)
FAR = np.zeros(1, np.float32)


class Target:
    """Colour attachments of some formats and a depth attachment, all of one size."""

    def __init__(
        self, calls: Gl, size_px: tuple[int, int], formats: tuple[int, ...]
    ) -> None:
        self._gl = calls
        self.width_px, self.height_px = size_px
        self.formats = formats
        self.name = calls.create("glCreateFramebuffers")
        self._buffers: list[int] = []
        for i, kind in enumerate(formats):
            self._attach(gl.COLOR_0 + i, kind)
        self._attach(gl.DEPTH_ATTACHMENT, gl.DEPTH_32F)
        colours = np.arange(gl.COLOR_0, gl.COLOR_0 + len(formats), dtype=np.uint32)
        calls.call(
            "glNamedFramebufferDrawBuffers", self.name, len(formats), colours.ctypes.data
        )
        state = calls.call("glCheckNamedFramebufferStatus", self.name, gl.FRAMEBUFFER)
        if state & 0xFFFF != gl.FRAMEBUFFER_COMPLETE:
            raise RuntimeError(f"framebuffer is incomplete: {state & 0xFFFF:#06x}")

    def _attach(self, point: int, kind: int) -> None:
        buffer = self._gl.create("glCreateRenderbuffers")
        size = self.width_px, self.height_px
        self._gl.call("glNamedRenderbufferStorage", buffer, kind, *size)
        self._gl.call(
            "glNamedFramebufferRenderbuffer", self.name, point, gl.RENDERBUFFER, buffer
        )
        self._buffers.append(buffer)

    def begin(self, table: CallTable) -> None:
        """Append the calls that clear this target and draw to it."""
        table.add("glBindFramebuffer", gl.FRAMEBUFFER, self.name)
        table.add("glViewport", 0, 0, self.width_px, self.height_px)
        for i, kind in enumerate(self.formats):
            clear = "glClearNamedFramebufferfv", NO_COLOUR.ctypes.data
            if kind == gl.R32I:
                clear = "glClearNamedFramebufferiv", NO_ID.ctypes.data
            table.add(clear[0], self.name, gl.COLOR, i, clear[1])
        table.add("glClearNamedFramebufferfv", self.name, gl.DEPTH, 0, FAR.ctypes.data)

    def read(
        self, attachment: int, kind: tuple[int, int], into: NDArray[np.generic]
    ) -> NDArray[np.generic]:
        """Copy an attachment into a C-contiguous array and return it, top row first.

        Parameters
        ----------
        kind : GL format and type that `into`, (height, width, ...), holds
        """
        table = CallTable(self._gl, 8)
        table.add("glBindFramebuffer", gl.FRAMEBUFFER, self.name)
        table.add("glNamedFramebufferReadBuffer", self.name, gl.COLOR_0 + attachment)
        table.add("glPixelStorei", gl.PACK_ALIGNMENT, 1)
        size = self.width_px, self.height_px
        table.add("glReadPixels", 0, 0, *size, *kind, into.ctypes.data)
        table.run()
        return into[::-1]

    def release(self) -> None:
        """Free the GPU's memory."""
        names = np.array([self.name, *self._buffers], np.uint32)
        self._gl.call("glDeleteFramebuffers", 1, names.ctypes.data)
        self._gl.call("glDeleteRenderbuffers", len(names) - 1, names[1:].ctypes.data)

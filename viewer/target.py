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
        self.textures = [
            self._attach(gl.COLOR_0 + i, kind) for i, kind in enumerate(formats)
        ]
        self._depth = self._attach_depth()
        colours = np.arange(gl.COLOR_0, gl.COLOR_0 + len(formats), dtype=np.uint32)
        calls.call(
            "glNamedFramebufferDrawBuffers", self.name, len(formats), colours.ctypes.data
        )
        state = calls.call("glCheckNamedFramebufferStatus", self.name, gl.FRAMEBUFFER)
        if state & 0xFFFF != gl.FRAMEBUFFER_COMPLETE:
            raise RuntimeError(f"framebuffer is incomplete: {state & 0xFFFF:#06x}")

    def _attach(self, point: int, kind: int) -> int:
        name = self._gl.create("glCreateTextures", gl.TEXTURE_2D)
        size = self.width_px, self.height_px
        self._gl.call("glTextureStorage2D", name, 1, kind, *size)
        filtered = gl.NEAREST if kind == gl.R32I else gl.LINEAR
        for parameter, value in (
            (gl.MIN_FILTER, filtered),
            (gl.MAG_FILTER, filtered),
            (gl.WRAP_S, gl.CLAMP_TO_EDGE),
            (gl.WRAP_T, gl.CLAMP_TO_EDGE),
        ):
            self._gl.call("glTextureParameteri", name, parameter, value)
        self._gl.call("glNamedFramebufferTexture", self.name, point, name, 0)
        return name

    def _attach_depth(self) -> int:
        name = self._gl.create("glCreateRenderbuffers")
        size = self.width_px, self.height_px
        self._gl.call("glNamedRenderbufferStorage", name, gl.DEPTH_32F, *size)
        place = self.name, gl.DEPTH_ATTACHMENT, gl.RENDERBUFFER
        self._gl.call("glNamedFramebufferRenderbuffer", *place, name)
        return name

    def bind(self, table: CallTable) -> None:
        """Append the calls that draw to this target."""
        table.add("glBindFramebuffer", gl.FRAMEBUFFER, self.name)
        table.add("glViewport", 0, 0, self.width_px, self.height_px)

    def begin(self, table: CallTable) -> None:
        """Append the calls that clear this target and draw to it."""
        self.bind(table)
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

    def depth_at(self, x: int, y: int) -> float:
        """Return the depth of one pixel, counted from the top left corner."""
        depth, table = np.zeros(1, np.float32), CallTable(self._gl, 4)
        table.add("glBindFramebuffer", gl.FRAMEBUFFER, self.name)
        kind = gl.DEPTH_COMPONENT, gl.FLOAT
        row = self.height_px - 1 - y
        table.add("glReadPixels", x, row, 1, 1, *kind, depth.ctypes.data)
        table.run()
        return float(depth[0])

    def blit(self, framebuffer: int, size_px: tuple[int, int]) -> None:
        """Copy the first colour attachment as it is to another framebuffer.

        Parameters
        ----------
        framebuffer : GL name, 0 for the window's
        size_px : its width and height, to which the picture is scaled
        """
        table = CallTable(self._gl, 8)
        # The attachment is encoded for the screen already.
        table.add("glDisable", gl.FRAMEBUFFER_SRGB)
        table.add("glNamedFramebufferReadBuffer", self.name, gl.COLOR_0)
        table.add("glBindFramebuffer", gl.READ_FRAMEBUFFER, self.name)
        table.add("glBindFramebuffer", gl.DRAW_FRAMEBUFFER, framebuffer)
        source, to = (0, 0, self.width_px, self.height_px), (0, 0, *size_px)
        kind = gl.NEAREST if source == to else gl.LINEAR
        table.add("glBlitFramebuffer", *source, *to, gl.COLOR_BIT, kind)
        table.add("glBindFramebuffer", gl.FRAMEBUFFER, framebuffer)
        table.run()

    def release(self) -> None:
        """Free the GPU's memory."""
        for call, names in (
            ("glDeleteFramebuffers", [self.name]),
            ("glDeleteRenderbuffers", [self._depth]),
            ("glDeleteTextures", self.textures),
        ):
            some = np.array(names, np.uint32)
            self._gl.call(call, len(some), some.ctypes.data)

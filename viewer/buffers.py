# SPDX-License-Identifier: Apache-2.0
"""Large GPU buffers that cost memory only where something was written."""

import mmap

import numpy as np

from viewer import gl
from viewer.gl import Gl

PINNED = "GL_AMD_pinned_memory"
EXTERNAL_VIRTUAL_MEMORY = 0x9160


class LargeBuffer:
    """A buffer of fixed size.

    A software driver fills a new buffer with zeros, so 200 MiB of room would be 200 MiB
    of the process at once. There, the buffer is made of fresh pages of our own, which
    the system provides when they are first written.
    """

    def __init__(self, calls: Gl, nbytes: int) -> None:
        self._gl = calls
        self.name = calls.create("glCreateBuffers")
        self._pages: mmap.mmap | None = None
        if calls.is_software and PINNED in calls.context.extensions:
            self._pages = mmap.mmap(-1, nbytes)
            address = np.frombuffer(self._pages, np.uint8).ctypes.data
            calls.call("glBindBuffer", EXTERNAL_VIRTUAL_MEMORY, self.name)
            data = nbytes, address, gl.DYNAMIC_DRAW
            calls.call("glBufferData", EXTERNAL_VIRTUAL_MEMORY, *data)
            calls.call("glBindBuffer", EXTERNAL_VIRTUAL_MEMORY, 0)
        else:
            calls.call("glNamedBufferData", self.name, nbytes, 0, gl.DYNAMIC_DRAW)
        calls.check("making a large buffer")

    def release(self) -> None:
        """Free the memory."""
        names = np.array([self.name], np.uint32)
        self._gl.call("glDeleteBuffers", 1, names.ctypes.data)
        self._pages = None

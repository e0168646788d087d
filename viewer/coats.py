# SPDX-License-Identifier: Apache-2.0
"""Colours of objects: an entry of the palette for each, beside the tiles.

The entries of own objects lie in one buffer on the GPU, in the order of the arena's
object pool; those of proxies go with their draws. So a style is put on or taken off
between two frames, and no tile is read, decoded or uploaded for it.
"""

import numpy as np
from numpy.typing import NDArray

from geopage.styling import Styling
from viewer import gl
from viewer.gl import Gl
from viewer.slots import ObjectPool


class Coats:
    """The entries of all uploaded objects and of all proxies. Thread: render.

    Parameters
    ----------
    records : (n,) INDEX of the objects' forest
    pool : where the arena keeps uploaded objects
    """

    def __init__(self, calls: Gl, records: NDArray[np.void], pool: ObjectPool) -> None:
        self._gl, self._records, self._pool = calls, records, pool
        self._styling: Styling | None = None
        self._entries = np.zeros(len(pool.records), np.uint8)
        self.proxies = np.zeros((max(len(records), 1), 4), np.uint8)
        """(n, 4) entry of the proxy for each child"""
        self._buffer = calls.context.buffer(self._entries.tobytes(), dynamic=True)
        self.name = calls.create("glCreateTextures", gl.TEXTURE_BUFFER)
        calls.call("glTextureBuffer", self.name, gl.R8UI, self._buffer.glo)

    def set_styling(self, styling: Styling | None) -> None:
        """Give every object its entry of a style; None: its own colour."""
        self._styling = styling
        self._entries[:] = 0
        self.proxies[:] = 0
        if styling:
            self._entries[:] = styling.of_objects(self._pool.numbers)
            rows = np.flatnonzero(self._records["proxies"])
            self.proxies[rows] = styling.of_children(self._records["cell"][rows])
        self._buffer.write(self._entries.tobytes())

    def put(self, slot: np.void) -> None:
        """Give the objects of a tile that has just come into the pool their entries."""
        first, count = int(slot["pool_start"]), int(slot["pool_count"])
        if self._styling and count:
            entries = self._styling.of_objects(self._pool.numbers[first : first + count])
            self._write(first, entries)

    def _write(self, first: int, entries: NDArray[np.uint8]) -> None:
        self._entries[first : first + len(entries)] = entries
        place = entries.ctypes.data
        self._gl.call("glNamedBufferSubData", self._buffer.glo, first, len(entries), place)

    def release(self) -> None:
        """Free the GPU's memory."""
        names = np.array([self.name], np.uint32)
        self._gl.call("glDeleteTextures", 1, names.ctypes.data)
        self._buffer.release()

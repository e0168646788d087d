# SPDX-License-Identifier: Apache-2.0
"""What a frame shows, in numbers: its draws once more, into ids and positions."""

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from tiles.frames import Floats
from tiles.lanes import Lane
from viewer import gl, passes
from viewer.gl import CallTable, Gl
from viewer.target import Target


class Probes:
    """Targets of ids and positions, one for each fineness that was asked for."""

    def __init__(
        self, calls: Gl, size_px: tuple[int, int], lanes: Mapping[Lane, passes.LanePass]
    ) -> None:
        self._gl, self._size_px, self._lanes = calls, size_px, lanes
        self._targets: dict[int, Target] = {}
        self._drawn: set[int] = set()

    def get(self, divide: int) -> tuple[Target, bool]:
        """Return the target of a fraction of the picture's size, and if it is drawn."""
        if divide not in self._targets:
            size = self._size_px[0] // divide, self._size_px[1] // divide
            self._targets[divide] = Target(self._gl, size, (gl.RGBA32F, gl.R32I))
        is_drawn = divide in self._drawn
        self._drawn.add(divide)
        return self._targets[divide], is_drawn

    def forget(self) -> None:
        """Say that the next frame was drawn."""
        self._drawn.clear()

    def draw(
        self,
        target: Target,
        share: Callable[[CallTable], None],
        counts: Mapping[Lane, int],
    ) -> None:
        """Draw the frame's commands into a target.

        Parameters
        ----------
        share : appends the calls that all passes share
        counts : draws of each lane
        """
        table = CallTable(self._gl)
        share(table)
        target.begin(table)
        for lane, count in counts.items():
            program = self._lanes[lane].probe_program
            draw = self._lanes[lane].add_draw(table, program)
            passes.set_part(table, draw, program, 0, count)
        table.add("glFinish")
        table.run()

    def release(self) -> None:
        """Free the GPU's memory."""
        for target in self._targets.values():
            target.release()


def ids_of(target: Target) -> NDArray[np.int32]:
    """Return the ids in a target, (h, w) int32."""
    whole = np.empty((target.height_px, target.width_px), np.int32)
    ids = target.read(1, (gl.RED_INTEGER, gl.INT), whole)
    return np.ascontiguousarray(ids, np.int32)


def seen_of(target: Target) -> Floats:
    """Return the points in a target, (h, w, 4): m from the eye; 1, or 0 where none."""
    whole = np.empty((target.height_px, target.width_px, 4), np.float32)
    return target.read(0, (gl.RGBA, gl.FLOAT), whole).astype(np.float64)

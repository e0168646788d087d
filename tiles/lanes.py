# SPDX-License-Identifier: Apache-2.0
"""The two lanes that share one design: terrain and objects."""

from enum import IntEnum


class Lane(IntEnum):
    """Which kind of tile; the number is stored on disk."""

    TERRAIN = 0
    OBJECTS = 1

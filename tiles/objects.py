# SPDX-License-Identifier: Apache-2.0
"""The object tile: a cell's own objects, largest first, and a proxy for each child.

The index buffer is `own objects, largest bounding dimension first | proxies`, so that
"draw everything larger than the threshold" is a prefix, and a proxy is one range.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tiles.codec import header_of, pack, unpack
from tiles.errors import TileFault
from tiles.lanes import Lane
from tiles.mesh import Mesh

OBJECT = np.dtype(
    [
        ("id", "<i8"),  # row of the object in the store's object table
        ("centre", "<f4", 3),  # tile-local, ECEF axes, m
        ("radius_m", "<f4"),
        ("dimension_m", "<f4"),  # bounding dimension
        ("index_end", "<u4"),  # its indices end here; they begin where the last ended
    ]
)
PROXY = np.dtype(
    [
        ("child", "<u4"),  # 0..3, which child cell it stands for
        ("dimension_m", "<f4"),
        ("error_m", "<f4"),  # measured distance to the real buildings
        ("index_start", "<u4"),
        ("index_end", "<u4"),
        ("count", "<u4"),  # buildings that it stands for
    ]
)
ZSTD_LEVEL = 3
"""Takes half the time of 5, for a twentieth more bytes."""
PROXY_ORDINAL = 65535
"""`detail[1]` of a proxy's vertices; own objects carry their ordinal in the tile."""


@dataclass(frozen=True, slots=True)
class ObjectTile:
    """The data of one object cell."""

    cell: int
    mesh: Mesh
    objects: NDArray[np.void]
    """(n,) OBJECT, largest first"""
    proxies: NDArray[np.void]
    """(p,) PROXY, p <= 4"""


def encode(tile: ObjectTile) -> bytes:
    """Return the stored body of a tile."""
    head = header_of(Lane.OBJECTS, tile.cell, tile.mesh)
    head["object_count"], head["proxy_count"] = len(tile.objects), len(tile.proxies)
    head["error_m"] = tile.proxies["error_m"].max() if len(tile.proxies) else 0.0
    tables = tile.objects.tobytes(), tile.proxies.tobytes()
    return pack(head, tile.mesh, *tables, zstd_level=ZSTD_LEVEL)


def decode(body: bytes) -> ObjectTile:
    """Return the tile of a stored body, as views on the decompressed bytes."""
    head, mesh, tail = unpack(Lane.OBJECTS, body)
    n, p = int(head["object_count"]), int(head["proxy_count"])
    if len(tail) != n * OBJECT.itemsize + p * PROXY.itemsize:
        raise TileFault("OBJECTS", str(int(head["cell"])), "its tables have another length")
    objects = np.frombuffer(tail, OBJECT, n)
    proxies = np.frombuffer(tail, PROXY, p, n * OBJECT.itemsize)
    return ObjectTile(int(head["cell"]), mesh, objects, proxies)


def prefix_end(objects: NDArray[np.void], dimension_m: float) -> int:
    """Return the number of indices that draw every own object larger than `dimension_m`."""
    count = int(np.searchsorted(-objects["dimension_m"], -dimension_m, side="left"))
    return int(objects["index_end"][count - 1]) if count else 0

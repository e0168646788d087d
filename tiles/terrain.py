# SPDX-License-Identifier: Apache-2.0
"""The terrain tile: a mesh within a measured error, its skirt and its surface texture.

Between the error of a leaf and that of its parent lies a factor of ten and more. So a leaf
may have rungs: coarser meshes over the same vertices, each with a measured error of its
own, for views that need no more.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tiles.codec import header_of, pack, unpack
from tiles.errors import TileFault
from tiles.index_tree import RUNG_FIELDS
from tiles.lanes import Lane
from tiles.mesh import Mesh

TEXTURE_SIDE = 256
"""Texels along an edge; a cell's texel is then as large as its error bound, edge / 256."""
MIP_SIDES = (256, 128, 64, 32, 16, 8, 4)
MIP_BYTES = tuple((side // 4) ** 2 * 8 for side in MIP_SIDES)
TEXTURE_BYTES = sum(MIP_BYTES)
"""Bytes of a BC1 (DXT1) texture with its mip levels, finest first."""
RUNG = np.dtype(
    [
        ("error_m", "<f4"),
        ("first_index", "<u4"),
        ("surface_index_count", "<u4"),
        ("index_count", "<u4"),  # skirt included
    ]
)
MOST_RUNGS = len(RUNG_FIELDS)


def no_rungs() -> NDArray[np.void]:
    """Return an empty table of rungs."""
    return np.zeros(0, RUNG)


@dataclass(frozen=True, slots=True)
class TerrainTile:
    """The data of one terrain cell."""

    cell: int
    mesh: Mesh
    """`detail` holds u (west to east) and v (south to north), 0..UV_ONE"""
    surface_index_count: int
    """Indices of the surface; those after it are the skirt's, then the rungs'."""
    error_m: float
    """Measured largest distance to the finest source, int16 rounding included."""
    texel_m: float
    """Size of a texel where a finer tile's texture shows more, else 0."""
    texture: NDArray[np.uint8]
    """(TEXTURE_BYTES,) BC1 blocks, row 0 south, sRGB, relief shading baked in"""
    rungs: NDArray[np.void] = field(default_factory=no_rungs)
    """(r,) RUNG, finer first"""

    def parts(self) -> NDArray[np.void]:
        """Return what can be drawn, as RUNG: the whole mesh, then the rungs."""
        count = int(self.rungs["first_index"].min(initial=len(self.mesh.indices)))
        whole = np.array([(self.error_m, 0, self.surface_index_count, count)], RUNG)
        return np.concatenate([whole, self.rungs])

    def surface(self, rung: int = 0) -> NDArray[np.uint16]:
        """Return a part's triangles, (t, 3), skirts apart; of the last if it has fewer."""
        parts = self.parts()
        part = parts[min(rung, len(parts) - 1)]
        first = int(part["first_index"])
        last = first + int(part["surface_index_count"])
        return self.mesh.indices[first:last].reshape(-1, 3)


def encode(tile: TerrainTile) -> bytes:
    """Return the stored body of a tile."""
    head = header_of(Lane.TERRAIN, tile.cell, tile.mesh)
    head["error_m"], head["texel_m"] = tile.error_m, tile.texel_m
    head["surface_index_count"] = tile.surface_index_count
    return pack(head, tile.mesh, tile.texture.tobytes(), tile.rungs.tobytes())


def decode(body: bytes) -> TerrainTile:
    """Return the tile of a stored body, as views on the decompressed bytes."""
    head, mesh, tail = unpack(Lane.TERRAIN, body)
    more = len(tail) - TEXTURE_BYTES
    whole = more >= 0 and more % RUNG.itemsize == 0 and more <= MOST_RUNGS * RUNG.itemsize
    if not whole or head["surface_index_count"] > head["index_count"]:
        raise TileFault("TERRAIN", str(int(head["cell"])), "its parts have another length")
    rungs = np.frombuffer(tail, RUNG, offset=TEXTURE_BYTES)
    ends = rungs["first_index"].astype(np.int64) + rungs["index_count"]
    if (ends > head["index_count"]).any():
        raise TileFault("TERRAIN", str(int(head["cell"])), "a rung beyond its indices")
    return TerrainTile(
        int(head["cell"]),
        mesh,
        int(head["surface_index_count"]),
        float(head["error_m"]),
        float(head["texel_m"]),
        np.frombuffer(tail, np.uint8, TEXTURE_BYTES),
        rungs,
    )

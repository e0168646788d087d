# SPDX-License-Identifier: Apache-2.0
"""The terrain tile: a mesh within a measured error, its skirt and its surface texture."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tiles.codec import header_of, pack, unpack
from tiles.errors import TileFault
from tiles.lanes import Lane
from tiles.mesh import Mesh

TEXTURE_SIDE = 256
"""Texels along an edge; a cell's texel is then as large as its error bound, edge / 256."""
MIP_SIDES = (256, 128, 64, 32, 16, 8, 4)
MIP_BYTES = tuple((side // 4) ** 2 * 8 for side in MIP_SIDES)
TEXTURE_BYTES = sum(MIP_BYTES)
"""Bytes of a BC1 (DXT1) texture with its mip levels, finest first."""


@dataclass(frozen=True, slots=True)
class TerrainTile:
    """The data of one terrain cell."""

    cell: int
    mesh: Mesh
    """`detail` holds u (west to east) and v (south to north), 0..UV_ONE"""
    surface_index_count: int
    """Indices of the surface; those after it are the skirt's."""
    error_m: float
    """Measured largest distance to the finest source, int16 rounding included."""
    texel_m: float
    """Size of a texel where a finer tile's texture shows more, else 0."""
    texture: NDArray[np.uint8]
    """(TEXTURE_BYTES,) BC1 blocks, row 0 south, sRGB, relief shading baked in"""


def encode(tile: TerrainTile) -> bytes:
    """Return the stored body of a tile."""
    head = header_of(Lane.TERRAIN, tile.cell, tile.mesh)
    head["error_m"], head["texel_m"] = tile.error_m, tile.texel_m
    head["surface_index_count"] = tile.surface_index_count
    return pack(head, tile.mesh, tile.texture.tobytes())


def decode(body: bytes) -> TerrainTile:
    """Return the tile of a stored body, as views on the decompressed bytes."""
    head, mesh, tail = unpack(Lane.TERRAIN, body)
    if len(tail) != TEXTURE_BYTES or head["surface_index_count"] > head["index_count"]:
        raise TileFault("TERRAIN", str(int(head["cell"])), "its parts have another length")
    return TerrainTile(
        int(head["cell"]),
        mesh,
        int(head["surface_index_count"]),
        float(head["error_m"]),
        float(head["texel_m"]),
        np.frombuffer(tail, np.uint8),
    )

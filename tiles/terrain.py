# SPDX-License-Identifier: Apache-2.0
"""The terrain tile: a mesh within a measured error, its skirt and its surface texture.

Between the error of a leaf and that of its parent lies a factor of ten and more. So a leaf
may have rungs: coarser meshes over the same vertices, each with a measured error of its
own, for views that need no more.

The triangles of each mesh are sorted into blocks, and its skirt's by sides
(tiles/blocks.py), so that a view draws only those that it can see.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from tiles.blocks import (
    BLOCK,
    FEWEST,
    MOST_PIECES,
    SKIRT_PIECES,
    in_blocks,
    in_sides,
    slimness,
    spots_of,
)
from tiles.codec import header_of, pack, unpack
from tiles.errors import TileFault
from tiles.index_tree import RUNG_FIELDS
from tiles.lanes import Lane
from tiles.mesh import Mesh

MOST_IN_BLOCK = np.iinfo(BLOCK["count"]).max
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


def no_pieces() -> NDArray[np.void]:
    """Return what a tile has whose meshes are drawn whole."""
    return np.zeros((0, SKIRT_PIECES), BLOCK)


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
    pieces: NDArray[np.void] = field(default_factory=no_pieces)
    """(1 + r, MOST_PIECES) BLOCK of the whole mesh and its rungs: blocks, then the parts of
    the skirt's sides; (1 + r, SKIRT_PIECES) where surfaces are small; or none"""

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


def in_pieces(tile: TerrainTile) -> TerrainTile:
    """Return a tile whose meshes' triangles are sorted into what views may leave out."""
    parts, mesh = tile.parts(), tile.mesh
    most = int(parts["surface_index_count"].max()) // 3
    if most > MOST_IN_BLOCK:
        return replace(tile, pieces=no_pieces())
    indices, pieces = mesh.indices.copy(), []
    spots, slim = spots_of(mesh.vertices, mesh.centre), slimness(tile.cell)
    for first, count, total in parts[
        ["first_index", "surface_index_count", "index_count"]
    ].tolist():
        surface, walls = np.split(
            indices[first : first + total].reshape(-1, 3), [count // 3]
        )
        skirt = in_sides(walls, mesh.vertices, spots)
        if skirt is None:
            return replace(tile, pieces=no_pieces())
        walls[:], sides = skirt
        if tile.surface_index_count >= 3 * FEWEST:
            surface[:], blocks = in_blocks(surface, mesh.vertices, spots, slim)
            sides = np.concatenate([blocks, sides])
        pieces.append(sides)
    return replace(tile, mesh=replace(mesh, indices=indices), pieces=np.stack(pieces))


def encode(tile: TerrainTile) -> bytes:
    """Return the stored body of a tile."""
    head = header_of(Lane.TERRAIN, tile.cell, tile.mesh)
    head["error_m"], head["texel_m"] = tile.error_m, tile.texel_m
    head["surface_index_count"] = tile.surface_index_count
    head["object_count"] = tile.pieces.shape[1] if len(tile.pieces) else 0
    tail = tile.texture, tile.rungs, tile.pieces
    return pack(head, tile.mesh, *(one.tobytes() for one in tail))


def decode(body: bytes) -> TerrainTile:
    """Return the tile of a stored body, as views on the decompressed bytes.

    Raises
    ------
    TileFault
    """
    head, mesh, tail = unpack(Lane.TERRAIN, body)
    rungs, pieces = _tables(head, tail)
    tile = TerrainTile(
        int(head["cell"]),
        mesh,
        int(head["surface_index_count"]),
        float(head["error_m"]),
        float(head["texel_m"]),
        np.frombuffer(tail, np.uint8, TEXTURE_BYTES),
        rungs,
        pieces,
    )
    _require_parts(tile)
    return tile


def _tables(head: np.void, tail: memoryview) -> tuple[NDArray[np.void], NDArray[np.void]]:
    """Return rungs and pieces; how many rungs there are, the length says."""
    count = int(head["object_count"])
    of_mesh = count * BLOCK.itemsize
    rungs, rest = divmod(len(tail) - TEXTURE_BYTES - of_mesh, RUNG.itemsize + of_mesh)
    if (
        rest
        or not 0 <= rungs <= MOST_RUNGS
        or count
        not in (
            0,
            SKIRT_PIECES,
            MOST_PIECES,
        )
    ):
        raise TileFault("TERRAIN", str(int(head["cell"])), "its parts have another length")
    end = TEXTURE_BYTES + rungs * RUNG.itemsize
    table = np.frombuffer(tail[:end], RUNG, offset=TEXTURE_BYTES)
    return table, np.frombuffer(tail[end:], BLOCK).reshape(-1, count or SKIRT_PIECES)


def _require_parts(tile: TerrainTile) -> None:
    """Check that the tables name what is there."""
    parts = tile.parts()
    first, surface, whole = (
        parts[name].astype(np.int64)
        for name in ("first_index", "surface_index_count", "index_count")
    )
    fault = None
    if surface[0] > whole[0]:
        fault = "its parts have another length"
    elif (first + whole > len(tile.mesh.indices)).any() or (surface > whole).any():
        fault = "a rung beyond its indices"
    elif len(tile.pieces):
        counts = 3 * tile.pieces["count"].astype(np.int64)
        blocks, sides = counts[:, :-SKIRT_PIECES], counts[:, -SKIRT_PIECES:]
        if blocks.size and (blocks.sum(axis=1) != surface).any():
            fault = "its blocks are not its surface"
        elif (sides.sum(axis=1) != whole - surface).any():
            fault = "its sides are not its skirt"
    if fault:
        raise TileFault("TERRAIN", str(tile.cell), fault)

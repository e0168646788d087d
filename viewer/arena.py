# SPDX-License-Identifier: Apache-2.0
"""GPU memory for tiles: one vertex buffer, one index buffer, one array of textures."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tiles import cells
from tiles.forest import Forest
from tiles.index_tree import INDEX
from tiles.lanes import Lane
from tiles.mesh import VERTEX, Mesh
from tiles.objects import ObjectTile
from tiles.terrain import TEXTURE_BYTES, TerrainTile
from viewer.allocator import FirstFit
from viewer.buffers import LargeBuffer
from viewer.coats import Coats
from viewer.gl import Gl
from viewer.slots import ObjectPool, make_pieces, make_slots, noise_of, put_parts
from viewer.textures import MAX_LAYERS, TextureLayers, shows_water

INDEX_BYTES = 2
MIB = 1 << 20


@dataclass(frozen=True, slots=True)
class ArenaSize:
    """Room of the arena."""

    vertex_bytes: int = 160 * MIB
    index_bytes: int = 64 * MIB
    layers: int = 768
    objects: int = 400_000

    @staticmethod
    def for_budget(budget_bytes: int) -> "ArenaSize":
        """Share out a byte budget as an average world needs it."""
        layers = int(np.clip(budget_bytes * 0.2 // TEXTURE_BYTES, 64, MAX_LAYERS))
        left = budget_bytes - layers * TEXTURE_BYTES
        return ArenaSize(int(left * 0.7), int(left * 0.28), layers, left // 512)


class Arena:
    """Holds the meshes and textures of uploaded tiles, and their slots by forest row.

    Fresh pages of the buffers are not touched before a tile is put there, so on a
    software driver the process grows only with what is uploaded.
    """

    def __init__(self, gl: Gl, forests: dict[Lane, Forest], size: ArenaSize) -> None:
        self._gl = gl
        self.vertices = LargeBuffer(gl, size.vertex_bytes)
        self.indices = LargeBuffer(gl, size.index_bytes)
        self._vertex_room = FirstFit(size.vertex_bytes // VERTEX.itemsize)
        self._index_room = FirstFit(size.index_bytes // INDEX_BYTES)
        self.textures = TextureLayers(gl, size.layers)
        self.pieces = make_pieces(self.textures.count)
        """(layers, 1 + MOST_RUNGS, MOST_PIECES) BLOCK of each texture layer's tile"""
        self.pool = ObjectPool(size.objects)
        records = {lane: forest.records for lane, forest in forests.items()}
        none = np.zeros(0, INDEX)
        self.coats = Coats(gl, records.get(Lane.OBJECTS, none), self.pool)
        counts = {lane: len(rows) for lane, rows in records.items()}
        self.slots = {lane: make_slots(counts.get(lane, 0)) for lane in Lane}

    def put(self, lane: Lane, row: int, tile: TerrainTile | ObjectTile) -> bool:
        """Copy a tile to the GPU; False, and nothing taken, where there is no room."""
        slot = self.slots[lane][row]
        if slot["uploaded"]:
            raise ValueError(f"row {row} of {lane.name} is uploaded already")
        if not self._put_mesh(slot, tile.mesh):
            return False
        if isinstance(tile, TerrainTile):
            fits = self._put_terrain(slot, tile)
        else:
            fits = self.pool.put(slot, tile)
            if fits:
                self.coats.put(slot)
            slot["seed"] = hash(tile.cell) & 0xFFFFF
        if not fits:
            self._free_mesh(slot)
            return False
        slot["uploaded"] = 1
        return True

    def _put_mesh(self, slot: np.void, mesh: Mesh) -> bool:
        base = self._vertex_room.take(len(mesh.vertices))
        if base is None:
            return False
        first = self._index_room.take(len(mesh.indices))
        if first is None:
            self._vertex_room.give_back(base, len(mesh.vertices))
            return False
        self._write(self.vertices.name, base * VERTEX.itemsize, mesh.vertices)
        self._write(self.indices.name, first * INDEX_BYTES, mesh.indices)
        slot["centre"], slot["scale_m"] = mesh.centre, mesh.scale_m
        slot["base_vertex"], slot["vertex_count"] = base, len(mesh.vertices)
        slot["first_index"], slot["index_count"] = first, len(mesh.indices)
        return True

    def _put_terrain(self, slot: np.void, tile: TerrainTile) -> bool:
        layer = self.textures.put(tile.texture)
        if layer is None:
            return False
        slot["layer"], slot["noise"] = layer, noise_of(tile.cell)
        slot["box_rad"] = cells.bounds_rad(tile.cell)
        slot["wet"] = shows_water(tile.texture)
        slot["surface_count"] = tile.surface_index_count
        put_parts(slot, self.pieces[layer], tile)
        return True

    def _write(self, buffer: int, offset: int, data: NDArray[np.generic]) -> None:
        whole = np.ascontiguousarray(data)
        if whole.nbytes:
            self._gl.call(
                "glNamedBufferSubData", buffer, offset, whole.nbytes, whole.ctypes.data
            )

    def free(self, lane: Lane, row: int) -> None:
        """Give a tile's memory back; no frame that draws it may be unfinished."""
        slot = self.slots[lane][row]
        if not slot["uploaded"]:
            raise ValueError(f"row {row} of {lane.name} is not uploaded")
        self._free_mesh(slot)
        if lane is Lane.TERRAIN:
            self.textures.give_back(int(slot["layer"]))
        else:
            self.pool.give_back(slot)
        slot["uploaded"] = 0

    def _free_mesh(self, slot: np.void) -> None:
        self._vertex_room.give_back(int(slot["base_vertex"]), int(slot["vertex_count"]))
        self._index_room.give_back(int(slot["first_index"]), int(slot["index_count"]))

    def release(self) -> None:
        """Free the GPU's memory."""
        self.vertices.release()
        self.indices.release()
        self.coats.release()
        names = np.array([self.textures.name], np.uint32)
        self._gl.call("glDeleteTextures", 1, names.ctypes.data)

    @property
    def used_bytes(self) -> int:
        """Bytes of vertices, indices and textures that uploaded tiles take."""
        vertices = self._vertex_room.used * VERTEX.itemsize
        return vertices + self._index_room.used * INDEX_BYTES + self.textures.used_bytes

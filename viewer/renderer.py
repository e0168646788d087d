# SPDX-License-Identifier: Apache-2.0
"""From a draw list and the newest pose to pixels, without ever waiting for a tile."""

import time

import moderngl
import numpy as np
from numpy.typing import NDArray

from geopage.draw_list import DrawList
from geopage.tree import half_sides_m
from geopage.view import ViewState
from tiles.forest import Forest
from tiles.frames import Ecef, Floats
from tiles.lanes import Lane
from tiles.objects import ObjectTile
from tiles.terrain import TerrainTile
from viewer import cull, gil, gl, grain, passes
from viewer.arena import Arena, ArenaSize
from viewer.clearance import Clearance, Drawn
from viewer.frame_stats import FrameStats
from viewer.gl import CallTable, Gl
from viewer.look import HEIGHT, Look, frame_block
from viewer.probes import Probes, ids_of, seen_of
from viewer.target import Target

FIRST_DRAWS = 2048
PARTS = (*(Lane.OBJECTS,) * 3, *(Lane.TERRAIN,) * 3)
"""The frame's multi-draws, as `Renderer._set_draws` fills them."""
DRAWS_PER_OBJECT_TILE = 5  # its own objects and four proxies


class Renderer:
    """Draws without a window, on the thread that made it.

    Parameters
    ----------
    forests : the lanes' forests; draw lists name their rows
    size_px : width and height of the picture
    arena : room for tiles
    supersample : pixels of the drawing along each edge of a pixel of the picture
    context : a moderngl context; without one, a headless one is made
    """

    def __init__(
        self,
        forests: dict[Lane, Forest],
        size_px: tuple[int, int],
        arena: ArenaSize | None = None,
        supersample: int = 1,
        context: moderngl.Context | None = None,
    ) -> None:
        self._owns_context = context is None
        self.gl = Gl(context or gl.open_headless())
        self.forests = forests
        self._half_m = {lane: half_sides_m(forests[lane], lane) for lane in forests}
        self.size_px, self._supersample = size_px, supersample
        self.look = Look()
        self.arena = Arena(self.gl, forests, arena or ArenaSize())
        self._clearance = Clearance(self.gl, self.arena)
        drawn = size_px[0] * supersample, size_px[1] * supersample
        self._target = Target(self.gl, drawn, (gl.RGBA8,))
        self._lanes = {
            lane: passes.LanePass(self.gl, self.arena, lane, FIRST_DRAWS) for lane in Lane
        }
        self._probes = Probes(self.gl, size_px, self._lanes)
        self._sky = passes.make_sky_program(self.gl.context)
        self._grain = grain.make_texture(self.gl)
        self._no_vertices = self.gl.create("glCreateVertexArrays")
        self._block = np.zeros(passes.FRAME_FLOATS, np.float32)
        self._block_buffer = self.gl.context.buffer(reserve=self._block.nbytes)
        self._palette = self.gl.context.buffer(bytes(passes.PALETTE_BYTES))
        self._build()
        self._drawn: tuple[ViewState, dict[Lane, int]] | None = None
        self._warm_up()
        self.gl.check("making the renderer")

    def _build(self) -> None:
        """Write the frame's table of GL calls."""
        table = self._table = CallTable(self.gl)
        table.stamp()
        self._share(table)
        self._uploads = {lane: p.add_upload(table) for lane, p in self._lanes.items()}
        self._target.begin(table)
        self._draws = []
        for lane in PARTS:
            program = self._lanes[lane].programs[0][0]
            self._draws.append(self._lanes[lane].add_draw(table, program))
            # A software driver then shades this part while it transforms the next.
            table.add("glFlush")
        passes.add_sky(table, self._sky, self._no_vertices)
        table.add("glFinish")
        table.stamp()

    def _warm_up(self) -> None:
        """Draw an empty triangle with every program: drivers compile at the first use."""
        table = CallTable(self.gl)
        self._share(table)
        self._target.begin(table)
        for lane in self._lanes.values():
            lane.add_warm_up(table)
        passes.add_sky(table, self._sky, self._no_vertices)
        table.add("glFinish")
        table.run()

    def _share(self, table: CallTable) -> None:
        size = self._block.nbytes
        name = self._block_buffer.glo
        table.add("glNamedBufferSubData", name, 0, size, self._block.ctypes.data)
        table.add("glBindBufferBase", gl.UNIFORM_BUFFER, 0, name)
        table.add("glBindBufferBase", gl.UNIFORM_BUFFER, 1, self._palette.glo)
        table.add("glBindTextureUnit", 0, self.arena.textures.name)
        table.add("glBindTextureUnit", 1, self._grain)
        passes.add_state(table)

    def set_palette(self, colours: NDArray[np.uint8]) -> None:
        """Take the colours of styled objects, (256, 3) uint8 sRGB."""
        whole = np.zeros((len(colours), 4), np.float32)
        whole[:, :3] = colours / 255
        self._palette.write(whole.tobytes())

    def upload(self, lane: Lane, row: int, tile: TerrainTile | ObjectTile) -> bool:
        """Copy a tile to the GPU; False where the arena has no room (try again later)."""
        self.gl.guard()
        return self.arena.put(lane, row, tile)

    def free(self, lane: Lane, row: int) -> None:
        """Give a tile's memory back; no list that will be drawn may name it."""
        self.arena.free(lane, row)
        if lane is Lane.TERRAIN:
            self._clearance.forget(row)

    def is_uploaded(self, lane: Lane, row: int) -> bool:
        """Say whether a tile is on the GPU."""
        return bool(self.arena.slots[lane][row]["uploaded"])

    def draw(self, draw_list: DrawList, view: ViewState) -> FrameStats:
        """Draw a list as seen in a view, and wait for the GPU without the GIL."""
        if (view.width_px, view.height_px) != self.size_px:
            raise ValueError(f"the view is not {self.size_px} pixels")
        start = time.perf_counter()
        terrain, objects = self._cull(draw_list, view)
        culled = time.perf_counter()
        counts = {Lane.TERRAIN: terrain[0], Lane.OBJECTS: objects[0]}
        self._block[:] = frame_block(view, self.look, self._supersample)
        self._set_draws(counts, terrain[3], objects[3])
        with gil.interval(gil.SHARE_S):
            gil_ns = self._table.run()
        stamps = self._table.stamps_ns
        self._drawn = view, counts
        self._probes.forget()
        entries = self._lanes[Lane.TERRAIN].room.instances[: terrain[0], 12]
        return FrameStats(
            triangles=terrain[1] + objects[1],
            draw_calls=terrain[0] + objects[0],
            tiles=terrain[0],
            objects=objects[2],
            fading=objects[3],
            stand_ins=int(draw_list.stand_in[entries.astype(np.int64)].sum()),
            screen_error_px=terrain[2],
            cull_ms=(culled - start) * 1e3,
            gl_ms=(stamps[-1] - stamps[0]) / 1e6,
            gil_ms=gil_ns / 1e6,
            frame_ms=(time.perf_counter() - start) * 1e3,
        )

    def _set_draws(self, counts: dict[Lane, int], grained: int, fading: int) -> None:
        """Write the frame's counts into its table: objects, grained terrain, the rest."""
        for lane, count in counts.items():
            passes.set_upload(self._table, self._uploads[lane], count)
        is_high = int(self._block[HEIGHT] > passes.HIGH_M)
        plain, rough = self._lanes[Lane.TERRAIN].programs[is_high]
        solid, faded = self._lanes[Lane.OBJECTS].programs[0]
        programs = solid, solid, faded, rough, plain, plain
        parts = passes.parts_of(counts[Lane.OBJECTS], fading, counts[Lane.TERRAIN], grained)
        for draw, program, part in zip(self._draws, programs, parts, strict=True):
            passes.set_part(self._table, draw, program, *part)

    def _cull(
        self, draw_list: DrawList, view: ViewState
    ) -> tuple[tuple[int, int, float, int], tuple[int, int, int, int]]:
        eye = cull.eye_of(view, draw_list.sweep)
        grown = self._lanes[Lane.TERRAIN].grow(len(draw_list.terrain))
        objects = DRAWS_PER_OBJECT_TILE * len(draw_list.objects)
        if self._lanes[Lane.OBJECTS].grow(objects) or grown:
            self._build()
        ground = self._lists(Lane.TERRAIN, draw_list.terrain)
        room = self._lanes[Lane.TERRAIN].room
        picture_px = float(view.width_px * view.height_px)
        terrain = cull.cull_terrain(ground, draw_list.skirt_m, eye, picture_px, room)
        children = self.forests[Lane.TERRAIN].children
        drawn = Drawn(ground.rows, ground.slots, ground.records, children)
        self._clearance.apply(room.instances[: terrain[0]], drawn, eye.place)
        parts = draw_list.own, draw_list.proxies, self.arena.pool.records
        return terrain, cull.cull_objects(
            self._lists(Lane.OBJECTS, draw_list.objects),
            parts,
            draw_list.shares(view.t_s),
            eye,
            float(draw_list.object_threshold_px),
            self._lanes[Lane.OBJECTS].room,
        )

    def _lists(self, lane: Lane, rows: NDArray[np.int32]) -> cull.Lists:
        forest = self.forests[lane]
        slots = self.arena.slots[lane]
        boxes = forest.centre, forest.radius_m, self._half_m[lane]
        return cull.Lists(rows, slots, *boxes, forest.records)

    def read_rgb(self) -> NDArray[np.uint8]:
        """Return the last frame, (height, width, 3) uint8 sRGB, top row first."""
        n, (width, height) = self._supersample, self.size_px
        whole = np.empty((height * n, width * n, 4), np.uint8)
        picture = self._target.read(0, (gl.RGBA, gl.UNSIGNED_BYTE), whole)[..., :3]
        if n == 1:
            return np.ascontiguousarray(picture, np.uint8)
        boxes = picture.reshape(height, n, width, n, 3).astype(np.uint16)
        return np.asarray((boxes.sum((1, 3)) + n * n // 2) // (n * n), np.uint8)

    def read_empty(self) -> NDArray[np.bool_]:
        """Say which pixels of the last frame no tile and no object covers, (h, w).

        Read from the frame's own depth; the backs of triangles cover nothing.
        """
        n, (width, height) = self._supersample, self.size_px
        whole = np.empty((height * n, width * n), np.float32)
        depth = self._target.read(0, (gl.DEPTH_COMPONENT, gl.FLOAT), whole)
        return np.asarray(depth.reshape(height, n, width, n).max((1, 3)) == 0.0)

    def read_ids(self) -> NDArray[np.int32]:
        """Return what each pixel of the last frame shows, (height, width) int32.

        0 is none (sky); 1 + i is entry i of the list's `terrain`; -1 - (i * 65536 + k)
        is object k of the tile in entry i of `objects`, with k = 65535 for proxies.
        """
        return ids_of(self._probe_last())

    def read_positions(self) -> Ecef:
        """Return the points that the last frame drew.

        Returns
        -------
        points : (height, width, 3) float64 ECEF m, NaN where sky
        """
        seen = seen_of(self._probe_last())
        assert self._drawn
        points: Floats = seen[..., :3] + self._drawn[0].eye
        points[seen[..., 3] == 0.0] = np.nan
        return Ecef(points)

    def read_coarse(self, divide: int) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """Return ids and distances of the last frame at a fraction of its size.

        Returns
        -------
        ids : (height // divide, width // divide) int32, as `read_ids`
        distance_m : of the same shape, from the eye; infinite where sky
        """
        probe = self._probe_last(divide)
        seen = seen_of(probe)
        distance_m = np.linalg.norm(seen[..., :3], axis=-1)
        distance_m[seen[..., 3] == 0.0] = np.inf
        return ids_of(probe), distance_m.astype(np.float32)

    def release(self) -> None:
        """Free the GPU's memory; the renderer can't be used afterwards."""
        self.gl.guard()
        self._target.release()
        self._probes.release()
        self.arena.release()
        for one in self._lanes.values():
            one.release()
        self._sky.release()
        grain.release_texture(self.gl, self._grain)
        self._block_buffer.release()
        self._palette.release()
        if self._owns_context:
            self.gl.context.release()

    def _probe_last(self, divide: int = 1) -> Target:
        """Draw positions and ids of the last frame, once for each size."""
        if self._drawn is None:
            raise RuntimeError("nothing was drawn yet")
        view, counts = self._drawn
        probe, is_drawn = self._probes.get(divide)
        if not is_drawn:
            self._block[:] = frame_block(view, self.look, 1 / divide)
            self._probes.draw(probe, self._share, counts)
        return probe

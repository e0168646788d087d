# SPDX-License-Identifier: Apache-2.0
"""From a draw list and the newest pose to pixels, without ever waiting for a tile."""

import time

import moderngl
import numpy as np
from numpy.typing import NDArray

from geopage.draw_list import DrawList
from geopage.styling import Styling
from geopage.tree import boxes_m
from geopage.view import ViewState
from tiles.forest import Forest
from tiles.frames import Ecef, Floats
from tiles.lanes import Lane
from tiles.objects import ObjectTile
from tiles.terrain import TerrainTile
from viewer import cull, gil, gl
from viewer.arena import Arena, ArenaSize
from viewer.clearance import Clearance, Drawn
from viewer.cull_objects import cull_objects
from viewer.frame_stats import FrameStats
from viewer.frame_table import FrameTable
from viewer.gl import Gl
from viewer.look import Look, frame_block
from viewer.overlay import OFF
from viewer.overlay_pass import OverlayPass
from viewer.probes import Probes, ids_of, seen_of
from viewer.smooth import Smoother, is_same
from viewer.target import Target

DRAWS_PER_OBJECT_TILE = 5  # its own objects and four proxies


class Renderer:
    """Draws without a window, on the thread that made it.

    Parameters
    ----------
    forests : the lanes' forests; draw lists name their rows
    size_px : width and height of the picture
    arena : room for tiles
    supersample : pixels of the drawing along each edge of a pixel of the picture
    context : a moderngl context, or the calls of one; without one, a headless one is made
    """

    def __init__(
        self,
        forests: dict[Lane, Forest],
        size_px: tuple[int, int],
        arena: ArenaSize | None = None,
        supersample: int = 1,
        context: moderngl.Context | Gl | None = None,
    ) -> None:
        self._owns_context = context is None
        made = context or gl.open_headless()
        self.gl = made if isinstance(made, Gl) else Gl(made)
        self.forests = forests
        self._box_m = {lane: boxes_m(forests[lane], lane) for lane in forests}
        self.size_px, self._supersample = size_px, supersample
        self.culls = True
        """False: what is outside the picture's sides is drawn, too, to see what it costs"""
        self.overlay, self.smooth, self.look = OFF, True, Look()
        self.detail_m = np.zeros(len(forests[Lane.TERRAIN].records), np.float32)
        """(rows of the terrain's forest,) what is smaller does not show in a tile's data"""
        self.arena = Arena(self.gl, forests, arena or ArenaSize())
        self._clearance = Clearance(self.gl, self.arena)
        self._frame = FrameTable(self.gl, self.arena, self._drawn_px())
        self._probes = Probes(self.gl, size_px, self._frame.lanes)
        self._last: tuple[ViewState, DrawList, dict[Lane, int]] | None = None
        self._overlay_pass: OverlayPass | None = None
        self._smoother: Smoother | None = None
        self._is_still = False
        self.gl.check("making the renderer")

    def _drawn_px(self) -> tuple[int, int]:
        width, height = self.size_px
        return width * self._supersample, height * self._supersample

    def resize(self, size_px: tuple[int, int]) -> None:
        """Draw pictures of another size from now on; the last frame is forgotten."""
        self.gl.guard()
        self.size_px, self._last = size_px, None
        self._frame.resize(self._drawn_px())
        self._probes.release()
        self._probes = Probes(self.gl, size_px, self._frame.lanes)
        self.gl.check(f"resizing the picture to {size_px[0]}x{size_px[1]}")

    def set_one_by_one(self, *, is_on: bool) -> None:
        """Draw the parts of a frame one after the other, to see what each costs."""
        self._frame.set_one_by_one(is_on=is_on)

    @property
    def stages_ms(self) -> dict[str, float]:
        """Time of each part of the last frame's GL calls."""
        return self._frame.stages_ms

    def set_styling(self, styling: Styling | None) -> None:
        """Draw objects in the colours of a style from now on; None: in their own."""
        self.arena.coats.set_styling(styling)
        if styling:
            self._frame.set_palette(styling.palette)

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
        self._frame.block[:] = frame_block(view, self.look, self._supersample)
        with gil.interval(gil.SHARE_S):
            gl_ns, gil_ns = self._frame.run(counts, objects[3], terrain[3])
            self._is_still = self._last is not None and is_same(view, self._last[0])
            self._last = view, draw_list, counts
            self._draw_overlay()
        self._probes.forget()
        entries = self._frame.lanes[Lane.TERRAIN].room.instances[: terrain[4], 12]
        return FrameStats(
            triangles=terrain[1] + objects[1],
            draw_calls=terrain[0] + objects[0],
            tiles=terrain[4],
            objects=objects[2],
            fading=objects[3],
            stand_ins=int(draw_list.stand_in[entries.astype(np.int64)].sum()),
            screen_error_px=terrain[2],
            cull_ms=(culled - start) * 1e3,
            gl_ms=gl_ns / 1e6,
            gil_ms=gil_ns / 1e6,
            frame_ms=(time.perf_counter() - start) * 1e3,
        )

    def wants_gil(self) -> bool:
        """Say whether a frame's own Python runs or would. Thread: any."""
        return gil.is_kept() or self._frame.is_back()

    def _draw_overlay(self) -> None:
        if self.overlay == OFF or self._last is None:
            return
        if self._overlay_pass is None:
            boxes = self.forests[Lane.TERRAIN].centre, self._box_m[Lane.TERRAIN]
            self._overlay_pass = OverlayPass(self.gl, self._frame, *boxes)
        view, drawn, counts = self._last
        self._overlay_pass.draw(self.overlay, drawn, counts, view.eye)

    def blit(self, framebuffer: int = 0, size_px: tuple[int, int] | None = None) -> None:
        """Copy the last frame, as it is encoded, to a window's framebuffer.

        With `smooth`, edges are softened; the frame itself stays as it is. A software
        driver does so only when the view is that of the frame before: it takes 16 to 19
        ms of processor time at 1280 x 720.

        Parameters
        ----------
        framebuffer : GL name; 0 is the window of the current context
        size_px : of the framebuffer; the picture is scaled to it
        """
        size_px = size_px or self.size_px
        is_cheap = self._is_still or not self.gl.is_software
        if not (self.smooth and is_cheap and size_px == self._drawn_px()):
            self._frame.target.blit(framebuffer, size_px)
            return
        if self._smoother is None:
            self._smoother = Smoother(self.gl)
        self._smoother.copy(self._frame.target, framebuffer)

    def _cull(
        self, draw_list: DrawList, view: ViewState
    ) -> tuple[cull.TerrainDraws, tuple[int, int, int, int]]:
        eye = cull.eye_of(view, draw_list.sweep)
        if not self.culls:
            eye = eye._replace(planes=0.0 * eye.planes)
        most = cull.TERRAIN_DRAWS * len(draw_list.terrain)
        objects = DRAWS_PER_OBJECT_TILE * len(draw_list.objects)
        self._frame.grow({Lane.TERRAIN: most, Lane.OBJECTS: objects})
        ground = self.lists(Lane.TERRAIN, draw_list.terrain)
        room = self._frame.lanes[Lane.TERRAIN].room
        picture_px = float(view.width_px * view.height_px)
        sizes = draw_list.rungs(), draw_list.skirt_m, self.detail_m
        terrain = cull.cull_terrain(ground, *sizes, eye, picture_px, room)
        drawn = Drawn(*ground[:2], ground.records, self.forests[Lane.TERRAIN].children)
        self._clearance.apply(room.instances[: terrain[4]], drawn, eye.place)
        pools = self.arena.pool.records, self.arena.coats.proxies
        parts = draw_list.own, draw_list.proxies, *pools
        return terrain, cull_objects(
            self.lists(Lane.OBJECTS, draw_list.objects),
            parts,
            draw_list.shares(view.t_s),
            eye,
            float(draw_list.object_threshold_px),
            self._frame.lanes[Lane.OBJECTS].room,
        )

    def lists(self, lane: Lane, rows: NDArray[np.int32]) -> cull.Lists:
        """Return the rows of a lane with the arrays that they point to, for kernels."""
        forest, slots = self.forests[lane], self.arena.slots[lane]
        boxes = forest.centre, forest.radius_m, self._box_m[lane]
        return cull.Lists(rows, slots, *boxes, forest.records, self.arena.pieces)

    def read_rgb(self) -> NDArray[np.uint8]:
        """Return the last frame, (height, width, 3) uint8 sRGB, top row first."""
        n, (width, height) = self._supersample, self.size_px
        whole = np.empty((height * n, width * n, 4), np.uint8)
        picture = self._frame.target.read(0, (gl.RGBA, gl.UNSIGNED_BYTE), whole)[..., :3]
        if n == 1:
            return np.ascontiguousarray(picture, np.uint8)
        total = np.full((height, width, 3), n * n // 2, np.uint16)
        for i, j in np.ndindex(n, n):
            total += np.asarray(picture[i::n, j::n], np.uint8)
        return (total // (n * n)).astype(np.uint8)

    def read_empty(self) -> NDArray[np.bool_]:
        """Say which pixels of the last frame no tile and no object covers, (h, w).

        Read from the frame's own depth; the backs of triangles cover nothing.
        """
        n, (width, height) = self._supersample, self.size_px
        whole = np.empty((height * n, width * n), np.float32)
        depth = self._frame.target.read(0, (gl.DEPTH_COMPONENT, gl.FLOAT), whole)
        return np.asarray(depth.reshape(height, n, width, n).max((1, 3)) == 0.0)

    def read_depth(self, x: int, y: int) -> float:
        """Return the depth that the last frame has at one pixel, 0 where sky."""
        n = self._supersample
        return self._frame.target.depth_at(x * n + n // 2, y * n + n // 2)

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
        assert self._last
        points: Floats = seen[..., :3] + self._last[0].eye
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
        self._probes.release()
        for part in (self._overlay_pass, self._smoother):
            if part:
                part.release()
        self._frame.release()
        self.arena.release()
        if self._owns_context:
            self.gl.context.release()

    def _probe_last(self, divide: int = 1) -> Target:
        """Draw positions and ids of the last frame, once for each size."""
        if self._last is None:
            raise RuntimeError("nothing was drawn yet")
        view, _, counts = self._last
        probe, is_drawn = self._probes.get(divide)
        if not is_drawn:
            self._frame.block[:] = frame_block(view, self.look, 1 / divide)
            self._probes.draw(probe, self._frame.share, counts)
        return probe

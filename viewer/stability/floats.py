# SPDX-License-Identifier: Apache-2.0
"""Numbers with too few bits: positions near the eye, positions in a tile."""

import math
from functools import partial

import moderngl
import numpy as np

from tiles import geodesy
from tiles.codec import read_header
from tiles.frames import Ecef, Floats
from tiles.lanes import Lane
from tiles.mesh import STEPS
from viewer.camera import Pose, project, view_state
from viewer.draw_record import INSTANCE_FLOATS, put_place
from viewer.look import Look, frame_block
from viewer.passes import source
from viewer.stability.globe import edges_m
from viewer.stability.place import FOCAL_PX, SCREEN_PX, Place
from viewer.stability.row import Finding, Row, first_bad

MAIN = "out vec4 clip;\nvoid main() { gl_Position = clip = to_clip(seen_from_eye()); }\n"
EYES = 512
FARTHEST_M = 1e7
BITS = 16
POSE = Pose(0.3, 0.7, 0.0, 1.0, -0.4)


class Jitter:
    """Vertices' places on the screen, as the GPU computes them with the shaders' code."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        text = source("frame.glsl", "vertex_inputs.glsl") + MAIN
        self._program = context.program(vertex_shader=text, varyings=("clip",))
        self._view = view_state(POSE, SCREEN_PX)
        self._block = context.buffer(frame_block(self._view, Look()).tobytes())

    def worst_px(self, radius_m: float, away_m: float) -> tuple[float, float]:
        """Return how far a vertex is from where it should be, over many eyes.

        Parameters
        ----------
        radius_m : of the tile; the vertex is at its rim
        away_m : from the eye

        Returns
        -------
        deviation, and the same if earth-centred float32 positions were subtracted
        """
        rng = np.random.default_rng(1)
        step = np.array((STEPS, -STEPS // 2, STEPS // 3), np.int16)
        scale_m = float(np.float32(radius_m / np.linalg.norm(step)))
        ways = rng.normal(size=(EYES, 3)) * 0.2 + self._view.forward
        ways *= away_m / np.linalg.norm(ways, axis=1, keepdims=True)
        vertex = geodesy.to_ecef(POSE.lon_rad, POSE.lat_rad, 100.0)
        eyes = vertex - ways
        centre = vertex - step * scale_m
        draws = np.zeros((EYES, INSTANCE_FLOATS), np.float32)
        for draw, offset_m in zip(draws, (centre - eyes).tolist(), strict=True):
            put_place(draw, tuple(offset_m), scale_m)
        clip = self._clip(step, draws)
        whole = project(self._view, Ecef(self._view.eye + ways))[:, :2]
        naive = vertex.astype(np.float32) - eyes.astype(np.float32)
        at = Ecef(self._view.eye + naive.astype(np.float64))
        with np.errstate(divide="ignore", invalid="ignore"):  # rounded onto the eye
            other = project(self._view, at)[:, :2]
        return _largest(_pixels(clip) - whole), _largest(other - whole)

    def _clip(self, step: np.ndarray, draws: np.ndarray) -> Floats:
        context = self._context
        buffers = [context.buffer(data.tobytes()) for data in (step, draws)]
        out = context.buffer(reserve=16 * len(draws))
        record = "4f 48x 4f/i", "draw_origin", "draw_steps"
        layout = [(buffers[0], "3i2", "step_position"), (buffers[1], *record)]
        drawing = context.vertex_array(self._program, layout)
        self._block.bind_to_uniform_block(0)
        drawing.transform(out, moderngl.POINTS, 1, instances=len(draws))
        found = np.frombuffer(out.read(), np.float32).reshape(-1, 4).astype(np.float64)
        drawing.release()
        for one in (*buffers, out):
            one.release()
        return found

    def release(self) -> None:
        """Free the GPU's memory."""
        self._program.release()
        self._block.release()


def _pixels(clip: Floats) -> Floats:
    at = clip[:, :2] / clip[:, 3:]
    return np.asarray((at * (1.0, -1.0) + 1.0) / 2.0 * SCREEN_PX)


def _largest(away: Floats) -> float:
    return float(np.linalg.norm(away, axis=1).max())


def jitter(place: Place, away_m: float) -> Finding:
    """Make tiles larger until a vertex near the eye trembles."""
    ground = place.ground.records
    deepest = ground["cell"] & -ground["cell"]
    near = float(ground["radius_m"][deepest == deepest.min()].max())
    gpu = Jitter(place.session.renderer.gl.context)
    ours, naive = gpu.worst_px(near, away_m)
    breaks_m = first_bad(
        lambda r: gpu.worst_px(r, away_m)[0] <= JITTER_PX, 1.0, FARTHEST_M, 20
    )
    gpu.release()
    note = "the worst practical case is the largest tile of the store's deepest level"
    return Finding(near, ours, breaks_m, FARTHEST_M, naive, note)


def trembling_ground(place: Place) -> Finding:
    """Come near to the largest leaf of the store until a vertex trembles."""
    records = place.ground.records
    radius_m = float(records["radius_m"][records["children"] == 0].max())
    gpu = Jitter(place.session.renderer.gl.context)
    ours, naive = gpu.worst_px(radius_m, WALK_M)
    breaks_m = first_bad(
        lambda d: gpu.worst_px(radius_m, d)[0] <= JITTER_PX, FARTHEST_M, NEAREST_M, 20
    )
    gpu.release()
    note = f"the leaf's radius is {radius_m / 1e3:,.0f} km; a vertex is rounded by its"
    note += " distance and by its tile's step, not by the distance of the tile's centre"
    return Finding(WALK_M, ours, breaks_m, NEAREST_M, naive, note)


def rounding(place: Place) -> Finding:
    """Compare the rounding of positions with the error that a leaf aims at."""
    records = place.ground.records
    every = max(1, len(records) // place.count(2000, 400))
    shares = []
    for record in records[::every]:
        key = int(record["cell"]), int(record["row"]), int(record["check"])
        body = place.session.store.checked_body(Lane.TERRAIN, *key)
        step_m = float(read_header(Lane.TERRAIN, body)["scale_m"])
        edge_m = float(edges_m(record["cell"]))
        shares.append(step_m * math.sqrt(3) / 2 / (edge_m / STEPS_OF_LEAF))
    share = max(shares)
    finest_m = float(records["radius_m"][-1]) / STEPS * math.sqrt(3) / 2
    note = f"on the finest tile it is {finest_m * 1e3:.1f} mm"
    note += f", a pixel seen from {finest_m * FOCAL_PX:.1f} m"
    whole, few = 2.0**BITS, 2.0**FEW_BITS
    return Finding(whole, share, whole * share, others=share * whole / few, note=note)


WALK_M, NEAREST_M = 2.0, 0.1
FEW_BITS = 11
STEPS_OF_LEAF = 64 * 100
"""Posts along the edge of a leaf; it aims at a hundredth of their spacing."""
JITTER_PX = 0.01
ROWS = (
    *(
        Row(
            f"float32 jitter at {away_m} m",
            "vertices tremble: earth-centred float32 positions less a float32 eye",
            "radius of the tile whose vertex is so near, m",
            "distance of a vertex from its float64 place on the screen, px",
            JITTER_PX,
            partial(jitter, away_m=float(away_m)),
        )
        for away_m in (2, 10, 50, 200)
    ),
    Row(
        "float32 jitter, coarse ground",
        "vertices tremble: earth-centred float32 positions less a float32 eye",
        "distance of the eye from a vertex of the largest leaf, m",
        "distance of the vertex from its float64 place on the screen, px",
        JITTER_PX,
        trembling_ground,
        more_is_harder=False,
    ),
    Row(
        "int16 quantisation",
        f"rounding is larger than the error aimed at: positions of {FEW_BITS} bits",
        "steps that a position can take",
        "largest rounding of a vertex / a hundredth of a leaf's post spacing",
        1.0,
        rounding,
        more_is_harder=False,
    ),
)

# SPDX-License-Identifier: Apache-2.0
"""What the key frames of a method are worth, against the sources and the reference.

The geometric error compares the drawn terrain with the sources' own posts; everything
else compares pictures with the *reference frame*: the same view with the finest data,
drawn by the same renderer with everything resident.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from geopage.draw_list import DrawList
from geopage.selection import ideal
from geopage.view import ViewState
from tiles.errors import InputError
from tiles.lanes import Lane
from tiles.source_posts import terrain_sources
from viewer.accuracy import Judge, seen_in, without_objects
from viewer.bench_stage import Stages
from viewer.flip import F4, Prepared, compare, prepare
from viewer.frame_stats import FrameStats
from viewer.geometric_error import NOT_COMPARED, FrameError, Hits, reference
from viewer.key_frames import MOST_POSTS, WIDTH_PX, thinned
from viewer.popping import popping
from viewer.session import Session
from viewer.tally import Judged, Tally

Json = dict[str, Any]
Rgb = NDArray[np.uint8]


class Frame(NamedTuple):
    """One frame that can be drawn again."""

    view: ViewState
    drawn: DrawList
    mesh: str = ""
    """Kind of mesh that it is drawn with: `Method.mesh`"""


@dataclass(frozen=True, slots=True)
class KeyFrame:
    """Two successive frames; the first is judged, both together show what pops."""

    now: Frame
    after: Frame


@dataclass(frozen=True, slots=True)
class Reference:
    """The reference of a key frame."""

    rgb: Rgb
    seen: Prepared
    change: F4
    """(h, w) FLIP from this frame to the next one"""


@dataclass(frozen=True, slots=True)
class Worst:
    """The key frame that looks least like its reference."""

    t_s: float
    flip: float
    rgb: Rgb
    reference: Rgb
    difference: F4


@dataclass(slots=True)
class Scores:
    """All key frames of one method at one threshold."""

    tally: Tally
    square: list[float] = field(default_factory=list)
    """mean squared differences of the pictures' 8-bit channels"""
    flip: list[float] = field(default_factory=list)
    popping: list[float] = field(default_factory=list)
    triangles: list[int] = field(default_factory=list)
    """of the ground"""
    worst: Worst | None = None

    def figures(self) -> Json:
        """Return the columns of results.csv; what was not measured is absent."""
        found = self.tally.figures()
        error = {f"error_{key}_px": found[key] for key in ERRORS if key in found}
        if error:
            error["share_within_threshold"] = found["share_within_threshold"]
        square = float(np.mean(self.square))
        return {
            "ground_triangles": float(np.mean(self.triangles)),
            **error,
            "psnr_db": 10 * math.log10(255**2 / square) if square else math.inf,
            "flip_mean": float(np.mean(self.flip)),
            "flip_worst_frame": float(np.max(self.flip)),
            "popping_mean": float(np.mean(self.popping)),
            "popping_max": float(np.max(self.popping)),
        }


ERRORS = ("p50", "p95", "p99", "max")


class Scorer:
    """Draws and judges key frames in sessions whose pagers stand still.

    Parameters
    ----------
    judged_px : about so many pixels of a line are judged against the sources
    """

    def __init__(
        self, session: Session, reference_px: float, judged_px: int = WIDTH_PX
    ) -> None:
        self.session, self.reference_px = session, reference_px
        self.stages = Stages(session)
        self._judged_px = judged_px
        sources = terrain_sources(session.store)
        posts = sum(int(s["width"]) * int(s["height"]) for s in sources)
        self._judge = Judge(session) if posts <= MOST_POSTS else None
        self._hits: dict[bytes, Hits] = {}
        self._known: dict[tuple[bytes, bytes], Reference] = {}
        self._judged: dict[tuple[bytes, float, str, bytes], Judged] = {}

    def draw(self, frame: Frame) -> FrameStats:
        """Draw a frame with all its tiles.

        Raises
        ------
        InputError
            When they need more memory than there is.
        """
        view, drawn, mesh = frame
        session = self.stages.session(mesh)
        session.hold(drawn)
        for lane, rows in ((Lane.TERRAIN, drawn.terrain), (Lane.OBJECTS, drawn.objects)):
            if not session.renderer.arena.slots[lane]["uploaded"][rows].all():
                reason = f"one frame at {drawn.threshold_px:g} px does not fit in memory"
                raise InputError(f"t = {view.t_s:g} s", reason, "raise --budget")
        return session.renderer.draw(drawn, view)

    def picture(self, frame: Frame) -> Rgb:
        """Return a frame's picture, (h, w, 3) sRGB."""
        self.draw(frame)
        return self.stages.session(frame.mesh).renderer.read_rgb()

    def score(self, frames: Sequence[KeyFrame], threshold_px: float) -> Scores:
        """Judge key frames."""
        scores = Scores(Tally(threshold_px))
        for frame in frames:
            self._add(scores, frame, self._reference(frame))
            bare = frame.now._replace(drawn=without_objects(frame.now.drawn))
            scores.triangles.append(self.draw(bare).triangles)
            if self._judge:
                scores.tally.add(self._measure(self._judge, frame.now, threshold_px))
        return scores

    def _add(self, scores: Scores, frame: KeyFrame, reference: Reference) -> None:
        """Compare the pictures."""
        rgb = self.picture(frame.now)
        seen = prepare(rgb)
        difference = compare(reference.seen, seen)
        change = compare(seen, prepare(self.picture(frame.after)))
        apart = rgb.astype(np.float64) - reference.rgb
        scores.square.append(float((apart**2).mean()))
        scores.flip.append(found := float(difference.mean()))
        scores.popping.append(popping(change, reference.change))
        if scores.worst is None or found > scores.worst.flip:
            t_s = frame.now.view.t_s
            scores.worst = Worst(t_s, found, rgb, reference.rgb, difference)

    def _measure(self, judge: Judge, frame: Frame, threshold_px: float) -> Judged:
        """Measure the terrain's geometric error, as `fly` does."""
        view, bare, mesh = frame._replace(drawn=without_objects(frame.drawn))
        # Methods that differ in objects alone draw the same terrain.
        key = pose_of(view), threshold_px, mesh, bare.terrain.tobytes()
        if key not in self._judged:
            self.draw(Frame(view, bare, mesh))
            every = max(1, view.width_px // self._judged_px)
            seen = thinned(seen_in(self.stages.session(mesh).renderer, view), every)
            if key[0] not in self._hits:
                self._hits[key[0]] = reference(judge.tree, seen)
            hits = self._hits[key[0]]
            if len(bare.terrain):
                tiles = self.stages.tiles(mesh)
                error = judge.judge(
                    bare, seen, threshold_px, tiles=tiles, hits=hits, silhouettes=False
                )
            else:
                error = nothing_drawn(hits, view, seen.tile.shape, threshold_px)
            self._judged[key] = Judged({"t_s": view.t_s}, error)
        return self._judged[key]

    def _reference(self, frame: KeyFrame) -> Reference:
        key = pose_of(frame.now.view), pose_of(frame.after.view)
        if key not in self._known:
            views = frame.now.view, frame.after.view
            rgb, after = (self.picture(self._finest(view)) for view in views)
            seen = prepare(rgb)
            self._known[key] = Reference(rgb, seen, compare(seen, prepare(after)))
        return self._known[key]

    def _finest(self, view: ViewState) -> Frame:
        finest = self.reference_px
        return Frame(view, ideal(self.session.pager.forests, view, finest, finest))


def nothing_drawn(
    hits: Hits, view: ViewState, shape: tuple[int, ...], threshold_px: float
) -> FrameError:
    """Return the error of a frame without ground: the picture's width, where some is."""
    earth = (hits[1] >= 0).reshape(shape)
    error_px = np.where(earth, float(view.width_px), np.nan)
    zero, limit = np.zeros(shape), np.full(shape, threshold_px)
    excess = np.nan_to_num(error_px / limit)
    return FrameError(error_px, zero, limit, excess, earth, NOT_COMPARED)


def pose_of(view: ViewState) -> bytes:
    """Return what tells views apart, but for their time."""
    return bytes(view.eye) + view.rotation.tobytes()

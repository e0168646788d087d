# SPDX-License-Identifier: Apache-2.0
"""The geometric pixel error of a flight, at some frames of its replay.

A frame is drawn again from its recorded list and judged in every few pixels of every few
lines; the error counts in pixels of the flight's own picture. A flight in real time also
draws stand-ins, so its error may pass the threshold.
"""

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from tiles.source_posts import terrain_sources
from viewer.accuracy import Judge, seen_in, without_objects
from viewer.flight import Recording
from viewer.geometric_error import Seen
from viewer.session import Session
from viewer.tally import Judged, Tally

FRAMES = 12
LONGEST_S = 20.0
WIDTH_PX = 200
"""About so many pixels of a line are judged."""
MOST_POSTS = 200_000_000
"""Larger stores are for `geopage accuracy`: reading their posts takes too long here."""
Json = dict[str, Any]


def key_frames_error(
    session: Session, recording: Recording, progress: Callable[[float], None]
) -> Json:
    """Measure about a dozen frames spread over a flight.

    Returns
    -------
    The report's `geometric_error_px`; empty when nothing could be measured.
    """
    sources = terrain_sources(session.store)
    if sum(int(s["width"]) * int(s["height"]) for s in sources) > MOST_POSTS:
        return {}
    threshold_px = session.settings.threshold_px
    end_s = time.perf_counter() + LONGEST_S
    judge, tally = Judge(session), Tally(threshold_px)
    for done, i in enumerate(spread(len(recording.views))):
        if done and time.perf_counter() > end_s:
            break
        view, bare = recording.views[i], without_objects(recording.lists[i])
        session.hold(bare)
        session.renderer.draw(bare, view)
        seen = thinned(seen_in(session.renderer, view), max(1, view.width_px // WIDTH_PX))
        frame = judge.judge(bare, seen, threshold_px, silhouettes=False)
        tally.add(Judged({"t_s": view.t_s}, frame))
        progress(done + 1)
    found = tally.figures()
    if not found["pixels_judged"]:
        return {}
    return {**found, "frames": sorted(tally.rows, key=lambda row: float(row["t_s"]))}


def spread(count: int) -> list[int]:
    """Return key frames of so many, ends included, so ordered that any part is spread."""
    found = np.unique(np.linspace(0, count - 1, min(FRAMES, count)).round().astype(int))
    order = sorted(range(len(found)), key=lambda k: f"{k:04b}"[::-1])
    return [int(found[k]) for k in order]


def thinned(seen: Seen, every: int) -> Seen:
    """Return every n-th pixel of every n-th line."""
    part = np.s_[every // 2 :: every, every // 2 :: every]
    return replace(
        seen, rays=seen.rays[part], points=seen.points[part], tile=seen.tile[part]
    )

# SPDX-License-Identifier: Apache-2.0
"""Where the time of one frame goes, part by part: `geopage fly --profile T_S`.

The view at one time of a path is settled and drawn many times: as in a flight, where the
driver works on several parts at once, and then part by part, each ended before the next.
"""

import json
import time
from pathlib import Path
from typing import Any

import numpy as np

from geopage.progress import bar
from geopage.settings import PagerSettings
from geopage.view import ViewState
from tiles.errors import InputError
from viewer import gil
from viewer.camera_path import read_path
from viewer.flight import UPLOAD_BYTES, UPLOAD_S, quiet_collector
from viewer.poses import Flight
from viewer.session import Picture, Session

Json = dict[str, Any]
FRAMES = 200


def profile_frame(
    store: Path, settings: PagerSettings, picture: Picture, path: Path, t_s: float
) -> Json:
    """Settle the view at a time of a path, draw it `FRAMES` times each way.

    Raises
    ------
    InputError
        When the path is not flown then.
    """
    flown = read_path(path)
    if not 0 <= t_s <= flown.duration_s:
        raise InputError(
            path.name, f"lasts {flown.duration_s:g} s", f"take a time within, not {t_s:g} s"
        )
    with Session(store, settings, picture) as session:
        view = Flight(flown, session.surface, picture.size_px).view(t_s)
        session.settle(view)
        ways = {}
        with bar("drawing one view", 2 * FRAMES, "frames") as show:
            for i, way in enumerate(("as in a flight", "one by one")):
                session.renderer.set_one_by_one(is_on=bool(i))
                with quiet_collector(), gil.interval(gil.KEEP_S):
                    frames = []
                    for k in range(FRAMES):
                        frames.append(one_frame(session, view))
                        show(i * FRAMES + k + 1)
                ways[way] = figures(frames)
        _, stats = session.settle(view)
        return {
            "path": path.stem,
            "t_s": t_s,
            "triangles": stats.triangles,
            "draws": stats.draw_calls,
            "ways": ways,
        }


def one_frame(session: Session, view: ViewState) -> dict[str, float]:
    """Do what a flight does for a frame; return the time of each part, ms."""
    clock = [time.perf_counter_ns()]
    drawn = session.pager.draw_list().solid()
    clock.append(time.perf_counter_ns())
    session.feeder.feed(drawn.number, UPLOAD_BYTES, UPLOAD_S)
    clock.append(time.perf_counter_ns())
    session.pager.view(view)
    clock.append(time.perf_counter_ns())
    stats = session.renderer.draw(drawn, view)
    clock.append(time.perf_counter_ns())
    taking, feeding, telling, drawing = (np.diff(clock) / 1e6).tolist()
    parts = session.renderer.stages_ms
    told = stats.cull_ms + stats.gil_ms + sum(parts.values())
    return {
        "take the list": taking,
        "uploads, releases": feeding,
        "hand on the view": telling,
        "cull": stats.cull_ms,
        **parts,
        "get the GIL back": stats.gil_ms,
        "other Python of drawing": drawing - told,
        "whole frame": (clock[-1] - clock[0]) / 1e6,
    }


def figures(frames: list[dict[str, float]]) -> Json:
    """Return each part's least, median and 99th percentile."""
    found = {}
    for name in frames[0]:
        took = [frame[name] for frame in frames]
        least, p50, p99 = np.percentile(took, (0, 50, 99)).tolist()
        found[name] = {"least_ms": least, "p50_ms": p50, "p99_ms": p99}
    return found


def lines(found: Json) -> list[str]:
    """Say it in a table: least, median and 99th percentile of each way, ms."""
    said = [
        f"{found['path']} at {found['t_s']:g} s: {found['triangles']:,} triangles in"
        f" {found['draws']} draws",
        " " * 28 + "".join(f"{way:>24s}" for way in found["ways"]),
        f"{'ms':28s}" + "   least  median     p99" * len(found["ways"]),
    ]
    for name in next(iter(found["ways"].values()), ()):
        row = f"{name:28s}"
        for parts in found["ways"].values():
            row += "".join(f"{parts[name][key]:8.3f}" for key in KEYS)
        said.append(row)
    return said


KEYS = ("least_ms", "p50_ms", "p99_ms")


def write(found: Json, folder: Path) -> None:
    """Write profile.json."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "profile.json").write_text(json.dumps(found, indent=2) + "\n")

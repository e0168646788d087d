# SPDX-License-Identifier: Apache-2.0
"""A flight beside its floors, again and again in one run: `geopage fly --pairs N`.

Each pair flies the path in real time, then draws the recorded lists again with every
tile resident: once with nothing else running (the floor), once beside paging threads
that read and decode at the flight's own peak rate. Which of the two comes first
alternates. Ratios are formed within a pair, so that what else the machine does meets
both sides.
"""

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geopage.progress import bar
from geopage.settings import MIB, PagerSettings
from viewer.camera_path import read_path
from viewer.flight import FRAME_S, Recording, fly_paced
from viewer.poses import Flight
from viewer.replay import time_again
from viewer.server_load import ServerLoad
from viewer.session import Picture, Session

Json = dict[str, Any]
WAIT_MS = 0.5
LIMITS = {"p50": 1.15, "p99": 1.5, "p99_beside_servers": 1.3}
"""What the ratios may be at most, median of all pairs."""


def fly_pairs(
    store: Path, settings: PagerSettings, picture: Picture, path: Path, count: int
) -> Json:
    """Fly a path `count` times, each time beside its floors."""
    seconds = read_path(path).duration_s
    pairs = []
    with bar(f"{count} flights and their floors", 3 * count * seconds, "s") as show:
        for i in range(count):

            def progress(part: int, share: float, i: int = i) -> None:
                show((3 * i + part + share) * seconds)

            with Session(store, settings, picture) as session:
                pairs.append(pair(session, store, path, progress, i))
    return {"path": path.stem, "pairs": pairs, **figures(pairs)}


def pair(
    session: Session,
    store: Path,
    path: Path,
    progress: Callable[[int, float], None],
    number: int,
) -> Json:
    """Fly once and draw it twice again; return the figures, JSON-ready.

    Parameters
    ----------
    number : of the pair; by it the order of the two changes
    progress : takes which of the three parts it is, and how much of it is done
    """
    flown = read_path(path)
    flight = Flight(flown, session.surface, session.picture.size_px)
    recording = fly_paced(session, flight, lambda t: progress(0, t / flown.duration_s))
    session.pager.close()
    count, rate = len(recording.views), peak_rate(recording)
    found: Json = {"frames": count, "peak_bytes_per_s": rate}
    for part, loaded in enumerate((bool(number % 2), not number % 2), 1):
        pace = Pace()

        def show(done: int, part: int = part, pace: Pace = pace) -> None:
            progress(part, done / count)
            pace.wait()

        if loaded:
            beside, read_per_s = time_beside(session, store, recording, rate, show)
            found |= {"beside": spread(beside), "servers_bytes_per_s": read_per_s}
        else:
            found["floor"] = spread(time_again(session, recording, show))
    frames = recording.table()
    found["flight"] = spread(frames["frame_ms"])
    found["waits"] = int((frames["wait_ms"] > WAIT_MS).sum())
    return found


class Pace:
    """Lets no frame begin sooner than a flight's does, so that the machine rests alike."""

    def __init__(self) -> None:
        self._next_s = 0.0

    def wait(self) -> None:
        """Wait for the next frame's turn."""
        time.sleep(max(self._next_s - time.perf_counter(), 0.0))
        self._next_s = time.perf_counter() + FRAME_S


def time_beside(
    session: Session,
    store: Path,
    recording: Recording,
    rate: float,
    show: Callable[[int], None],
) -> tuple[NDArray[np.float64], float]:
    """Draw the recorded frames beside busy servers; return their times, and the rate."""
    wants_gil = session.renderer.wants_gil
    with ServerLoad(store, session.settings, recording.views, rate, wants_gil) as load:
        start_s, before = time.perf_counter(), load.bytes_read

        def turn(done: int) -> None:
            load.turn()
            show(done)

        frame_ms = time_again(session, recording, turn)
        seconds = time.perf_counter() - start_s
        return frame_ms, (load.bytes_read - before) / seconds


def peak_rate(recording: Recording) -> float:
    """Return the most stored bytes that a flight read in one second."""
    frames = recording.table()
    t_s, read = frames["t_s"], frames["bytes_read"].astype(np.float64)
    ahead = np.interp(t_s + 1.0, t_s, read) - read
    return float(max(ahead.max(), MIB / 4))


def spread(frame_ms: NDArray[np.float64]) -> dict[str, float]:
    """Return median and 99th percentile."""
    p50, p99 = np.percentile(frame_ms, (50, 99)).tolist()
    return {"p50_ms": p50, "p99_ms": p99}


def figures(pairs: list[Json]) -> Json:
    """Return each ratio's median, least and most over all pairs."""
    ratios = {
        "p50": [one["flight"]["p50_ms"] / one["floor"]["p50_ms"] for one in pairs],
        "p99": [one["flight"]["p99_ms"] / one["floor"]["p99_ms"] for one in pairs],
        "p99_beside_servers": [
            one["beside"]["p99_ms"] / one["floor"]["p99_ms"] for one in pairs
        ],
    }
    return {
        "ratios": {
            name: {
                "median": float(np.median(values)),
                "least": min(values),
                "most": max(values),
                "limit": LIMITS[name],
            }
            for name, values in ratios.items()
        },
        "waits": [one["waits"] for one in pairs],
    }


def lines(found: Json) -> list[str]:
    """Say it in a table."""
    said = ["pair   flight p50  p99 ms   floor p50  p99   beside servers p50  p99   waits"]
    for i, one in enumerate(found["pairs"], 1):
        flight, floor, beside = one["flight"], one["floor"], one["beside"]
        said.append(
            f"{i:4d}   {flight['p50_ms']:10.1f} {flight['p99_ms']:7.1f}"
            f"   {floor['p50_ms']:9.1f} {floor['p99_ms']:5.1f}"
            f"   {beside['p50_ms']:18.1f} {beside['p99_ms']:5.1f}   {one['waits']:5d}"
        )
    names = {
        "p50": "flight / floor, p50",
        "p99": "flight / floor, p99",
        "p99_beside_servers": "beside servers / floor, p99",
    }
    for name, ratio in found["ratios"].items():
        said.append(
            f"{names[name]}: median {ratio['median']:.2f}, {ratio['least']:.2f} to"
            f" {ratio['most']:.2f} (limit {ratio['limit']})"
        )
    return said


def write(found: Json, folder: Path) -> None:
    """Write pairs.json."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "pairs.json").write_text(json.dumps(found, indent=2) + "\n")

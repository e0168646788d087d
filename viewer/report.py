# SPDX-License-Identifier: Apache-2.0
"""The report of a flight: `report.json` and `frames.csv`.

A figure that was not measured is absent, never zero.
"""

import csv
import json
import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geopage.trace import TileTrace, summary
from viewer.flight import Recording
from viewer.machine import machine
from viewer.replay import Replay, distinct_bytes
from viewer.session import Session

WAIT_MS = 0.5
JANK_MS = 1000 / 60
LIMIT_PX = 2.0
Json = dict[str, Any]


def flight_report(
    session: Session, recording: Recording, run: Json, played: Replay
) -> Json:
    """Put everything that was measured in one flight together.

    Parameters
    ----------
    run : name and mode of the run, as `settings` begins
    """
    frames = recording.table()
    size, count = distinct_bytes(session, recording.lists)
    settings = {
        **run,
        **_plain(asdict(session.settings)),
        "size_px": session.picture.size_px,
    }
    return {
        "settings": settings,
        "machine": machine(session.renderer.gl),
        "frames": frame_figures(frames, played, paced=run["mode"] == "paced"),
        "floor": {
            "frame_p50_ms": _at(played.frame_ms, 50),
            "frame_p99_ms": _at(played.frame_ms, 99),
            "frame_mean_ms": float(played.frame_ms.mean()),
            "bytes": size,
            "misses": count,
        },
        "screen_error_px": {
            **percentiles(played.screen_error_px),
            "share_frames_within_2px": float((played.screen_error_px <= LIMIT_PX).mean()),
            "share_pixels_within_threshold_or_leaf": float(played.kept.mean()),
        },
        **_paged(session.pager.counters, recording.trace),
        "memory": _memory(session.pager.memory(), recording.rss_before_bytes, frames),
        "drawn": drawn_figures(frames),
        **stage_figures(frames),
        "faults": list(session.pager.faults),
    }


def _paged(counters: dict[str, int], trace: TileTrace | None) -> Json:
    """Return what was read, how late it came, and how well it was foreseen."""
    traced = summary(trace.table()) if trace else {}
    late = {key: value for key, value in traced.items() if key.startswith("late_")}
    foreseen = {
        key: value for key, value in traced.items() if key.endswith(("predicted", "share"))
    }
    io = {"bytes_read": counters["bytes_read"], **_tiles(counters), **late}
    return {"io": io, **({"prediction": foreseen} if foreseen else {})}


def _memory(now: dict[str, int], before_bytes: int, frames: NDArray[np.void]) -> Json:
    return {
        **{key: now[key] for key in ("budget_bytes", "peak_bytes", "index_bytes")},
        "gpu_bytes": now["uploaded_bytes"],
        "rss_before_bytes": before_bytes,
        "rss_peak_bytes": int(frames["rss_bytes"].max()),
    }


def stage_figures(frames: NDArray[np.void]) -> Json:
    """Return where the time of the frames went, mean and spread."""
    stages = {
        "upload": frames["upload_ms"],
        "selection": frames["cull_ms"],
        "draw": frames["draw_ms"],
    }
    stages["rest"] = frames["frame_ms"] - sum(stages.values())
    spreads = {name: percentiles(took) for name, took in stages.items()}
    means = {name: float(took.mean()) for name, took in stages.items()}
    return {"stages_ms": means, "stages_spread_ms": spreads}


def frame_figures(frames: NDArray[np.void], played: Replay, *, paced: bool) -> Json:
    """Frame times, and what went wrong in how many frames."""
    took = frames["frame_ms"]
    found = {
        "count": len(frames),
        "mean_ms": float(took.mean()),
        "sd_ms": float(took.std()),
        **{f"{key}_ms": value for key, value in percentiles(took).items()},
        "jank_ms": float(np.maximum(took - JANK_MS, 0).sum()),
        "holes": played.hole_frames,
        "hole_pixels": played.hole_pixels,
        "missing_objects": played.missing_objects,
        "with_stand_ins": int((frames["stand_ins"] > 0).sum()),
    }
    if paced:
        found["waits"] = int((frames["wait_ms"] > WAIT_MS).sum())
        found["wait_max_ms"] = float(frames["wait_ms"].max())
        found["gil_max_ms"] = float(frames["gil_ms"].max())
        found["draw_list_age_p95_ms"] = _at(frames["list_age_ms"], 95)
    return found


def drawn_figures(frames: NDArray[np.void]) -> Json:
    """Triangles, draw calls, objects, and how far away the first object was drawn."""
    found: Json = {
        "triangles_mean": float(frames["triangles"].mean()),
        "triangles_max": int(frames["triangles"].max()),
        "draw_calls_mean": float(frames["draw_calls"].mean()),
        "objects_max": int(frames["objects"].max()),
    }
    with_objects = np.flatnonzero(frames["objects"] > 0)
    if len(with_objects):
        found["first_object_height_m"] = float(frames["height_m"][with_objects[0]])
    return found


def percentiles(values: NDArray[np.float64]) -> dict[str, float]:
    """Return p50, p95, p99 and max."""
    return {**{f"p{p}": _at(values, p) for p in (50, 95, 99)}, "max": float(values.max())}


def _at(values: NDArray[np.float64], percent: float) -> float:
    return float(np.percentile(values, percent))


def _tiles(counters: dict[str, int]) -> Json:
    return {key: value for key, value in counters.items() if key.startswith("tiles_")}


def _plain(settings: Json) -> Json:
    return {key: value for key, value in settings.items() if value is not None}


def write_report(folder: Path, report: Json, recording: Recording, played: Replay) -> None:
    """Write report.json and frames.csv; the screen error is that of the replay."""
    folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps(report, indent=2, default=_number, allow_nan=False)
    (folder / "report.json").write_text(text + "\n")
    frames = recording.table()
    frames["screen_error_px"] = played.screen_error_px
    with (folder / "frames.csv").open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(frames.dtype.names or ())
        rows.writerows([_cell(value) for value in frame] for frame in frames.tolist())


def _cell(value: float) -> str:
    """Return a figure as text; what was not measured is empty."""
    return "" if math.isnan(value) else f"{value:.12g}"


def _number(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"not for JSON: {value!r}")

# SPDX-License-Identifier: Apache-2.0
"""`geopage film`: a camera path as a film, every frame of it complete."""

import hashlib
import math
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from geopage import __version__
from geopage.draw_list import DrawList
from geopage.progress import bar
from geopage.selection import Thresholds
from geopage.settings import PagerSettings
from geopage.style import Style
from tiles.errors import InputError
from viewer.camera_path import read_path
from viewer.complete import CompleteFrames
from viewer.film_parts import PART_S, Parts
from viewer.poses import Flight
from viewer.session import Picture, Session

Json = dict[str, Any]


@dataclass(frozen=True, slots=True)
class FilmPlan:
    """What to film, and how."""

    path: Path
    """of the camera path"""
    out: Path
    hz: float = 30.0
    """frames per second of the film"""
    style: Style | None = None
    part_s: float = PART_S
    """An interruption loses the frames of at most so long."""


def film_path(
    store: Path, settings: PagerSettings, picture: Picture, plan: FilmPlan
) -> Json:
    """Film a camera path, or go on where an earlier attempt was stopped.

    Raises
    ------
    InputError
    """
    started_s = time.monotonic()
    path = read_path(plan.path)
    if plan.out.suffix.lower() != ".mp4" or plan.out.is_dir():
        raise InputError(plan.out, "is no .mp4 file", "films are MP4 files, name one")
    with Session(store, settings, picture, plan.style) as session:
        about = _about(session, settings, picture, plan)
        parts = Parts(plan.out, picture.size_px, plan.hz, about, plan.part_s)
        before = parts.count
        flight = Flight(path, session.surface, picture.size_px)
        report = _shoot(session, flight, plan.hz, parts)
    return {
        "out": str(plan.out),
        "size_px": picture.size_px,
        "fps": plan.hz,
        "frames_from_before": before,
        **report,
        "seconds": time.monotonic() - started_s,
    }


def _shoot(session: Session, flight: Flight, hz: float, parts: Parts) -> Json:
    """Draw the frames that are missing and finish the film."""
    count = max(1, math.ceil(flight.path.duration_s * hz - 1e-9))
    frames = CompleteFrames(session)
    limits = Thresholds(session.settings.threshold_px, session.settings.objects_px)
    coarser = 0
    with bar(f"filming {flight.path.name}", count, "frames", parts.count) as show:
        try:
            while parts.count < count:
                drawn, _ = frames.draw(flight.view(parts.count / hz), limits)
                coarser += _is_coarser(drawn, limits)
                parts.add(session.renderer.read_rgb())
                show(parts.count)
        finally:
            parts.close()
        parts.join()
    return {
        "frames": count,
        "threshold_px": limits.terrain_px,
        "frames_short_of_memory": coarser,
        "faults": frames.faults,
    }


def _is_coarser(drawn: DrawList, limits: Thresholds) -> bool:
    return drawn.threshold_px > limits.terrain_px


def _about(
    session: Session, settings: PagerSettings, picture: Picture, plan: FilmPlan
) -> Json:
    """Return all that the pictures depend on; names are words of messages."""
    content = hashlib.sha256()
    for forest in session.pager.forests.values():
        content.update(forest.records.tobytes())
    return {
        "version of geopage": __version__,
        "content of the store": content.hexdigest(),
        "camera path": hashlib.sha256(plan.path.read_bytes()).hexdigest(),
        "size": picture.size_px,
        "supersampling": picture.supersample,
        "frame rate": plan.hz,
        "threshold": settings.threshold_px,
        "object threshold": settings.objects_px,
        "budget": settings.budget_bytes,
        "style": asdict(plan.style) if plan.style else None,
    }

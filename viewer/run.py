# SPDX-License-Identifier: Apache-2.0
"""One run of `geopage fly`: fly, replay, write everything into a folder."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from geopage.progress import bar
from geopage.selection import Thresholds, trees_of
from geopage.settings import MIB, PagerSettings
from geopage.style import Style
from tiles.errors import InputError, TileFault
from tiles.lanes import Lane
from viewer.camera_path import CameraPath
from viewer.charts import flight_over_time
from viewer.film import film
from viewer.flight import Recording, fly_paced, fly_settled
from viewer.governor import Governor
from viewer.key_frames import FRAMES, key_frames_error
from viewer.page import Page, write_page
from viewer.paging_trace import TRACE_TEXT, draw_trace, write_trace
from viewer.poses import Flight
from viewer.recorded import read_flight
from viewer.replay import Replay, Rgb, look_again, time_again
from viewer.report import flight_report, write_report
from viewer.session import Picture, Session

Json = dict[str, Any]
SETTLED_POSES = 60


@dataclass(frozen=True, slots=True)
class Run:
    """What to fly and what to leave behind."""

    path: Path
    out: Path
    paced: bool = True
    poses: int = SETTLED_POSES
    """Of a settled run."""
    film: Path | None = None
    page: bool = True
    style: Style | None = None
    """Colours of the objects."""
    fps: float = 0.0
    """Frames per second to be held by coarser detail; 0: detail is what was asked for."""


def fly(store: Path, settings: PagerSettings, picture: Picture, run: Run) -> Json:
    """Fly a camera path over a store and write report, frames, charts and page.

    Raises
    ------
    InputError
    """
    path = read_flight(run.path)
    make_folders(run)
    with Session(store, settings, picture, run.style) as session:
        flight = Flight(path, session.surface, picture.size_px)
        governor = _governor(session, run)
        recording = _fly(session, flight, run, governor)
        session.pager.close()
        played = _replay(session, recording, path, run)
        about = {"path": path.name, "mode": "paced" if run.paced else "settled"}
        report = flight_report(session, recording, about, played)
        report |= _measure(session, recording, report["faults"])
        if session.styling:
            report["style"] = session.styling.legend
        if governor:
            report["frame_budget"] = governor.figures(recording.table())
    _first_object(report, recording, session)
    write_report(run.out, report, recording, played)
    if recording.trace:
        trees = trees_of(session.pager.forests)
        write_trace(run.out / "trace.csv", recording.trace.table(), trees)
    if run.page:
        _write_page(run, report, recording, played)
    return report


def make_folders(run: Run) -> None:
    """Make the run's folder before anything is flown.

    Raises
    ------
    InputError
    """
    try:
        run.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        advice = "name a folder that can be made"
        raise InputError(run.out, str(error.strerror or error), advice) from error
    if run.film and not run.film.parent.is_dir():
        raise InputError(run.film, "its folder does not exist", "make the folder first")


def _governor(session: Session, run: Run) -> Governor | None:
    """Return what holds the frame rate, if one is to be held."""
    asked = session.settings.threshold_px, session.settings.objects_px
    return Governor(session, Thresholds(*asked), run.fps) if run.fps else None


def _fly(
    session: Session, flight: Flight, run: Run, governor: Governor | None
) -> Recording:
    with bar(f"flying {flight.path.name}", flight.path.duration_s, "s") as show:
        if run.paced:
            return fly_paced(session, flight, show, governor)
        return fly_settled(session, flight, run.poses, show)


def _replay(session: Session, recording: Recording, path: CameraPath, run: Run) -> Replay:
    times_s = [view.t_s for view in recording.views]
    with bar("replaying for the floor", len(times_s), "frames") as show:
        frame_ms = time_again(session, recording, show)
    with (
        film(run.film, session.picture.size_px, path.duration_s) as made,
        bar("replaying for holes and film", len(times_s), "frames") as show,
    ):

        def keep(i: int, rgb: Rgb) -> None:
            if made:
                made.show(times_s[i], rgb)

        return look_again(session, recording, frame_ms, keep if made else None, show)


def _measure(session: Session, recording: Recording, faults: list[str]) -> Json:
    """Return the geometric error as a part of the report; a flight is not lost over it."""
    count = min(FRAMES, len(recording.views))
    try:
        with bar("measuring against the sources", count, "frames") as show:
            found = key_frames_error(session, recording, show)
    except (InputError, TileFault) as error:
        faults.append(str(error))
        found = {}
    return {"geometric_error_px": found} if found else {}


def _first_object(report: Json, recording: Recording, session: Session) -> None:
    """Say how far the first drawn object was, and how far d = s f / threshold says."""
    records = session.pager.forests[Lane.OBJECTS].records
    for view, drawn, frame in zip(
        recording.views, recording.lists, recording.table(), strict=True
    ):
        if frame["objects"] > 0 and len(drawn.objects):
            centre, radius = (
                records["centre"][drawn.objects],
                records["radius_m"][drawn.objects],
            )
            away = ((centre - view.eye) ** 2).sum(axis=1) ** 0.5 - radius
            size = records["proxy_dimension_m"][drawn.objects].max()
            report["drawn"]["first_object_distance_m"] = float(away.min())
            report["drawn"]["first_object_expected_m"] = float(
                size * view.focal_px / drawn.threshold_px
            )
            return


def _write_page(run: Run, report: Json, recording: Recording, played: Replay) -> None:
    flight_over_time(
        recording.table(),
        run.out / "flight.svg",
        error_px=played.screen_error_px,
        budget_bytes=report["memory"]["budget_bytes"],
        floor_ms=played.frame_ms,
        measured=report.get("geometric_error_px", {}).get("frames", ()),
        limit_ms=report.get("frame_budget", {}).get("budget_ms"),
    )
    name = report["settings"]["path"]
    seen = "in real time" if run.paced else "settled at every pose"
    text = (
        "The flight over time. Height, frame time beside its floor, screen error as the"
        " selection knows it and geometric error as measured at key frames, memory."
    )
    film_name = run.film.name if run.film and run.film.parent == run.out else None
    charts = [("flight.svg", text)]
    if recording.trace:
        draw_trace(recording.trace.table(), run.out / "trace.svg")
        charts.append(("trace.svg", TRACE_TEXT))
    write_page(
        run.out, Page(f"Flight {name}", f"Flown {seen}.", report, film_name, (), charts)
    )


def summary(report: Json) -> str:
    """Say in a few lines what a flight was like."""
    frames, floor, error = report["frames"], report["floor"], report["screen_error_px"]
    io, memory = report["io"], report["memory"]
    waits = f", {frames['waits']} waits" if "waits" in frames else ""
    held = report.get("frame_budget")
    rate = (
        f"\n{held['share_within']:.0%} of frames within {held['budget_ms']:.1f} ms,"
        f" at thresholds of {held['threshold_px']['p50']:.2f} px (median) to"
        f" {held['threshold_px']['max']:.2f} px"
        if held
        else ""
    )
    return (
        f"{frames['count']} frames: mean {frames['mean_ms']:.1f} ms,"
        f" sd {frames['sd_ms']:.1f}, median {frames['p50_ms']:.1f}"
        f" (floor {floor['frame_p50_ms']:.1f}), p99 {frames['p99_ms']:.1f}"
        f" (floor {floor['frame_p99_ms']:.1f})\n"
        f"{frames['holes']} holes{waits}, {frames['with_stand_ins']} frames with stand-ins,"
        f" screen error p50 {error['p50']:.2f} px, p95 {error['p95']:.2f} px\n"
        f"{io['tiles_loaded']} tiles, {io['bytes_read'] / 1e6:.1f} MB read,"
        f" peak {memory['peak_bytes'] / MIB:.0f} of {memory['budget_bytes'] / MIB:.0f} MiB"
        + rate
    )

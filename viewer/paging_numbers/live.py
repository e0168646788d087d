# SPDX-License-Identifier: Apache-2.0
"""What only a real clock tells: a view at rest, a flight beside its floors, one frame."""

from pathlib import Path

from geopage.settings import PagerSettings
from tiles import geodesy
from viewer import frame_profile, pairs
from viewer.paging_numbers.jobs import flight_of
from viewer.paging_numbers.limits import (
    FLAT,
    HUGE_BYTES,
    HUGE_HOLES,
    HUGE_RSS,
    OPEN,
    Line,
    line,
)
from viewer.paging_numbers.routes import Route
from viewer.run import Run, fly
from viewer.session import Picture
from viewer.stability.paging_threads import busy_at_rest_s
from viewer.stability.site import Site

HUGE_CITY = "run `python -m tests.benchmarks.huge_city FOLDER`"
ELSEWHERE = (
    Line(HUGE_HOLES, "0", "", OPEN, HUGE_CITY),
    Line(HUGE_BYTES, "the budget", "", OPEN, HUGE_CITY),
    Line(HUGE_RSS, "the budget and a little", "", OPEN, HUGE_CITY),
    Line(FLAT, "1.10", "", OPEN, "run `python -m tests.benchmarks.million FOLDER`"),
)
"""Numbers that benchmarks measure, as long as none is given"""
RATIOS = {
    "p50": "frame time / floor, median",
    "p99": "frame time / floor, 99th percentile",
    "p99_beside_servers": "render loop beside busy servers / alone, 99th percentile",
}
FLIGHT = "add --pairs 5"
PACED = (
    Line("frames that waited, paced fly-in", "0", "", OPEN, FLIGHT),
    Line("frames with a hole, paced fly-in", "0", "", OPEN, FLIGHT),
    *(
        Line(f"{what}, paced fly-in", f"{pairs.LIMITS[name]:g}", "", OPEN, FLIGHT)
        for name, what in RATIOS.items()
    ),
)
"""Numbers of a flight in real time, as long as none is flown"""


def at_rest(route: Route, size_px: tuple[int, int]) -> list[Line]:
    """Look at the place where a flight ends, until all is there, and then for longer."""
    flight = flight_of(route, size_px)
    eye = flight.view(flight.path.duration_s).eye
    lon, lat, height_m = (float(x) for x in geodesy.to_geodetic(eye))
    busy_s, woken, loaded = busy_at_rest_s(route.store, Site(lon, lat, height_m))
    found = f"{woken} wake-ups, {loaded} loads, {1e3 * busy_s:.1f} ms of processor"
    what = "a view at rest: what all paging threads do"
    return [line(what, "0", found, is_met=(busy_s, woken, loaded) == (0, 0, 0))]


def beside_floors(
    route: Route, settings: PagerSettings, picture: Picture, count: int, out: Path
) -> list[Line]:
    """Fly in real time: once for holes, then beside its floors."""
    report = fly(route.store, settings, picture, Run(route.path, out, page=False))
    found = pairs.fly_pairs(route.store, settings, picture, route.path, count)
    pairs.write(found, out)
    waits, holes = max(found["waits"]), report["frames"]["holes"]
    where = f"{route.title}, paced, {picture.size_px[0]} x {picture.size_px[1]}"
    lines = [
        line(f"frames that waited, {where}", "0", str(waits), is_met=not waits),
        line(f"frames with a hole, {where}", "0", str(holes), is_met=not holes),
    ]
    for name, ratio in found["ratios"].items():
        median, limit = ratio["median"], ratio["limit"]
        note = f"{ratio['least']:.2f} to {ratio['most']:.2f}, {count} pairs"
        what = f"{RATIOS[name]}, {where}"
        lines.append(
            line(what, f"{limit:g}", f"{median:.2f}", note, is_met=median <= limit)
        )
    return lines


def profile(
    route: Route, settings: PagerSettings, picture: Picture, t_s: float, out: Path
) -> list[str]:
    """Say where the time of one frame goes."""
    found = frame_profile.profile_frame(route.store, settings, picture, route.path, t_s)
    frame_profile.write(found, out)
    return frame_profile.lines(found)

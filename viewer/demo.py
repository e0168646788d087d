# SPDX-License-Identifier: Apache-2.0
"""The demo: sample world in, pictures, film, report, chart and page out."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from geopage.progress import bar
from geopage.settings import PagerSettings
from tiles.errors import InputError
from tiles.samples import PATHS, SAMPLES
from tiles.store import Store
from viewer.camera_path import read_path
from viewer.charts import read_report, speed_against_accuracy
from viewer.page import Page, write_page
from viewer.picture import write_png
from viewer.poses import Flight
from viewer.run import Run, fly
from viewer.session import Picture, Session

SIZE_PX = (1280, 720)
THRESHOLDS_PX = (1.0, 2.0, 4.0, 8.0, 16.0)
CHART_POSES = 24
STILLS = (
    ("fly_in", (0.0, 5.0, 8.0, 12.0, 15.0, 17.0, 20.0, 22.0, 26.0, 30.0)),
    ("langtang", (0.0, 8.0, 14.0, 25.0)),
    ("street_orbit", (0.0, 7.0)),
)
"""Camera paths, and the seconds at which pictures are taken."""
STEPS = (
    ("terrain", ("himalaya.tif", "langtang.tif", "sanfrancisco.tif"), ("--datum", "egm96")),
    ("imagery", ("langtang_ground.tif", "sanfrancisco_ground.tif"), ()),
    ("buildings", ("sanfrancisco_buildings.gpkg",), ()),
)
"""What is ingested, after the sample earth that every new store starts from."""
CREDITS = (
    "Earth: ETOPO1 (NOAA, public domain), ice surfaces by pvlib and a plastic ice model.",
    "Picture of the earth: NASA Blue Marble (public domain).",
    "Himalaya: GLOBE (NOAA, public domain).",
    "Langtang and San Francisco: (c) OpenStreetMap contributors, ODbL, from vector tiles.",
)
LEAD = (
    "From 10,000 km above the earth to 10 m above a street in San Francisco in 30 seconds,"
    " paged from one file, drawn without a GPU."
)


def make_demo(out: Path) -> None:
    """Make everything; what is there already is used again.

    Raises
    ------
    InputError
    """
    out.mkdir(parents=True, exist_ok=True)
    store = out / "world.geopage"
    ingest_samples(store)
    flight = Run(PATHS / "fly_in.json", out, film=out / "flight.mp4", page=True)
    report = _fly_once(store, flight)
    runs = [_settled(store, out, threshold) for threshold in THRESHOLDS_PX]
    speed_against_accuracy([report, *map(read_report, runs)], out / "chart.svg")
    pictures = take_pictures(store, out)
    with Store(store) as reader:
        sources = reader.sources()
    text = (
        "Speed against accuracy. Each dot is a flight at one threshold; its bar reaches to"
        " the 99th percentile. The geometric error was measured at key frames, both ways,"
        " against the sources' own posts; beside it stands what the selection knew."
    )
    over = (
        "The flight over time. Height, frame time beside its floor, screen error, memory."
    )
    charts = [("chart.svg", text), ("flight.svg", over)]
    write_page(
        out,
        Page(
            "geopage demo", LEAD, report, "flight.mp4", pictures, charts, sources, CREDITS
        ),
    )


def ingest_samples(store: Path) -> None:
    """Ingest what the store does not hold yet, each step in a process of its own.

    What reading elevation models and footprints takes of memory is then given back
    before anything is flown and measured.
    """
    have: set[str] = set()
    if store.exists():
        with Store(store) as reader:
            have = {source["name"] for source in reader.sources()}
    for kind, files, options in STEPS:
        missing = [str(SAMPLES / file) for file in files if file.split(".")[0] not in have]
        words = ["ingest", kind, str(store), *missing, *options]
        if (
            missing
            and subprocess.run(
                [sys.executable, "-m", "geopage", *words], check=False
            ).returncode
        ):
            raise InputError(
                store, "the sample world was not ingested", "remove it, try again"
            )


def _fly_once(store: Path, run: Run) -> dict[str, Any]:
    made = run.out / "report.json"
    if not (
        made.exists()
        and run.film
        and run.film.exists()
        and made.stat().st_mtime > store.stat().st_mtime
    ):
        fly(store, PagerSettings(), Picture(SIZE_PX), run)
    report: dict[str, Any] = json.loads(made.read_text())
    return report


def _settled(store: Path, out: Path, threshold_px: float) -> Path:
    folder = out / "runs" / f"settled_{threshold_px:g}px"
    made = folder / "report.json"
    if not made.exists() or made.stat().st_mtime < store.stat().st_mtime:
        run = Run(PATHS / "fly_in.json", folder, paced=False, poses=CHART_POSES, page=False)
        fly(store, PagerSettings(threshold_px), Picture(SIZE_PX), run)
    return folder


def take_pictures(store: Path, out: Path) -> list[tuple[str, str]]:
    """Take settled pictures along the paths, finer than the film."""
    folder = out / "frames"
    folder.mkdir(exist_ok=True)
    shown: list[tuple[str, str]] = []
    picture = Picture(SIZE_PX, supersample=2)
    with Session(store, PagerSettings(1.0), picture) as session:
        for name, times_s in STILLS:
            flight = Flight(read_path(PATHS / f"{name}.json"), session.surface, SIZE_PX)
            with bar(f"pictures of {name}", len(times_s), "pictures") as show:
                for i, t_s in enumerate(times_s):
                    session.settle(flight.view(t_s))
                    path = folder / f"{name}_{i:02d}.png"
                    write_png(path, session.renderer.read_rgb())
                    shown.append((f"frames/{path.name}", f"{name}, {t_s:.0f} s"))
                    show(i + 1)
    return shown

# SPDX-License-Identifier: Apache-2.0
"""`geopage ingest` and `geopage remove`."""

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tqdm import tqdm

from ingest.buildings import rebuild_objects, remove_buildings
from ingest.cli_buildings import (
    FORMATS,
    building_arguments,
    buildings,
    synthetic,
    synthetic_arguments,
)
from ingest.cli_report import show
from ingest.closing import close
from ingest.opening import opened
from ingest.raster_copy import REASONS
from ingest.sample_world import earth_files
from ingest.terrain import RasterOptions, editing, ingest_rasters, remove_raster
from tiles.errors import InputError, Parser, is_interrupt
from tiles.kernels import is_compiled
from tiles.lanes import Lane
from tiles.store import Store

QUIET_S = 1.0
"""A stage shorter than this leaves no bar."""
UNITS = {"reading": " posts", "meshing": " tiles", "storing": " buildings"}
"""What a stage counts, by its first word."""


ELEVATIONS = "GeoTIFF, HGT (also zipped), VRT, netCDF, ASCII grid, BIL, DTED"
GOES_ON = "After Ctrl-C the same command goes on; the same source again replaces itself."
MORE = {
    "terrain": "The finest source wins at every place; where it has no data, the next does."
    " Around it the coarser surface is bent to meet it, over one post spacing of the"
    " coarser one; the report says how far that is. --datum, --units and --crs are for all"
    " files of the command: give files that differ in commands of their own.",
    "imagery": "The finest picture wins; where none is, ground is tinted by its height.",
}


class Bars:
    """Progress of one stage after another, as bars on stderr."""

    def __init__(self) -> None:
        self._what = ""
        self._bar: Any = None

    def __call__(self, done: int, total: int, what: str) -> None:
        """Show that `done` of `total` steps of a stage are done."""
        if what != self._what:
            self.close()
            self._what = what
            unit = UNITS.get(what.split(maxsplit=1)[0], "")
            # What was done before an interruption is no part of the rate.
            begun = done if unit else 0
            self._bar = tqdm(
                total=total,
                desc=what,
                initial=begun,
                # On a screen at once: the first step may take long.
                delay=0 if sys.stderr.isatty() else QUIET_S,
                file=sys.stderr,
                unit=unit or " steps",
                unit_scale=bool(unit),
            )
        self._bar.total = total
        self._bar.update(done - self._bar.n)

    def close(self) -> None:
        """End the last bar."""
        if self._bar is not None:
            self._bar.leave = self._bar.format_dict["elapsed"] >= QUIET_S
            self._bar.close()


def ingest(words: list[str]) -> int:
    """Read elevation models, pictures or footprints into a store."""
    given = parser_of_ingest().parse_args(words)
    bars = Bars()
    fresh = not given.store.exists()
    start_s = time.perf_counter()
    try:
        check_inputs(given)
        given.earth = not given.bare and (fresh or never_finished(given.store))
        report = given.run(given, bars)
    except (KeyboardInterrupt, SystemError) as error:
        if not is_interrupt(error):
            raise
        bars.close()
        print("geopage: interrupted: run the same command again to go on", file=sys.stderr)
        return 130
    finally:
        bars.close()
    report["seconds"] = round(time.perf_counter() - start_s, 2)
    show(report, as_json=given.json)
    return 1 if given.strict and skips(report) else 0


def skips(report: dict[str, Any]) -> int:
    """Count what was skipped; posts that their own file says hold no data are not."""
    return int(report["skipped"] - report["skipped_by_reason"].get(REASONS[0], 0))


def never_finished(path: Path) -> bool:
    """Say whether the ingest that made a store was interrupted."""
    with Store(path) as store:
        return store.meta("generation", "0") == "0" and not store.sources()


def check_inputs(given: argparse.Namespace) -> None:
    """Refuse missing files and a broken store before anything is made."""
    for path in given.sources:
        if not path.exists():
            raise InputError(path, "no such file", "check the path")
        if path.is_dir():
            raise InputError(path, "is a folder", "name a file")
    if given.store.exists():
        Store(given.store).close()
    elif not given.store.parent.is_dir():
        raise InputError(given.store, "its folder does not exist", "make the folder first")


def terrain(given: argparse.Namespace, bars: Bars) -> dict[str, Any]:
    """Ingest elevation models, then ground the buildings again."""
    files = [
        (path, RasterOptions("terrain", given.name, given.crs, given.datum, given.units))
        for path in given.sources
    ]
    return rasters(given, files, bars)


def imagery(given: argparse.Namespace, bars: Bars) -> dict[str, Any]:
    """Ingest pictures."""
    files = [
        (path, RasterOptions("imagery", given.name, given.crs)) for path in given.sources
    ]
    return rasters(given, files, bars)


def rasters(
    given: argparse.Namespace, files: list[tuple[Path, RasterOptions]], bars: Bars
) -> dict[str, Any]:
    """Ingest rasters and ground the buildings on the new terrain."""
    if given.name and len(files) > 1:
        raise InputError(given.name, "one name for several files", "ingest them one by one")
    if not is_compiled(close):
        print(
            "geopage: compiling, once after installing: a minute or more", file=sys.stderr
        )
    # All in one go: whatever is refused is refused before the earth is meshed.
    ground = earth_files() if given.earth else []
    try:
        report = ingest_rasters(given.store, [*ground, *files], bars)
    except InputError as error:
        raise better_refusal(error) from error
    return report | reground(given.store, bars)


def better_refusal(error: InputError) -> InputError:
    """Say which command takes a file of footprints that was given as a raster."""
    subject = error.args[0]
    try:
        with opened(Path(subject)) as found:
            advice = "use `geopage ingest buildings`"
            return InputError(subject, f"a {found.kind.value} file, not a raster", advice)
    except InputError:
        return error


def reground(store: Path, bars: Callable[[int, int, str], None]) -> dict[str, Any]:
    """Ground a store's buildings on its terrain, if it has any."""
    with Store(store) as reader:
        if not reader.object_count() and not len(reader.index(Lane.OBJECTS)):
            return {}
    with editing(store) as writer:
        report = rebuild_objects(writer, progress=bars).report
    said = {key: report[key] for key in ("floating", "sunk", "lifted", "grounding")}
    return {"grounded": report["objects"], **said}


def parser_of_ingest() -> argparse.ArgumentParser:
    """Return the parser of `geopage ingest`."""
    parser = Parser(
        prog="geopage ingest",
        description="Read elevation models, pictures or footprints into a store. A new"
        " store starts from the sample earth; the same source again replaces itself.",
    )
    kinds = parser.add_subparsers(
        required=True, metavar="terrain|imagery|buildings|synthetic"
    )
    for name, run, text in (
        ("terrain", terrain, f"elevation models: {ELEVATIONS}"),
        ("imagery", imagery, "RGB pictures draped on the terrain"),
        ("buildings", buildings, f"footprints or city models: {FORMATS}"),
        ("synthetic", synthetic, "copies of footprints on land around them, to measure by"),
    ):
        more = f"{MORE.get(name, '')} {GOES_ON}".strip()
        kind = kinds.add_parser(name, help=text, description=f"Ingest {text}.", epilog=more)
        kind.set_defaults(run=run)
        kind.add_argument(
            "store", type=Path, help="the .geopage file; made when it is not there"
        )
        if name == "synthetic":
            synthetic_arguments(kind)
        else:
            kind.add_argument("sources", type=Path, nargs="+", metavar="SRC")
        kind.add_argument("--name", help="name of the source (default: the file's name)")
        kind.add_argument(
            "--crs", help="CRS of files that lack or misstate it, such as EPSG:4326"
        )
        kind.add_argument("--bare", action="store_true", help="a new store starts empty")
        kind.add_argument(
            "--strict",
            action="store_true",
            help="exit 1 when anything is skipped that the file does not call no data",
        )
        kind.add_argument("--json", action="store_true", help="one JSON object on stdout")
        if name == "terrain":
            kind.add_argument(
                "--datum",
                help="vertical datum: egm96, egm2008, ellipsoid or EPSG:n (default: the"
                " file's)",
            )
            kind.add_argument(
                "--units",
                choices=("m", "ft", "us-ft"),
                help="of the heights: metres, feet or US survey feet (default: the file's)",
            )
        if name in {"buildings", "synthetic"}:
            building_arguments(kind)
    return parser


def remove(words: list[str]) -> int:
    """Take a source out of a store."""
    parser = Parser(
        prog="geopage remove", description="Take a source out of a store; see geopage info."
    )
    parser.add_argument("store", type=Path)
    parser.add_argument("source")
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout")
    given = parser.parse_args(words)
    with Store(given.store) as reader:
        kinds = {source["name"]: source["kind"] for source in reader.sources()}
    bars = Bars()
    if kinds.get(given.source) == "buildings":
        report = remove_buildings(given.store, given.source, bars)
    else:
        report = remove_raster(given.store, given.source, 0, bars)
        report |= reground(given.store, bars)
    bars.close()
    show(report, as_json=given.json)
    return 0

# SPDX-License-Identifier: Apache-2.0
"""`geopage ingest buildings` and `geopage ingest synthetic`."""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from ingest.buildings import (
    BuildingOptions,
    check_buildings,
    ingest_buildings,
    ingest_synthetic,
)
from ingest.heights import MAX_HEIGHT_M, HeightRules
from ingest.progress import Progress
from ingest.sample_world import earth_files
from ingest.terrain import ingest_rasters
from tiles.store import Store

FORMATS = (
    "GeoPackage, GeoJSON (also lines), FlatGeobuf, Shapefile, GeoParquet, CSV, OSM PBF,"
    " CityJSON, CityJSONSeq, CityGML"
)


def buildings(given: argparse.Namespace, bars: Progress) -> dict[str, Any]:
    """Ingest footprints."""
    options = building_options(given)
    if given.earth:
        make_earth(given, options, bars)
    report = ingest_buildings(given.store, given.sources, options, progress=bars)
    return completed(given.store, report)


def synthetic(given: argparse.Namespace, bars: Progress) -> dict[str, Any]:
    """Ingest copies of footprints."""
    options = building_options(given)
    if given.earth:
        make_earth(given, options, bars)
    source = given.sources[0]
    report = ingest_synthetic(given.store, source, given.count, options, bars)
    return completed(given.store, report)


def make_earth(given: argparse.Namespace, options: BuildingOptions, bars: Progress) -> None:
    """Begin a new store with the sample earth; bad footprints are refused before."""
    check_buildings(given.sources, options)
    note = f"{given.store} is new: it gets the sample earth first (not with --bare)"
    print(f"geopage: {note}", file=sys.stderr)
    ingest_rasters(given.store, earth_files(), bars)


def completed(store: Path, report: dict[str, Any]) -> dict[str, Any]:
    """Return a report with what a person should know about heights and place."""
    warnings = [*report["warnings"], *height_warnings(report)]
    return report | {"warnings": warnings} | lies_at(store, report["sources"])


def height_warnings(report: dict[str, Any]) -> list[str]:
    """Say where most heights are made up, and where heights were passed over."""
    found, heights = [], report["heights"]
    if 2 * heights["default"] > report["stored"]:
        fields = [*heights["height_fields"], *heights["level_fields"]]
        why = (
            f"nothing to use in {' or '.join(fields)}" if fields else "no field of heights"
        )
        found.append(
            f"{heights['default']} of {report['stored']} buildings are"
            f" {heights['default_height_m']:g} m high by default: {why}"
            " (--height, --levels, --default-height)"
        )
    if heights["unreadable_value"]:
        found.append(
            f"{heights['unreadable_value']} buildings have heights or levels that can't be"
            f" used: words, zero, negative, or above {MAX_HEIGHT_M:,.0f} m"
        )
    return found


def lies_at(store: Path, sources: list[str]) -> dict[str, Any]:
    """Say where sources lie, from centre to centre: a wrong CRS shows at a glance."""
    ask = (
        "SELECT MIN(lon_deg), MIN(lat_deg), MAX(lon_deg), MAX(lat_deg) FROM object"
        " WHERE source IN (SELECT value FROM json_each(?))"
    )
    with Store(store) as reader:
        ends = reader.connection.execute(ask, (json.dumps(sources),)).fetchone()
    if ends[0] is None:
        return {}
    return {"lies_at_deg": dict(zip(("west", "south", "east", "north"), ends, strict=True))}


def building_options(given: argparse.Namespace) -> BuildingOptions:
    """Return what a command says about footprints."""
    rules = HeightRules(
        given.height, given.levels, given.base, given.default_height, given.units
    )
    return BuildingOptions(given.name, given.layer, given.crs, rules, given.report)


def synthetic_arguments(kind: argparse.ArgumentParser) -> None:
    """Add what only copies of footprints have."""
    kind.add_argument(
        "--from",
        dest="sources",
        type=Path,
        nargs=1,
        required=True,
        metavar="FILE",
        help="footprints to copy",
    )
    kind.add_argument(
        "--count",
        type=whole_number,
        default=1_000_000,
        metavar="N",
        help="buildings to make (default: %(default)s)",
    )


def whole_number(text: str) -> int:
    """Return a number above zero."""
    count = int(text)
    if count < 1:
        raise argparse.ArgumentTypeError(f"{text} is not above zero")
    return count


def height_m(text: str) -> float:
    """Return the height of a building that has none of its own."""
    try:
        height = float(text)
    except ValueError:
        height = 0.0
    if not 0 < height <= MAX_HEIGHT_M:
        reason = f"expected metres above 0, at most {MAX_HEIGHT_M:g}, got {text!r}"
        raise argparse.ArgumentTypeError(reason)
    return height


def building_arguments(kind: argparse.ArgumentParser) -> None:
    """Add what only footprints have."""
    kind.add_argument("--height", metavar="FIELD", help="height of the top above ground")
    kind.add_argument("--levels", metavar="FIELD", help="number of floors, 3 m each")
    kind.add_argument(
        "--base", metavar="FIELD", help="height of the lower edge above ground"
    )
    kind.add_argument(
        "--default-height",
        type=height_m,
        default=6.0,
        metavar="M",
        help="height of those with neither, in m (default: %(default)s)",
    )
    kind.add_argument(
        "--units", choices=("m", "ft"), default="m", help="of the heights in the file"
    )
    kind.add_argument("--layer", help="layer of a file that has several")
    kind.add_argument(
        "--report", type=Path, metavar="OUT.gpkg", help="what was skipped or repaired"
    )

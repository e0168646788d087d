# SPDX-License-Identifier: Apache-2.0
"""`geopage ingest buildings` and `geopage ingest synthetic`."""

import argparse
from pathlib import Path
from typing import Any

from ingest.buildings import (
    BuildingOptions,
    check_buildings,
    ingest_buildings,
    ingest_synthetic,
)
from ingest.heights import HeightRules
from ingest.progress import Progress
from ingest.sample_world import earth_files
from ingest.terrain import ingest_rasters

FORMATS = (
    "GeoPackage, GeoJSON (also lines), FlatGeobuf, Shapefile, GeoParquet, CSV, OSM PBF,"
    " CityJSON, CityJSONSeq, CityGML"
)


def buildings(given: argparse.Namespace, bars: Progress) -> dict[str, Any]:
    """Ingest footprints."""
    options = building_options(given)
    if given.earth:
        # Refused here, before the earth is meshed.
        check_buildings(given.sources, options)
        ingest_rasters(given.store, earth_files(), bars)
    return ingest_buildings(given.store, given.sources, options, progress=bars)


def synthetic(given: argparse.Namespace, bars: Progress) -> dict[str, Any]:
    """Ingest copies of footprints."""
    options = building_options(given)
    if given.earth:
        check_buildings(given.sources, options)
        ingest_rasters(given.store, earth_files(), bars)
    return ingest_synthetic(given.store, given.sources[0], given.count, options, bars)


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


def building_arguments(kind: argparse.ArgumentParser) -> None:
    """Add what only footprints have."""
    kind.add_argument("--height", metavar="FIELD", help="height of the top above ground")
    kind.add_argument("--levels", metavar="FIELD", help="number of floors, 3 m each")
    kind.add_argument(
        "--base", metavar="FIELD", help="height of the lower edge above ground"
    )
    kind.add_argument("--default-height", type=float, default=6.0, metavar="M")
    kind.add_argument(
        "--units", choices=("m", "ft"), default="m", help="of the height field"
    )
    kind.add_argument("--layer", help="layer of a file that has several")
    kind.add_argument(
        "--report", type=Path, metavar="OUT.gpkg", help="what was skipped or repaired"
    )

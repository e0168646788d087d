# SPDX-License-Identifier: Apache-2.0
"""What is known of rasters before anything is written: kind, place, datum, unit."""

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
from rasterio import DatasetReader

from ingest.datum import datum_in, datum_of, unit_m
from ingest.dem import describe
from ingest.geoid import ZeroSurface
from ingest.horizontal import doubt
from ingest.journal import stamp
from ingest.names import name_of
from ingest.raster_open import files_of, open_raster
from tiles.errors import InputError
from tiles.placement import Box

RGB = 3
Source = dict[str, Any]
"""A source as the store lists it: name, kind, details."""


@dataclass(frozen=True, slots=True)
class RasterOptions:
    """What the user states about a raster."""

    kind: str = "terrain"
    name: str | None = None
    crs: str | None = None
    datum: str | None = None
    units: str | None = None
    """of heights: a key of `datum.UNITS_M`"""
    is_sample: bool = False
    """what a new store starts from: the report is about the others"""


def plan_all(files: Sequence[tuple[Path, RasterOptions]]) -> list[Source]:
    """Check all files before anything is written.

    Raises
    ------
    InputError
    """
    planned = [plan(path, options) for path, options in files]
    names = [source["name"] for source in planned]
    for k, (path, _) in enumerate(files):
        if names[k] in names[:k]:
            reason = f"another file is called {names[k]!r} too"
            raise InputError(path, reason, "ingest them one by one, each with --name")
    return planned


def check_kinds(named: dict[str, Source], planned: Iterable[Source]) -> None:
    """Refuse a source that would replace one of another kind."""
    for source in planned:
        kind = named.get(source["name"], source)["kind"]
        if kind != source["kind"]:
            reason = f"a {kind} source called {source['name']!r} is in the store"
            raise InputError(source["path"], reason, "choose another with --name")


def plan(path: Path, options: RasterOptions) -> Source:
    """Check one file before anything is written."""
    with open_raster(path) as dataset:
        picture = is_picture(path, dataset)
        if picture != (options.kind == "imagery"):
            raise wrong_kind(path, dataset, is_colour=picture)
        source: Source = asdict(describe(path, dataset, options.crs))
        place = pyproj.CRS.from_wkt(source["crs"]), source["bounds_deg"]
        source["doubt"] = doubt(path, *place, source["spacing_m"] / 2)
        if not picture:
            source |= meaning(path, dataset, options, source["bounds_deg"])
        source["stamp"] = stamp(files_of(path, dataset))
    name = options.name or name_of(path)
    return {**source, "name": name, "kind": options.kind}


def wrong_kind(path: Path, dataset: DatasetReader, *, is_colour: bool) -> InputError:
    """Refuse a picture among elevations, or what is no picture among pictures."""
    if is_colour:
        return InputError(path, "is a picture", "use `geopage ingest imagery`")
    if dataset.driver == "JPEG" or dataset.dtypes[0] == "uint8":
        advice = "make three bands with gdal_translate -b 1 -b 1 -b 1"
        return InputError(path, "is a grey picture, not an RGB one", advice)
    return InputError(path, "is not an RGB picture", "use `geopage ingest terrain`")


def meaning(
    path: Path, dataset: DatasetReader, options: RasterOptions, bounds_deg: Box
) -> Source:
    """Say what a file's numbers are: datum, unit_m, vertical_step_m."""
    if dataset.driver == "JPEG":
        raise InputError(path, "is a photograph (JPEG)", "give elevations as a GeoTIFF")
    wkt = options.crs or (dataset.crs.to_wkt() if dataset.crs else None)
    datum = datum_of(path, options.datum, wkt, bounds_deg)
    metres = unit_m(path, options.datum, wkt, dataset.units[0], options.units)
    file_says = datum_in(dataset.crs.to_wkt()) if dataset.crs else None
    whole = np.issubdtype(np.dtype(dataset.dtypes[0]), np.integer)
    return {
        "datum": datum,
        "datum_from": "stated" if options.datum else "file",
        "datum_in_file": file_says,
        "unit_m": metres,
        "vertical_step_m": abs(dataset.scales[0]) * metres if whole else 0.0,
    }


def is_picture(path: Path, dataset: DatasetReader) -> bool:
    """Say whether a raster holds colours, not elevations."""
    colour = dataset.colorinterp[0].name
    if colour == "palette":
        advice = "convert it with gdal_translate -expand rgb"
        raise InputError(path, "holds palette indices", advice)
    if colour == "red" and dataset.dtypes[0] != "uint8":
        advice = "convert it with gdal_translate -ot Byte -scale"
        raise InputError(path, f"holds {dataset.dtypes[0]} colours", advice)
    return bool(dataset.dtypes[0] == "uint8" and dataset.count >= RGB)


def said_of(source: Source) -> Source:
    """Report on a source: name, and for elevations the datum and what it amounts to."""
    about = {"name": source["name"], "datum": source.get("datum")}
    about |= {"spacing_m": source["spacing_m"], "bounds_deg": source["bounds_deg"]}
    if source["kind"] != "terrain":
        return about
    datum = source["datum"]
    other = "egm96" if datum == "ellipsoid" else datum
    low_m, high_m = (round(edge, 1) for edge in ZeroSurface(source).extent_m(other))
    about |= {"datum_from": source["datum_from"], "unit_m": source["unit_m"]}
    if datum == "ellipsoid":
        text = f"ellipsoid: with {other} heights would be {low_m} to {high_m} m larger"
    else:
        text = f"{datum}: heights are {low_m} to {high_m} m above what the ellipsoid gives"
    text += ", as stated" if source["datum_from"] == "stated" else ", as the file says"
    if source.get("datum_in_file") not in {None, datum}:
        text += f" (the file says {source['datum_in_file']})"
    if source["unit_m"] != 1.0:
        text += f"; heights in units of {source['unit_m']:.6g} m"
    if source["bands"] > 1:
        text += f"; the first of its {source['bands']} bands"
    return {**about, "geoid_m": [low_m, high_m], "datum_here": text}

# SPDX-License-Identifier: Apache-2.0
"""`geopage ingest buildings`: plan (read and check all files), build, write.

Nothing is written before every file was read, and everything is written in one
transaction: a crash leaves the store as it was.
"""

import time
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ingest.feature_report import write_feature_report
from ingest.features import Features, joined_reports, read_features
from ingest.grounding import Ground, Grounding, ellipsoid, ground_objects
from ingest.heights import HeightRules
from ingest.object_pyramid import Buildings, Pyramid, build_pyramid, dimensions_m
from ingest.object_table import NewObjects, insert_objects, read_objects, update_places
from ingest.raster_copy import Progress
from ingest.terrain import editing, silent
from tiles.errors import InputError
from tiles.frames import Ints
from tiles.lanes import Lane
from tiles.store import Store
from tiles.surface import Surface
from tiles.writer import Writer

KIND = "buildings"


@dataclass(frozen=True, slots=True)
class BuildingOptions:
    """What a user can say about building files."""

    name: str | None = None
    """name of the source; by default each file's own name without its ending"""
    layer: str | None = None
    crs: str | None = None
    heights: HeightRules = field(default_factory=HeightRules)
    report: Path | None = None
    """GeoPackage to write with skipped, repaired, floating and sunk features"""


@dataclass(frozen=True, slots=True)
class Rebuilt:
    """The objects lane after it was built again."""

    report: dict[str, Any]
    noted: dict[str, Ints]
    """ids of objects that float and that are sunk"""


def ingest_buildings(
    store: str | Path,
    paths: Sequence[str | Path],
    options: BuildingOptions,
    progress: Progress = silent,
    ground: Ground | None = None,
) -> dict[str, Any]:
    """Put building files into a store; a source that is there already is replaced.

    Parameters
    ----------
    store : path of the store, made when it is not there
    progress : called with done, total and what was done
    ground : what to stand on, instead of the store's terrain

    Returns
    -------
    The report: read = stored + merged + skipped, and where the time went.

    Raises
    ------
    InputError
        Before anything is written.
    """
    clock = _Clock()
    _check_report_path(options.report)
    features = _plan(paths, options, progress)
    clock.lap("read")
    with editing(store) as writer:
        _check_names(writer, features)
        with writer.transaction():
            ids = {name: _store(writer, name, one) for name, one in features.items()}
            clock.lap("store")
            rebuilt = rebuild_objects(writer, ground or ground_of(writer), progress)
            clock.lap("build")
            report = _report(features, rebuilt)
            for name, one in features.items():
                writer.put_source(name, KIND, one.details())
        clock.lap("commit")
    if options.report is not None:
        write_feature_report(options.report, features, ids, rebuilt.noted)
    report["seconds"], report["stages_s"] = clock.total, clock.laps
    return report


def rebuild_objects(
    writer: Writer, ground: Ground | None, progress: Progress = silent
) -> Rebuilt:
    """Ground all objects of a store again and make all object tiles anew.

    Joins the caller's transaction, or makes its own. Without `ground` the objects
    stand on the ellipsoid, and the report warns of it.
    """
    rows = read_objects(writer)
    place = ground_objects(rows.polygon, ground or ellipsoid)
    progress(1, 1, "grounded")
    base_m = place.low_m + rows.raised_m
    dimension_m = dimensions_m(rows.polygon, rows.height_m)
    pyramid = build_pyramid(
        Buildings(
            rows.id,
            rows.polygon,
            place.foot_m(rows.raised_m),
            place.low_m,
            base_m + rows.height_m,
            dimension_m,
        ),
        progress,
    )
    inside = writer.connection.in_transaction
    with nullcontext() if inside else writer.transaction():
        update_places(writer, rows, pyramid.cell, base_m, dimension_m)
        numbers = writer.add_tiles(Lane.OBJECTS, pyramid.tiles)
        writer.replace_index(Lane.OBJECTS, pyramid.named(numbers))
    noted = {
        "floating": rows.id[place.floating(rows.raised_m)],
        "sunk": rows.id[place.sunk(rows.raised_m + rows.height_m)],
    }
    report = _lane_report(pyramid, place, len(rows.id))
    report |= {remark: len(ids) for remark, ids in noted.items()}
    if ground is None and len(rows.id):
        report["warnings"] = ["no terrain: buildings stand on the ellipsoid at height 0"]
    return Rebuilt(report, noted)


def remove_buildings(
    store: str | Path, name: str, progress: Progress = silent
) -> dict[str, Any]:
    """Take a building source out and make the object tiles again without it."""
    with Writer(store) as writer, writer.transaction():
        writer.drop_source(name)
        rebuilt = rebuild_objects(writer, ground_of(writer), progress)
        return {"removed": name, **rebuilt.report}


def ground_of(store: Store) -> Ground | None:
    """Return the terrain of a store as a function of place, None where it has none."""
    return Surface(store).heights if len(store.index(Lane.TERRAIN)) else None


def _lane_report(pyramid: Pyramid, place: Grounding, count: int) -> dict[str, Any]:
    _, held = np.unique(pyramid.cell, return_counts=True)
    proxied = pyramid.records["proxy_dimension_m"] > 0
    return {
        "objects": count,
        "objects_per_cell": {
            "median": float(np.median(held)) if count else 0.0,
            "max": int(held.max(initial=0)),
        },
        "cells": len(pyramid.records),
        "tiles": len(pyramid.tiles),
        "tile_bytes": int(pyramid.records["tile_bytes"].sum()),
        "cells_with_proxies_below": int(proxied.sum()),
        "proxy_error_m": float(pyramid.records["error_m"].max(initial=0.0)),
        "plinth_max_m": float(place.plinth_m.max(initial=0.0)),
        "warnings": [],
    }


def _plan(
    paths: Sequence[str | Path], options: BuildingOptions, progress: Progress
) -> dict[str, Features]:
    """Read all files; one source for each name."""
    found: dict[str, Features] = {}
    for k, path in enumerate(paths):
        name = options.name or Path(path).name.split(".")[0]
        one = read_features(path, options.layer, options.crs, options.heights)
        found[name] = found[name] + one if name in found else one
        progress(k + 1, len(paths), f"read {Path(path).name}")
    return {name: one.merged() for name, one in found.items()}


def _check_report_path(report: Path | None) -> None:
    if report is not None and (report.suffix != ".gpkg" or not report.parent.is_dir()):
        raise InputError(
            report, "can't be written", "name a .gpkg file in a folder that exists"
        )


def _check_names(writer: Writer, features: dict[str, Features]) -> None:
    kinds = {source["name"]: source["kind"] for source in writer.sources()}
    for name in features:
        if kinds.get(name, KIND) != KIND:
            reason = f"{kinds[name]} source of this name is in the store"
            raise InputError(name, reason, "choose another with --name")


def _store(writer: Writer, name: str, features: Features) -> Ints:
    """Replace a source's objects and return the ids of the kept features."""
    writer.connection.execute("DELETE FROM object WHERE source=?", (name,))
    kept = features.kept
    raised_m = features.raised_m[kept]
    height_m = features.top_m[kept] - raised_m
    new = NewObjects(features.polygon[kept], raised_m, height_m, features.attributes())
    return insert_objects(writer, name, new)


def _report(features: dict[str, Features], rebuilt: Rebuilt) -> dict[str, Any]:
    read = joined_reports(one.report() for one in features.values())
    heard = [*read["warnings"], *rebuilt.report["warnings"]]
    return {**read, **rebuilt.report, "warnings": heard, "sources": list(features)}


class _Clock:
    def __init__(self) -> None:
        self._start = self._last = time.perf_counter()
        self.laps: dict[str, float] = {}

    def lap(self, name: str) -> None:
        now = time.perf_counter()
        self.laps[name] = round(now - self._last, 3)
        self._last = now

    @property
    def total(self) -> float:
        return round(time.perf_counter() - self._start, 3)

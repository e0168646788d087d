# SPDX-License-Identifier: Apache-2.0
"""Ingest of elevation models and pictures: plan, read, mesh, swap the index."""

import secrets
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rasterio import DatasetReader
from rasterio.errors import RasterioError

from ingest.boxes import Box, grown, meet
from ingest.datum import datum_of, unit_m
from ingest.dem import describe, open_raster, unreadable
from ingest.mosaic import Mosaic
from ingest.raster_copy import Progress, copy_in
from ingest.terrain_build import Recipe, Source, rebuild, require_generation
from tiles.errors import InputError
from tiles.writer import Writer

RGB = 3


@dataclass(frozen=True, slots=True)
class RasterOptions:
    """What the user states about a raster."""

    kind: str = "terrain"
    name: str | None = None
    crs: str | None = None
    datum: str | None = None


def silent(done: int, total: int, what: str) -> None:
    """Report no progress."""


def ingest_rasters(
    store: str | Path,
    files: Sequence[tuple[Path, RasterOptions]],
    progress: Progress = silent,
    workers: int = 0,
) -> dict[str, Any]:
    """Read rasters into a store and make the terrain again where they change it.

    Parameters
    ----------
    files : each with what the user states about it
    workers : processes; 0 for one per core

    Returns
    -------
    Report with `read`, `stored`, `merged`, `skipped`, ... of posts, and a line a source.

    Raises
    ------
    InputError
        Nothing is half-written then: the store is as it was, or was not made.
    """
    start_s = time.perf_counter()
    planned = plan_all(files)
    with editing(store) as writer:
        generation = int(writer.meta("generation"))
        named = {source["name"]: source for source in writer.sources()}
        check_kinds(named, planned)
        new = {source["name"]: copy(writer, source, progress) for source in planned}
        before = [named[name] for name in new if name in named]
        after = list({**named, **new}.values())
        changed = [*before, *new.values()]
        report = change(writer, generation, after, changed, workers, progress)
    posts = sum(source["width"] * source["height"] for source in planned)
    sources = [{"name": s["name"], "datum": s.get("datum")} for s in planned]
    counts = {"read": posts, "stored": posts, "merged": 0, "skipped": 0, "repaired": 0}
    seconds = round(time.perf_counter() - start_s, 2)
    return {
        **counts,
        "skipped_by_reason": {},
        **report,
        "sources": sources,
        "seconds": seconds,
    }


@contextmanager
def editing(store: str | Path) -> Iterator[Writer]:
    """Open a store for writing; a new one that comes to nothing is taken away again."""
    fresh = not Path(store).exists()
    writer = Writer(store)
    try:
        yield writer
    except BaseException:
        writer.close()
        if fresh:
            for tail in ("", "-wal", "-shm"):
                Path(f"{store}{tail}").unlink(missing_ok=True)
        raise
    writer.close()


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


def check_kinds(named: dict[str, Source], planned: list[Source]) -> None:
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
            reason = "is a picture" if picture else "is not an RGB picture"
            other = "imagery" if picture else "terrain"
            raise InputError(path, reason, f"use `geopage ingest {other}`")
        source: Source = asdict(describe(path, dataset, options.crs))
        if not picture:
            wkt = dataset.crs.to_wkt() if dataset.crs else None
            source["datum"] = datum_of(path, options.datum, options.crs or wkt)
            whole = np.issubdtype(np.dtype(dataset.dtypes[0]), np.integer)
            source["unit_m"] = unit_m(options.datum, options.crs or wkt, dataset.units[0])
            step = abs(dataset.scales[0]) * source["unit_m"]
            source["vertical_step_m"] = step if whole else 0.0
    name = options.name or path.name.split(".")[0] or path.name
    return {**source, "name": name, "kind": options.kind}


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


def copy(writer: Writer, source: Source, progress: Progress) -> Source:
    """Copy a planned file's posts into the store under a key that nobody names yet."""
    key = f"{source['name']}@{secrets.token_hex(4)}"
    with open_raster(source["path"]) as dataset, writer.transaction():
        try:
            held = copy_in(writer.connection, key, dataset, source, progress)
        except RasterioError as error:
            raise unreadable(source["path"], error) from error
        if not held:
            raise InputError(source["path"], "holds no data", "check its nodata value")
    return {**source, "blocks": key}


def affected(mosaics: Sequence[Mosaic], changed: Sequence[Source]) -> list[Box]:
    """Return the boxes, feather included, in which changed sources change the terrain.

    Where a source changes, so does the bend of the surface around finer ones that meet it.

    Parameters
    ----------
    mosaics : before and after the change
    changed : sources that came, went or were replaced
    """
    raw = [source for source in changed if source["kind"] in {"terrain", "imagery"}]
    boxes: list[Box] = [tuple(source["bounds_deg"]) for source in raw]
    terrain = [box for box, source in zip(boxes, raw, strict=True) if _is_terrain(source)]
    for mosaic in mosaics:
        for layer in mosaic.layers:
            box = grown(layer.bounds_deg, mosaic.reach_m(layer))
            if any(meet(box, one) for one in terrain) and mosaic.reach_m(layer):
                terrain.append(box)
    return boxes + terrain


def _is_terrain(source: Source) -> bool:
    return bool(source["kind"] == "terrain")


def change(
    writer: Writer,
    generation: int,
    after: list[Source],
    changed: list[Source],
    workers: int,
    progress: Progress,
) -> dict[str, Any]:
    """Give a store other sources and make the terrain again where that changes it."""
    require_generation(writer, generation)
    old = Mosaic(writer.connection, writer.sources("terrain"))
    new = Mosaic(writer.connection, after)
    boxes = affected((old, new), changed)
    for layer in new.layers:
        source = next(one for one in after if one["name"] == layer.name)
        source["reach_m"] = new.reach_m(layer)
    recipe = Recipe(str(writer.path), after, new.rims, boxes)
    return rebuild(writer, recipe, generation, workers, progress)


def remove_raster(
    store: str | Path, name: str, workers: int = 0, progress: Progress = silent
) -> dict[str, Any]:
    """Take a terrain or imagery source out and make the terrain again without it."""
    with editing(store) as writer:
        generation = int(writer.meta("generation"))
        sources = writer.sources()
        gone = [source for source in sources if source["name"] == name]
        rest = [source for source in sources if source["name"] != name]
        report = change(writer, generation, rest, gone, workers, progress)
    return {"removed": name, **report}

# SPDX-License-Identifier: Apache-2.0
"""Ingest of elevation models and pictures: plan, read, mesh, swap the index."""

import os
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ingest.datum import datum_of
from ingest.dem import describe, open_raster
from ingest.layer import Layer
from ingest.mosaic import Mosaic
from ingest.raster_blocks import Progress, copy_in
from ingest.terrain_pyramid import Box, ZoneBuilder, touches
from tiles import cells, zones
from tiles.errors import InputError
from tiles.index_tree import INDEX
from tiles.lanes import Lane
from tiles.store import Store
from tiles.writer import Writer

Source = dict[str, Any]
"""A source as the store lists it: name, kind, details."""


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
    planned = [plan(path, options) for path, options in files]
    with editing(store) as writer:
        named = {source["name"]: source for source in writer.sources()}
        new = {source["name"]: copy(writer, source, progress) for source in planned}
        before = [named[name] for name in new if name in named]
        after = list({**named, **new}.values())
        changed = affected(writer, list(named.values()), before)
        changed += affected(writer, after, list(new.values()))
        report = rebuild(writer, after, changed, workers, progress)
    posts = sum(source["width"] * source["height"] for source in planned)
    sources = [{"name": s["name"], "datum": s.get("datum")} for s in planned]
    counts = {"read": posts, "stored": posts, "merged": 0, "skipped": 0, "repaired": 0}
    seconds = round(time.perf_counter() - start_s, 2)
    return {**counts, "skipped_by_reason": {}, **report, "sources": sources, "seconds": seconds}


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


def plan(path: Path, options: RasterOptions) -> Source:
    """Check one file before anything is written."""
    with open_raster(path) as dataset:
        picture = dataset.dtypes[0] == "uint8" and dataset.count >= 3
        if dataset.colorinterp[0].name == "palette":
            raise InputError(path, "holds palette indices", "convert it with gdal_translate -expand")
        if picture != (options.kind == "imagery"):
            reason = "is a picture" if picture else "is not an RGB picture"
            other = "imagery" if picture else "terrain"
            raise InputError(path, reason, f"use `geopage ingest {other}`")
        source: Source = asdict(describe(path, dataset, options.crs))
        if not picture:
            wkt = dataset.crs.to_wkt() if dataset.crs else None
            source["datum"] = datum_of(path, options.datum, options.crs or wkt)
            whole = np.issubdtype(np.dtype(dataset.dtypes[0]), np.integer)
            source["vertical_step_m"] = 1.0 if whole else 0.0
    return {**source, "name": options.name or path.name.split(".")[0], "kind": options.kind}


def copy(writer: Writer, source: Source, progress: Progress) -> Source:
    """Copy a planned file's posts into the store under a key that nobody names yet."""
    key = f"{source['name']}@{int(writer.meta('generation')) + 1}"
    with open_raster(source["path"]) as dataset, writer.transaction():
        writer.connection.execute("DELETE FROM raster_block WHERE source=?", (key,))
        if not copy_in(writer.connection, key, dataset, progress):
            raise InputError(source["path"], "holds no data", "check its nodata value")
    return {**source, "blocks": key}


def affected(store: Store, sources: list[Source], which: list[Source]) -> list[Box]:
    """Return the boxes, feather included, in which some of the sources change the terrain."""
    mosaic = Mosaic(store.connection, sources)
    reach = {layer.name: mosaic.reach_m(layer) for layer in mosaic.layers}
    boxes: list[Box] = []
    for source in which:
        if source["kind"] in {"terrain", "imagery"}:
            west, south, east, north = source["bounds_deg"]
            up_deg = reach.get(source["name"], 0.0) / 111e3
            widest = np.cos(np.radians(min(89.0, max(abs(south), abs(north)) + up_deg)))
            side_deg = up_deg / float(widest)
            boxes.append((west - side_deg, south - up_deg, east + side_deg, north + up_deg))
    return boxes


def rebuild(
    writer: Writer,
    sources: list[Source],
    changed: list[Box],
    workers: int = 0,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Make the terrain tiles that meet the changed boxes; swap index and sources at once."""
    old = writer.index(Lane.TERRAIN)
    roots = [int(cells.make(zone, 0, 0, 0)) for zone in range(zones.COUNT)]
    have = set(old["cell"].tolist())
    todo = [root for root in roots if root not in have or touches(root, changed)]
    zone_of = cells.ancestor(old["cell"], np.zeros(len(old), np.int64))
    kept = [old[~np.isin(zone_of, todo)]]
    jobs = [Job(str(writer.path), sources, changed, root, old[zone_of == root]) for root in todo]
    jobs.sort(key=lambda job: -len(job.old))
    made = 0
    with writer.transaction():
        for count, (records, bodies) in enumerate(run(jobs, workers)):
            new = np.flatnonzero(records["row"] == 0)
            pairs = zip(records["cell"][new].tolist(), bodies, strict=True)
            records["row"][new] = writer.add_tiles(Lane.TERRAIN, pairs)
            made += len(new)
            kept.append(records)
            progress(count + 1, len(jobs), "meshing zones")
        index = np.concatenate(kept)
        writer.replace_index(Lane.TERRAIN, index)
        writer.replace_sources(sources)
    return {"tiles": len(index), "tiles_made": made}


@dataclass(frozen=True, slots=True)
class Job:
    """One zone to make, as it is sent to a worker."""

    path: str
    sources: list[Source]
    changed: list[Box]
    root: int
    old: NDArray[np.void]


def run(jobs: list[Job], workers: int) -> Iterator[tuple[NDArray[np.void], list[bytes]]]:
    """Make zones here or in several processes; results come as they are done."""
    count = min(workers or os.cpu_count() or 1, len(jobs))
    if count <= 1:
        yield from map(make_zone, jobs)
        return
    with ProcessPoolExecutor(count, get_context("spawn")) as pool:
        for future in as_completed([pool.submit(make_zone, job) for job in jobs]):
            yield future.result()


def make_zone(job: Job) -> tuple[NDArray[np.void], list[bytes]]:
    """Make one zone: its index records, and the bodies of those whose `row` is 0."""
    with Store(job.path) as store:
        terrain, pictures = layers_of(store, job.sources)
        old = {int(record["cell"]): record for record in job.old}
        made = list(ZoneBuilder(terrain, pictures, job.changed, old).build(job.root))
    records = np.concatenate([one.record for one in made])
    return records, [one.body for one in made if one.body is not None]


def layers_of(store: Store, sources: list[Source]) -> tuple[Mosaic, list[Layer]]:
    """Open the terrain of a store as one surface, and its pictures, coarsest first."""
    pictures = [Layer(store.connection, s) for s in sources if s["kind"] == "imagery"]
    pictures.sort(key=lambda layer: -layer.spacing_m)
    return Mosaic(store.connection, sources), pictures


def remove_raster(
    store: str | Path, name: str, workers: int = 0, progress: Progress = silent
) -> dict[str, Any]:
    """Take a terrain or imagery source out and make the terrain again without it."""
    with editing(store) as writer:
        sources = writer.sources()
        gone = [source for source in sources if source["name"] == name]
        changed = affected(writer, sources, gone)
        rest = [source for source in sources if source["name"] != name]
        return {"removed": name, **rebuild(writer, rest, changed, workers, progress)}

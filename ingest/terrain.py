# SPDX-License-Identifier: Apache-2.0
"""Ingest of elevation models and pictures: plan, read, mesh, swap the index."""

import os
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from rasterio.errors import RasterioError

from ingest.datum import datum_of, unit_m
from ingest.dem import describe, open_raster, unreadable
from ingest.layer import Layer
from ingest.mosaic import Mosaic
from ingest.raster_blocks import Progress, copy_in
from ingest.terrain_pyramid import Box, Made, Part, ZoneBuilder, touches
from tiles import cells, zones
from tiles.errors import InputError
from tiles.lanes import Lane
from tiles.store import Store
from tiles.writer import Writer

PART_LEAVES = 120
"""Leaves that one worker makes at a time, about"""
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


def plan(path: Path, options: RasterOptions) -> Source:
    """Check one file before anything is written."""
    with open_raster(path) as dataset:
        picture = dataset.dtypes[0] == "uint8" and dataset.count >= 3
        if dataset.colorinterp[0].name == "palette":
            raise InputError(
                path, "holds palette indices", "convert it with gdal_translate -expand"
            )
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
    return {**source, "name": options.name or path.name.split(".")[0], "kind": options.kind}


def copy(writer: Writer, source: Source, progress: Progress) -> Source:
    """Copy a planned file's posts into the store under a key that nobody names yet."""
    key = f"{source['name']}@{int(writer.meta('generation')) + 1}"
    with open_raster(source["path"]) as dataset, writer.transaction():
        writer.connection.execute("DELETE FROM raster_block WHERE source=?", (key,))
        try:
            unit = float(source.get("unit_m", 1.0))
            held = copy_in(writer.connection, key, dataset, unit, progress)
        except RasterioError as error:
            raise unreadable(source["path"], error) from error
        if not held:
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
    jobs: list[Job] = []
    with reading(writer.path, sources) as (terrain, pictures):
        builder = ZoneBuilder(terrain, pictures, changed, {})
        for root in todo:
            before = old[zone_of == root]
            cut = builder.cut(root, PART_LEAVES)
            jobs += [Job(str(writer.path), sources, changed, cell, before) for cell in cut]
    jobs.sort(key=lambda job: -int(cells.level(job.cell)))
    made: list[MadePart] = []
    with writer.transaction():
        for one in run(jobs, workers):
            made.append(one.stored(writer))
            progress(len(made), len(jobs), "meshing terrain")
        with reading(writer.path, sources) as (terrain, pictures):
            for root in todo:
                parts = [one.part for one in made if cells.contains(root, one.part.cell)]
                if parts[0].cell != root:
                    before_of = {int(r["cell"]): r for r in old[zone_of == root]}
                    builder = ZoneBuilder(terrain, pictures, changed, before_of)
                    top = list(builder.build(root, parts))
                    made.append(MadePart.of(top, parts[0]).stored(writer))
        index = np.concatenate([*kept, *(one.records for one in made)])
        writer.replace_index(Lane.TERRAIN, index)
        writer.replace_sources(sources)
    return {"tiles": len(index), "tiles_made": sum(one.new for one in made)}


@dataclass(frozen=True, slots=True)
class Job:
    """One subtree to make, as it is sent to a worker."""

    path: str
    sources: list[Source]
    changed: list[Box]
    cell: int
    old: NDArray[np.void]


@dataclass(frozen=True, slots=True)
class MadePart:
    """A subtree as it comes from a worker; bodies are dropped once they are stored."""

    records: NDArray[np.void]
    bodies: list[bytes]
    part: Part
    new: int = 0

    @classmethod
    def of(cls, made: list[Made], part: Part) -> Self:
        """Collect finished cells."""
        records = np.concatenate([one.record for one in made])
        return cls(records, [one.body for one in made if one.body is not None], part)

    def stored(self, writer: Writer) -> Self:
        """Insert the new tiles and note their rows; inside a transaction."""
        fresh = np.flatnonzero(self.records["row"] == 0)
        pairs = zip(self.records["cell"][fresh].tolist(), self.bodies, strict=True)
        self.records["row"][fresh] = writer.add_tiles(Lane.TERRAIN, pairs)
        return replace(self, bodies=[], new=len(fresh))


def run(jobs: list[Job], workers: int) -> Iterator[MadePart]:
    """Make subtrees here or in several processes; results come as they are done."""
    count = min(workers or os.cpu_count() or 1, len(jobs))
    if count <= 1:
        yield from map(make_part, jobs)
        return
    with ProcessPoolExecutor(count, get_context("spawn")) as pool:
        for future in as_completed([pool.submit(make_part, job) for job in jobs]):
            yield future.result()


def make_part(job: Job) -> MadePart:
    """Make one subtree: its index records, and the bodies of those whose `row` is 0."""
    old = {int(record["cell"]): record for record in job.old}
    with reading(job.path, job.sources) as (terrain, pictures):
        builder = ZoneBuilder(terrain, pictures, job.changed, old)
        return MadePart.of(*builder.build_part(job.cell))


@contextmanager
def reading(
    path: str | Path, sources: list[Source]
) -> Iterator[tuple[Mosaic, list[Layer]]]:
    """Open a store's terrain as one surface, and its pictures."""
    with Store(path) as store:
        yield layers_of(store, sources)


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

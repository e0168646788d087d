# SPDX-License-Identifier: Apache-2.0
"""Make the terrain tiles that changed sources touch, in several processes."""

import ctypes
import multiprocessing
import os
import signal
import sys
from collections.abc import Generator, Iterator
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ingest.boxes import Box, touches
from ingest.layer import Layer
from ingest.mosaic import Mosaic, Rim
from ingest.raster_copy import Progress
from ingest.terrain_pyramid import Made, Part, ZoneBuilder
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
class Recipe:
    """What every worker must know to make any terrain tile."""

    path: str
    sources: list[Source]
    rims: list[Rim | None]
    """of the sources' mosaic, found once"""
    changed: list[Box]


@dataclass(frozen=True, slots=True)
class Job:
    """One subtree to make, as it is sent to a worker."""

    recipe: Recipe
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


def rebuild(
    writer: Writer, recipe: Recipe, generation: int, workers: int, progress: Progress
) -> dict[str, Any]:
    """Make the terrain tiles that meet the changed boxes; swap index and sources at once.

    Parameters
    ----------
    generation : of the store that the recipe was written for

    Raises
    ------
    InputError
        When another command changed the store in the meantime.
    """
    old = writer.index(Lane.TERRAIN)
    zone_of = cells.ancestor(old["cell"], np.zeros(len(old), np.int64))
    roots = [int(cells.make(zone, 0, 0, 0)) for zone in range(zones.COUNT)]
    todo = [r for r in roots if r not in zone_of or touches(r, recipe.changed)]
    terrain, pictures = layers_of(writer, recipe)
    jobs = [
        Job(recipe, cell, old[zone_of == root])
        for root in todo
        for cell in ZoneBuilder(terrain, pictures, recipe.changed, {}).cut(
            root, PART_LEAVES
        )
    ]
    jobs.sort(key=lambda job: -int(cells.level(job.cell)))
    made: list[MadePart] = []
    with writer.transaction():
        require_generation(writer, generation)
        with closing(run(jobs, workers)) as parts:
            for one in parts:
                made.append(one.stored(writer))
                progress(len(made), len(jobs), "meshing terrain")
        for root in todo:
            below = [one.part for one in made if cells.contains(root, one.part.cell)]
            if below[0].cell != root:
                before = {int(r["cell"]): r for r in old[zone_of == root]}
                builder = ZoneBuilder(terrain, pictures, recipe.changed, before)
                top = list(builder.build(root, below))
                made.append(MadePart.of(top, below[0]).stored(writer))
        kept = old[~np.isin(zone_of, todo)]
        index = np.concatenate([kept, *(one.records for one in made)])
        writer.replace_index(Lane.TERRAIN, index)
        writer.replace_sources(recipe.sources)
    return {"tiles": len(index), "tiles_made": sum(one.new for one in made)}


def require_generation(writer: Writer, generation: int) -> None:
    """Refuse to go on when another command changed the store in the meantime."""
    if int(writer.meta("generation")) != generation:
        raise InputError(writer.path, "another command changed it", "run this one again")


def run(jobs: list[Job], workers: int) -> Generator[MadePart]:
    """Make subtrees here or in several processes; results come as they are done.

    However this ends, no process is left behind.
    """
    count = min(workers or os.cpu_count() or 1, len(jobs))
    if count <= 1:
        yield from map(make_part, jobs)
        return
    strangers = set(multiprocessing.active_children())
    spawn = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(count, spawn, initializer=die_with_parent)
    try:
        for future in as_completed(submitted(pool, jobs)):
            yield future.result()
    except BrokenProcessPool as error:
        raise InputError(
            jobs[0].recipe.path, "a worker process died", "run again with more memory"
        ) from error
    except BaseException:
        for worker in set(multiprocessing.active_children()) - strangers:
            worker.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def submitted(pool: ProcessPoolExecutor, jobs: list[Job]) -> list[Future[MadePart]]:
    """Start the workers, deaf to Ctrl-C: the parent hears it and ends them."""
    with interrupts_held():
        heard = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            return [pool.submit(make_part, job) for job in jobs]
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, heard)


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Put off Ctrl-C: a worker whose start is broken off would print a traceback."""
    held: list[int] = []
    try:
        before = signal.signal(signal.SIGINT, lambda number, _: held.append(number))
    except ValueError:  # not the main thread: Ctrl-C does not come here
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if held:
        raise KeyboardInterrupt


def die_with_parent() -> None:
    """Ask Linux to end this worker when its parent is killed."""
    if sys.platform == "linux":
        set_death_signal = 1
        ctypes.CDLL(None).prctl(set_death_signal, signal.SIGKILL)


def make_part(job: Job) -> MadePart:
    """Make one subtree: its index records, and the bodies of those whose `row` is 0."""
    old = {int(record["cell"]): record for record in job.old}
    with Store(job.recipe.path) as store:
        terrain, pictures = layers_of(store, job.recipe)
        builder = ZoneBuilder(terrain, pictures, job.recipe.changed, old)
        return MadePart.of(*builder.build_part(job.cell))


def layers_of(store: Store, recipe: Recipe) -> tuple[Mosaic, list[Layer]]:
    """Open the terrain of a store as one surface, and its pictures, coarsest first."""
    mine = [source for source in recipe.sources if source["kind"] == "imagery"]
    pictures = [Layer(store.connection, source) for source in mine]
    pictures.sort(key=lambda layer: -layer.spacing_m)
    return Mosaic(store.connection, recipe.sources, recipe.rims), pictures

# SPDX-License-Identifier: Apache-2.0
"""Make the terrain tiles that changed sources touch, in several processes."""

import multiprocessing
import os
import signal
from collections.abc import Generator, Iterable, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any, Self

import msgspec
import numpy as np
from numpy.typing import NDArray

from ingest.boxes import Box, touches
from ingest.clock import Clock
from ingest.journal import Journal, digest, made_by
from ingest.layer import Layer
from ingest.mosaic import Mosaic, Rim
from ingest.progress import Progress
from ingest.raster_plan import Source
from ingest.terrain_plan import Plan
from ingest.terrain_pyramid import Made, Part, ZoneBuilder
from ingest.workers import die_with_parent
from tiles import cells, zones
from tiles.errors import InputError, interrupts_held
from tiles.index_tree import INDEX
from tiles.lanes import Lane
from tiles.raster_blocks import BlockCache
from tiles.store import Store
from tiles.writer import Writer

PART_LEAVES = 400
"""Leaves that one worker makes at a time, about"""


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
    taken: bool = False
    """made by an ingest that was interrupted"""

    @classmethod
    def of(cls, made: list[Made], part: Part) -> Self:
        """Collect finished cells."""
        records = np.concatenate([one.record for one in made])
        return cls(records, [one.body for one in made if one.body is not None], part)

    def stored(self, writer: Writer, note: str | None = None) -> Self:
        """Insert the new tiles and note their rows; inside a transaction.

        Parameters
        ----------
        note : key under which an ingest that goes on later finds the part
        """
        fresh = np.flatnonzero(self.records["row"] == 0)
        pairs = zip(self.records["cell"][fresh].tolist(), self.bodies, strict=True)
        rows = writer.add_tiles(Lane.TERRAIN, pairs)
        self.records["row"][fresh] = rows
        if note:
            said = (self.records.tobytes(), self.part)
            writer.note(note, msgspec.msgpack.encode(said, enc_hook=float), rows=rows)
        return replace(self, bodies=[], new=len(fresh))

    @classmethod
    def noted(cls, said: bytes) -> Self:
        """Take a part from its note."""
        records, part = msgspec.msgpack.decode(said, type=tuple[bytes, Part])
        return cls(np.frombuffer(records, INDEX).copy(), [], part)


def rebuild(
    journal: Journal, recipe: Recipe, workers: int, progress: Progress, clock: Clock
) -> dict[str, Any]:
    """Make the terrain tiles that meet the changed boxes; swap index and sources at once.

    Parts are committed as they come; those that an interrupted ingest made by the same
    recipe are taken over.

    Raises
    ------
    InputError
        When another command changed the store in the meantime.
    """
    writer = journal.writer
    old = writer.index(Lane.TERRAIN)
    zone_of = cells.ancestor(old["cell"], np.zeros(len(old), np.int64))
    roots = [int(cells.make(zone, 0, 0, 0)) for zone in range(zones.COUNT)]
    todo = [r for r in roots if r not in zone_of or touches(r, recipe.changed)]
    plan = Plan(*layers_of(writer, recipe))
    parts = {root: plan.cut(root, PART_LEAVES) for root in todo}
    made = make_parts(journal, recipe, parts, old, workers, progress)
    clock.lap("mesh")
    above = [
        make_above(writer, recipe, root, [made[one].part for one in cut], old)
        for root, cut in parts.items()
        if cut != [root]
    ]
    clock.lap("top levels")
    kept = old[~np.isin(zone_of, todo)]
    with journal.step():
        tops = [one.stored(writer) for one in above]
        index = np.concatenate([kept, *(one.records for one in (*made.values(), *tops))])
        writer.replace_sources(recipe.sources)
        writer.replace_index(Lane.TERRAIN, index)
    clock.lap("swap")
    new = sum(one.new for one in (*made.values(), *tops))
    taken = sum(len(one.records) for one in made.values() if one.taken)
    return {"tiles": len(index), "tiles_made": new, "tiles_taken_over": taken}


def make_parts(
    journal: Journal,
    recipe: Recipe,
    parts: dict[int, list[int]],
    old: NDArray[np.void],
    workers: int,
    progress: Progress,
) -> dict[int, MadePart]:
    """Make the parts of zones that no interrupted ingest has made; store what comes."""
    wanted = sorted((one for cut in parts.values() for one in cut), key=cells.level)
    start = f"part {name_of(recipe, wanted)} "
    said = journal.writer.noted(start)
    made = {int(cell): MadePart.noted(body) for cell, body in said.items()}
    made = {cell: replace(one, taken=True) for cell, one in made.items()}
    jobs = [Job(recipe, cell, around(old, cell)) for cell in wanted if cell not in made]
    tiles = sum(len(one.records) for one in made.values())
    with journal.undisturbed(), closing(run(jobs, workers)) as finished:
        for one in finished:
            with journal.step():
                cell = one.part.cell
                made[cell] = one.stored(journal.writer, f"{start}{cell}")
            tiles += len(one.records)
            # How many there will be is known by what there is so far.
            expected = round(tiles * len(wanted) / len(made))
            progress(tiles, max(tiles, expected), "meshing terrain")
    return made


def name_of(recipe: Recipe, wanted: list[int]) -> str:
    """Name what the tiles of a recipe depend on, the mesher's own code included."""
    code = made_by(Path(__file__).parent, Path(cells.__file__).parent)
    return digest(recipe.sources, recipe.changed, wanted, code)


def around(old: NDArray[np.void], cell: int) -> NDArray[np.void]:
    """Return the records of a cell, of what is below and of what is above it."""
    depth = int(cells.level(cell))
    above = [int(cells.ancestor(cell, level)) for level in range(depth)]
    first, last = cells.range_min(cell), cells.range_max(cell)
    below = (old["cell"] >= first) & (old["cell"] <= last)
    return old[below | np.isin(old["cell"], above)]


def make_above(
    writer: Writer, recipe: Recipe, root: int, parts: list[Part], old: NDArray[np.void]
) -> MadePart:
    """Make the cells of a zone above its parts."""
    deepest = max(int(cells.level(part.cell)) for part in parts)
    near = around(old, root)
    near = near[cells.level(near["cell"]) < deepest]
    builder = builder_of(writer, recipe, {int(one["cell"]): one for one in near})
    return MadePart.of(list(builder.build(root, parts)), parts[0])


def run(jobs: list[Job], workers: int) -> Generator[MadePart]:
    """Make subtrees here or in several processes; results come as they are done.

    No more than two jobs for each process are on their way, so that neither they nor
    their results pile up. However this ends, no process is left behind.
    """
    count = min(workers or os.cpu_count() or 1, len(jobs))
    if count <= 1:
        yield from map(make_part, jobs)
        return
    strangers = set(multiprocessing.active_children())
    spawn = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(count, spawn, initializer=die_with_parent)
    left = iter(jobs)
    try:
        pending = submitted(pool, islice(left, 2 * count))
        while pending:
            done, pending = wait(pending, return_when=FIRST_COMPLETED)
            pending |= submitted(pool, islice(left, len(done)))
            while done:
                yield done.pop().result()
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


def submitted(pool: ProcessPoolExecutor, jobs: Iterable[Job]) -> set[Future[MadePart]]:
    """Start the workers, deaf to Ctrl-C: the parent hears it and ends them."""
    with interrupts_held():
        heard = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            return {pool.submit(make_part, job) for job in jobs}
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, heard)


def make_part(job: Job) -> MadePart:
    """Make one subtree: its index records, and the bodies of those whose `row` is 0."""
    old = {int(record["cell"]): record for record in job.old}
    with Store(job.recipe.path) as store:
        return MadePart.of(*builder_of(store, job.recipe, old).build_part(job.cell))


def builder_of(
    store: Store, recipe: Recipe, old: Mapping[int, NDArray[np.void]]
) -> ZoneBuilder:
    """Return what makes a recipe's tiles; `old` are the records that may stay."""
    terrain, pictures = layers_of(store, recipe)
    return ZoneBuilder(terrain, pictures, recipe.changed, old)


def layers_of(store: Store, recipe: Recipe) -> tuple[Mosaic, list[Layer]]:
    """Open the terrain of a store as one surface, and its pictures, coarsest first."""
    mine = [source for source in recipe.sources if source["kind"] == "imagery"]
    cache = BlockCache()
    pictures = [Layer(store.connection, source, cache) for source in mine]
    pictures.sort(key=lambda layer: -layer.spacing_m)
    return Mosaic(store.connection, recipe.sources, recipe.rims), pictures

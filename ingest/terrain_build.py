# SPDX-License-Identifier: Apache-2.0
"""Make the terrain tiles that changed sources touch, in several processes."""

import os
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Self

import msgspec
import numpy as np
from numpy.typing import NDArray

from ingest.affected import Affected
from ingest.changed import Change
from ingest.clock import Clock
from ingest.journal import Journal, digest, made_by
from ingest.layer import Layer
from ingest.mosaic import Mosaic, Rim
from ingest.progress import Progress
from ingest.raster_plan import Source
from ingest.terrain_plan import Plan
from ingest.terrain_pyramid import Made, Part, ZoneBuilder
from ingest.workers import Workers
from tiles import cells, zones
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
    changed: Change


@dataclass(frozen=True, slots=True)
class Job:
    """One subtree to make, as it is sent to a worker."""

    cell: int
    old: NDArray[np.void]


@dataclass(frozen=True, slots=True)
class TopJob:
    """The cells of a zone above its parts, to make when those are made."""

    root: int
    parts: list[Part]
    old: NDArray[np.void]
    below: NDArray[np.void]
    """records of the cells in the parts"""


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
    terrain, pictures = layers_of(writer, recipe)
    affected = Affected(terrain, recipe.changed)
    plan, builder = Plan(terrain, pictures), ZoneBuilder(terrain, pictures, affected)
    todo = [r for r in roots if r not in zone_of or affected.touches(r)]
    parts = {root: plan.cut(root, PART_LEAVES) for root in todo}
    sizes = {one: plan.tiles(one) for cut in parts.values() for one in cut}
    with crew_of(recipe, workers, builder, len(sizes)) as crew:
        made = make_parts(journal, recipe, sizes, old, crew, progress)
        clock.lap("mesh")
        jobs = [
            top_job(root, [made[one] for one in cut], old)
            for root, cut in parts.items()
            if cut != [root]
        ]
        with journal.undisturbed():
            above = list(crew.run(make_above, jobs))
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


def crew_of(recipe: Recipe, workers: int, own: ZoneBuilder, jobs: int) -> Workers:
    """Return who makes parts: several processes, or for want of work this one alone."""
    count = max(min(workers or os.cpu_count() or 1, jobs), 1)
    equip = partial(builder_of, recipe) if count > 1 else lambda: own
    return Workers(count, recipe.path, equip)


def make_parts(
    journal: Journal,
    recipe: Recipe,
    sizes: dict[int, int],
    old: NDArray[np.void],
    crew: Workers,
    progress: Progress,
) -> dict[int, MadePart]:
    """Make the parts of zones that no interrupted ingest has made; store what comes.

    Parameters
    ----------
    sizes : tiles of each part, about
    """
    start = f"part {name_of(recipe, sorted(sizes))} "
    said = journal.writer.noted(start)
    made = {int(cell): MadePart.noted(body) for cell, body in said.items()}
    made = {cell: replace(one, taken=True) for cell, one in made.items()}
    # The largest first, so that all processes end together; neighbours share blocks.
    wanted = sorted(sizes.keys() - made, key=lambda one: (-sizes[one].bit_length(), one))
    jobs = [Job(cell, around(old, cell)) for cell in wanted]
    total, done = sum(sizes.values()), sum(sizes[cell] for cell in made)
    progress(done, total, "meshing terrain")
    with journal.undisturbed():
        for one in crew.run(make_part, jobs, in_order=False):
            with journal.step():
                cell = one.part.cell
                made[cell] = one.stored(journal.writer, f"{start}{cell}")
            done += sizes[cell]
            progress(done, total, "meshing terrain")
    return made


def name_of(recipe: Recipe, wanted: list[int]) -> str:
    """Name what the tiles of a recipe depend on, the mesher's own code included."""
    code = made_by(Path(__file__).parent, Path(cells.__file__).parent)
    return digest(recipe.sources, asdict(recipe.changed), wanted, code)


def around(old: NDArray[np.void], cell: int) -> NDArray[np.void]:
    """Return the records of a cell, of what is below and of what is above it."""
    depth = int(cells.level(cell))
    above = [int(cells.ancestor(cell, level)) for level in range(depth)]
    first, last = cells.range_min(cell), cells.range_max(cell)
    below = (old["cell"] >= first) & (old["cell"] <= last)
    return old[below | np.isin(old["cell"], above)]


def top_job(root: int, made: list[MadePart], old: NDArray[np.void]) -> TopJob:
    """Say what the cells of a zone above its parts are made of."""
    parts = [one.part for one in made]
    deepest = max(int(cells.level(part.cell)) for part in parts)
    near = around(old, root)
    near = near[cells.level(near["cell"]) < deepest]
    below = np.concatenate([one.records for one in made])
    return TopJob(root, parts, near, below)


def make_above(job: TopJob, builder: ZoneBuilder) -> MadePart:
    """Make the cells of a zone above its parts."""
    near = {int(one["cell"]): one for one in job.old}
    made = builder.build(job.root, job.parts, near, job.below)
    return MadePart.of(made, job.parts[0])


def make_part(job: Job, builder: ZoneBuilder) -> MadePart:
    """Make one subtree: its index records, and the bodies of those whose `row` is 0."""
    old = {int(record["cell"]): record for record in job.old}
    return MadePart.of(*builder.build_part(job.cell, old))


def builder_of(recipe: Recipe) -> ZoneBuilder:
    """Return what makes a recipe's tiles, in a worker; its store is open to its end."""
    terrain, pictures = layers_of(Store(recipe.path), recipe)
    return ZoneBuilder(terrain, pictures, Affected(terrain, recipe.changed))


def layers_of(store: Store, recipe: Recipe) -> tuple[Mosaic, list[Layer]]:
    """Open the terrain of a store as one surface, and its pictures, coarsest first."""
    mine = [source for source in recipe.sources if source["kind"] == "imagery"]
    cache = BlockCache()
    pictures = [Layer(store.connection, source, cache) for source in mine]
    pictures.sort(key=lambda layer: -layer.spacing_m)
    return Mosaic(store.connection, recipe.sources, recipe.rims), pictures

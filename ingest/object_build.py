# SPDX-License-Identifier: Apache-2.0
"""Ground all objects of a store and make the objects lane anew, branch by branch.

Branches are made by worker processes and written as they come, in one transaction: who
reads the store sees the old lane until the new one is whole. The tiles are the same for
any number of workers.
"""

from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ingest.clock import Clock
from ingest.grounding import Ground
from ingest.grounding_report import Levels, described
from ingest.object_branches import (
    BARE,
    Done,
    Footing,
    Grounded,
    Job,
    make,
    make_job,
    standing,
)
from ingest.object_cut import crown
from ingest.object_plan import plan_objects
from ingest.object_pyramid import Branch, Buildings, Made, make_crown
from ingest.object_report import lane_report
from ingest.object_table import ObjectRows, outline_of, read_shapes, update_places
from ingest.progress import Progress, silent
from ingest.workers import Workers
from tiles.frames import Floats, Ints
from tiles.index_tree import INDEX
from tiles.lanes import Lane
from tiles.surface import Surface
from tiles.writer import Writer

BRANCH_OBJECTS = 16_384
"""A cell with more below it is no branch, unless it has no children."""
FEW_OBJECTS = 40_000
"""Fewer are made in this process: others would take longer to start."""
LOOKED_AT = 100_000
"""Of more, every second, third ... is looked at on all levels of the terrain."""


@dataclass(frozen=True, slots=True)
class Rebuilt:
    """The objects lane after it was built again."""

    report: dict[str, Any]
    noted: dict[str, Ints]
    """ids of objects that float, that are sunk and that were lifted"""


def rebuild_objects(
    writer: Writer,
    ground: Ground | None = None,
    progress: Progress = silent,
    workers: Workers | None = None,
    clock: Clock | None = None,
) -> Rebuilt:
    """Ground all objects of a store again and make all object tiles anew.

    Joins the caller's transaction, or makes its own.

    Parameters
    ----------
    ground : what to stand on; by default the store's terrain, or the ellipsoid, of which
        the report then warns
    workers : by default one process for each core, where there are many objects
    clock : goes on with its laps
    """
    inside = writer.connection.in_transaction
    pool = Workers(0, str(writer.path)) if workers is None else nullcontext(workers)
    with nullcontext() if inside else writer.transaction(), pool as ready:
        return _Rebuild(writer, ground, clock or Clock()).run(progress, ready)


class _Rebuild:
    """One making of the objects lane."""

    def __init__(self, writer: Writer, ground: Ground | None, clock: Clock) -> None:
        self._writer, self._clock = writer, clock
        self._bare = ground is None and not len(writer.index(Lane.TERRAIN))
        self._given = Footing(ground, None) if ground else None
        self._outline = outline_of(writer)
        self._plan = plan_objects(self._outline, BRANCH_OBJECTS)
        count = len(self._outline.id)
        self._look_every = 1 + count // LOOKED_AT
        self._base_m = np.zeros(count)
        self._records = [np.zeros(0, INDEX)]
        self._branches: list[Branch] = []
        self._grounded = [Grounded.nothing()]
        clock.lap("plan")

    def run(self, progress: Progress, pool: Workers) -> Rebuilt:
        """Make all of it; inside a transaction."""
        count = len(self._plan.roots)
        for number, done in enumerate(self._done(pool)):
            self._keep(number, done)
            progress(number + 1, count, "making buildings")
        self._clock.lap("branches")
        if count:
            self._crown()
        self._clock.lap("crown")
        update_places(self._writer, self._outline.id, self._plan.cell, self._base_m)
        index = np.concatenate(self._records)
        self._writer.replace_index(Lane.OBJECTS, index)
        self._clock.lap("index")
        return self._rebuilt(index)

    def _footing(self) -> Footing:
        if self._bare:
            return BARE
        return self._given or Footing.on(Surface(self._writer))

    def _done(self, pool: Workers) -> Iterator[Done]:
        """Make the branches, here where they are few."""
        few = len(self._outline.id) < FEW_OBJECTS
        if few or self._given:
            footing = self._footing()
            return (make(job, footing) for job in self._jobs())
        return pool.run(make_job, self._jobs())

    def _jobs(self) -> Iterator[Job]:
        key = str(self._writer.path), self._writer.meta("generation")
        terrain = None if self._bare else key
        for number in range(len(self._plan.roots)):
            cut, objects = self._plan.branch(number)
            yield Job(terrain, self._look_every, cut, *self._read(objects))

    def _read(self, objects: Ints) -> tuple[ObjectRows, Floats]:
        rows = read_shapes(self._writer, self._outline.id[objects])
        return rows, self._outline.dimension_m[objects]

    def _keep(self, number: int, done: Done) -> None:
        """Write the tiles of a branch and keep what the cells above need."""
        records = self._written(done.made)
        _, objects = self._plan.branch(number)
        self._base_m[objects] = done.grounded.base_m
        self._grounded.append(done.grounded)
        root = records["cell"] == self._plan.tree.cell[self._plan.roots[number]]
        self._branches.append(Branch(records[root], done.top))

    def _crown(self) -> None:
        """Make what is above the branches."""
        plan = self._plan
        cut, own, is_root = crown(plan.tree, plan.held, plan.roots)
        objects = plan.order[own]
        rows, dimension_m = self._read(objects)
        footing = self._footing()
        shapes, grounded = standing(rows, footing, self._look_every)
        self._base_m[objects] = grounded.base_m
        self._grounded.append(grounded)
        buildings = Buildings(rows.id, dimension_m, shapes)
        crown_parts = cut, is_root, buildings, self._branches
        self._written(make_crown(*crown_parts, footing.terrain))

    def _written(self, made: Made) -> NDArray[np.void]:
        """Write tiles and return their records with the store's rows."""
        records = made.records
        has_tile = np.flatnonzero(records["row"])
        pairs = zip(records["cell"][has_tile].tolist(), made.bodies, strict=True)
        records["row"][has_tile] = self._writer.add_tiles(Lane.OBJECTS, pairs)
        self._records.append(records)
        return records

    def _rebuilt(self, index: NDArray[np.void]) -> Rebuilt:
        levels = sum((one.levels for one in self._grounded), Levels())
        lifted = np.concatenate([one.lifted for one in self._grounded])
        noted = {
            "floating": np.unique(levels.floating),
            "sunk": np.unique(levels.sunk),
            "lifted": lifted,
        }
        report = lane_report(self._plan.cell, index)
        report["plinth_max_m"] = max(one.plinth_m for one in self._grounded)
        report |= {remark: len(ids) for remark, ids in noted.items()}
        if levels.level:
            grounding = described(self._writer, levels)
            report["grounding"] = {k: grounding[k] for k in ("looked_at", "levels")}
        if self._bare and len(self._outline.id):
            warning = "no terrain: buildings stand on the ellipsoid at height 0"
            report["warnings"] = [warning]
        return Rebuilt(report, noted)

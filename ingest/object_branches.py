# SPDX-License-Identifier: Apache-2.0
"""One branch from rows of the object table to tiles, here or in a worker process."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Self

import numpy as np
import shapely

from ingest.grounding import Ground, Terrain, ellipsoid, ground_objects
from ingest.grounding_report import Levels, Standing, look
from ingest.object_cut import Cut
from ingest.object_pyramid import Buildings, Made, StandIn, make_branch
from ingest.object_table import ObjectRows
from ingest.shapes import Shapes
from tiles.frames import Floats, Ints
from tiles.store import Store
from tiles.surface import Surface


@dataclass(frozen=True, slots=True)
class Job:
    """One branch to make, as it is sent to a worker."""

    terrain: tuple[str, str] | None
    """store to stand on, and its generation; None: the ellipsoid"""
    look_every: int
    """so many buildings have one that is looked at on all levels of the terrain"""
    cut: Cut
    rows: ObjectRows
    dimension_m: Floats


@dataclass(frozen=True, slots=True)
class Footing:
    """What to stand on: the finest ground, and the store's terrain on all levels."""

    ground: Ground
    surface: Surface | None

    @classmethod
    def on(cls, surface: Surface) -> Self:
        """Return that of a store's terrain."""
        return cls(surface.heights, surface)

    @property
    def terrain(self) -> Terrain | None:
        """Return the finest terrain and the coarser, None where there is none."""
        return (self.ground, self.surface.lowest) if self.surface else None


BARE = Footing(ellipsoid, None)


@dataclass(frozen=True, slots=True)
class Grounded:
    """Where the objects of a branch stand."""

    base_m: Floats
    levels: Levels
    lifted: Ints
    """ids"""
    plinth_m: float

    @classmethod
    def nothing(cls) -> Self:
        """Return that of no objects."""
        none = np.zeros(0, np.int64)
        return cls(np.zeros(0), Levels(), none, 0.0)


@dataclass(frozen=True, slots=True)
class Done:
    """A branch as it comes from a worker."""

    made: Made
    top: StandIn
    grounded: Grounded


def make_job(job: Job) -> Done:
    """Make one branch on the terrain of its store, in a worker."""
    return make(job, _terrain(*job.terrain) if job.terrain else BARE)


@lru_cache(maxsize=1)
def _terrain(path: str, generation: str) -> Footing:
    """Open a store's terrain once for all jobs of an ingest."""
    del generation
    return Footing.on(Surface(Store(path)))


def make(job: Job, footing: Footing) -> Done:
    """Make one branch."""
    shapes, grounded = standing(job.rows, footing, job.look_every)
    buildings = Buildings(job.rows.id, job.dimension_m, shapes)
    return Done(*make_branch(job.cut, buildings, footing.terrain), grounded)


def standing(
    rows: ObjectRows, footing: Footing, look_every: int
) -> tuple[Shapes, Grounded]:
    """Put objects on the ground, and look at some of them as they then stand there."""
    if not len(rows.id):
        return Shapes.joined([]), Grounded.nothing()
    polygon = np.asarray(shapely.from_wkb(np.array(rows.footprint, object)), object)
    surface, above_m = footing.surface, rows.raised_m + rows.height_m
    coarser = surface.lowest if surface else None
    place = ground_objects(polygon, footing.ground, above_m, coarser)
    base_m = place.low_m + rows.raised_m
    foot_m, top_m = place.foot_m(rows.raised_m), place.low_m + above_m
    floating = rows.id[place.floating(rows.raised_m)]
    levels = Levels({}, floating, rows.id[place.sunk(above_m)])
    if surface:
        some = np.flatnonzero(rows.id % look_every == 0)
        heights = rows.raised_m[some], rows.height_m[some]
        levels += look(surface, Standing(rows.id[some], polygon[some], *heights))
    lifted = rows.id[place.lifted_m > 0]
    grounded = Grounded(base_m, levels, lifted, float(place.plinth_m.max(initial=0.0)))
    level = np.zeros((len(polygon), 2))
    return Shapes(polygon, foot_m, place.low_m, top_m, rows.solid, level), grounded

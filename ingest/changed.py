# SPDX-License-Identifier: Apache-2.0
"""Where a change of sources changes the terrain.

That is where sources come or go and where the surface bends to meet them; around the
others of their group; and around finer sources that stand on changed ground. Coarser
sources stay as they are everywhere else.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ingest.boxes import Box, grown, meet
from ingest.mosaic import Mosaic
from ingest.raster_plan import Source
from ingest.rim import Rim
from ingest.source_group import SourceGroup, groups_of

Key = tuple[str, str]
"""A source's name, and the key of its posts"""


@dataclass(frozen=True, slots=True)
class Change:
    """What changed, as it is sent to workers; boxes in degrees."""

    pictures: list[Box] = field(default_factory=list)
    ground: list[Box] = field(default_factory=list)
    """what elevation models that came or went hold and bend"""
    rims: list[int] = field(default_factory=list)
    """of `Mosaic.rims`: around them the surface may be bent in another way"""


def change_of(before: Sequence[Source], after: Sequence[Source], mosaic: Mosaic) -> Change:
    """Compare a store's sources before and after a change.

    Parameters
    ----------
    before, after : pictures too; elevation models with their `reach_m`
    mosaic : of those after
    """
    old, new = ({_key(one): one for one in sources} for sources in (before, after))
    changed = old.keys() ^ new.keys()
    mates = _mates(old), _mates(new)
    # In another group, or with another feather, a source's surroundings are others.
    moved = {
        key
        for key in mates[0].keys() & mates[1].keys()
        if [one for one in mates[0][key] if one in new]
        != [one for one in mates[1][key] if one in old]
        or _reach_m(old[key]) != _reach_m(new[key])
    }
    ground = [
        (
            float(one["spacing_m"]),
            grown(_box(one), max(_reach_m(side.get(key, {})) for side in (old, new))),
        )
        for key, one in {**old, **new}.items()
        if one["kind"] == "terrain" and key in changed | moved
    ]
    beside = {
        key for m in mates for key in m.keys() - changed if not changed.isdisjoint(m[key])
    }
    rims = _rims(mosaic, ground, {name for name, _ in beside})
    pictures = [{**old, **new}[key] for key in changed]
    shown = [_box(one) for one in pictures if one["kind"] == "imagery"]
    return Change(shown, [box for _, box in ground], rims)


def _key(source: Source) -> Key:
    return str(source["name"]), str(source.get("blocks"))


def _box(source: Source) -> Box:
    west, south, east, north = source["bounds_deg"]
    return west, south, east, north


def _reach_m(source: Source) -> float:
    return float(source.get("reach_m", 0.0))


def _mates(sources: dict[Key, Source]) -> dict[Key, list[Key]]:
    """Return the group of each elevation model, itself included."""
    terrain = [key for key, one in sources.items() if one["kind"] == "terrain"]
    placed = [(float(sources[key]["spacing_m"]), _box(sources[key])) for key in terrain]
    groups = [[terrain[k] for k in group] for group in groups_of(placed)]
    return {key: group for group in groups for key in group}


def _rims(
    mosaic: Mosaic, ground: Sequence[tuple[float, Box]], beside: set[str]
) -> list[int]:
    """Return which rims are not what they were.

    Parameters
    ----------
    ground : spacing of what changed, and its box: only finer sources stand on it
    beside : names of sources in whose group one came or went
    """
    found, count = [], 0
    bent: list[tuple[SourceGroup, Rim]] = []
    for group in mosaic.groups:
        mixed = any(layer.name in beside for layer in group.layers)
        outer, *inner = enumerate([group.outer, *group.inner], count)
        count += 1 + len(inner)
        coarsest_m = group.layers[0].spacing_m
        boxes = [box for spacing_m, box in ground if spacing_m > coarsest_m]
        if outer[1] and (mixed or _stands_on(group, outer[1], boxes, bent)):
            found.append(outer[0])
            bent.append((group, outer[1]))
        found += [k for k, rim in inner if rim and mixed]
    return found


def _stands_on(
    group: SourceGroup, rim: Rim, boxes: list[Box], bent: list[tuple[SourceGroup, Rim]]
) -> bool:
    """Say whether a rim touches changed ground."""
    near = [box for box in boxes if any(meet(one.bounds_deg, box) for one in group.layers)]
    if not near and not bent:
        return False
    lon, lat = rim.middles()
    for west, south, east, north in np.radians(near).reshape(-1, 4):
        turned = west + (lon - west) % (2 * np.pi)
        if ((turned <= east) & (lat >= south) & (lat <= north)).any():
            return True
    for other, bend in bent:
        at = np.flatnonzero(other.near(lon, lat, bend.feather_m))
        if len(at) and (bend.deltas(lon[at], lat[at])[1] < bend.feather_m).any():
            return True
    return False

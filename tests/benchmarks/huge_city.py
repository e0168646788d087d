# SPDX-License-Identifier: Apache-2.0
"""A generated city far larger than the memory, and a flight over it.

    python -m tests.benchmarks.huge_city FOLDER [--gigabytes 20] [--numbers OUT.json]

writes a store of so many bytes (each block has the same body: random numbers, which do
not compress), flies over it by a virtual clock, with real reads, checks and decoding,
and prints what it took. The store is deleted afterwards. Decoded tiles are kept as long
as a renderer would keep them, so the process's own memory can be held against the budget.
The numbers go into PAGING.md by `geopage paging --also OUT.json`.
"""

import argparse
import json
import math
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from geopage.settings import MIB, PagerSettings
from geopage.view import ViewState
from tests.geopage.trial import Trial, approach
from tests.geopage.worlds import SPOT, deep_globe, terrain_body, write_lane
from tiles import bounds, cells, zones
from tiles.codec import checksum
from tiles.frames import WGS84_A_M
from tiles.index_tree import INDEX
from tiles.lanes import Lane
from tiles.mesh import VERTEX, Mesh
from tiles.objects import OBJECT, PROXY, ObjectTile, encode
from tiles.writer import Writer
from viewer.flight import FRAME_S
from viewer.holes import ObjectHoles
from viewer.memory import resident_bytes
from viewer.paging_numbers.limits import (
    HUGE_BYTES,
    HUGE_HOLES,
    HUGE_RSS,
    MISSED,
    Line,
    as_dict,
    in_words,
    line,
)
from viewer.stability.site import DOWN_RAD, Site

BLOCK_LEVEL, TILE_LEVELS = 14, (8, 10, 12, 14)
ERRORS_M = {8: 160.0, 10: 40.0, 12: 10.0, 14: 0.0}
BUILDING_M, TALLEST_M, BUILDINGS = 20.0, 60.0, 20
BATCH = 500
ABOVE_M, SPEED_M_S = 600.0, 400.0
FALL_S, TURN_S, LOOK_RAD = 10.0, 3.0, -0.5
BESIDE_BYTES = 32 * MIB
"""What a process grows by beside the tiles: indexes of tests, code, the views."""
EVERY = 5
"""Frames from one look for missing objects to the next."""


def city_blocks(side: int) -> NDArray[np.int64]:
    """Return the cells of a square of blocks around the spot, (side * side,)."""
    step = zones.SIZE_RAD / 2**BLOCK_LEVEL
    away = (np.arange(side) - side / 2 + 0.5) * step
    lon, lat = np.meshgrid(SPOT[0] + away, SPOT[1] + away)
    return np.unique(cells.cell_at(lon.ravel(), lat.ravel(), BLOCK_LEVEL))


def city_records(blocks: NDArray[np.int64]) -> NDArray[np.void]:
    """Return index records of blocks and all cells above them, without sizes."""
    above = [np.unique(cells.ancestor(blocks, n)) for n in range(BLOCK_LEVEL)]
    ids = np.sort(np.concatenate((blocks, *above)))
    level = cells.level(ids)
    records = np.zeros(len(ids), INDEX)
    records["cell"] = ids
    centre, radius_m = bounds.sphere_of(ids, 0.0, TALLEST_M)
    records["centre"], records["radius_m"] = centre, np.ceil(radius_m)
    records["max_height_m"] = TALLEST_M
    records["own_dimension_m"] = np.where(level == BLOCK_LEVEL, BUILDING_M, 0.0)
    records["subtree_dimension_m"] = BUILDING_M
    coarse = np.array([next(n for n in TILE_LEVELS if n >= m) for m in range(15)])[level]
    records["error_m"] = np.vectorize(ERRORS_M.get)(coarse)
    has_proxies = level < BLOCK_LEVEL
    edge_m = WGS84_A_M * zones.SIZE_RAD / 2.0 ** (level + 1)
    records["proxy_dimension_m"] = np.where(has_proxies, edge_m, 0.0)
    below = np.isin(cells.children(ids), ids) @ np.array((1, 2, 4, 8), np.uint8)
    records["proxies"] = np.where(np.isin(level, TILE_LEVELS) & has_proxies, below, 0)
    return records


def block_body(cell: int, vertices: int, *, proxies: int) -> tuple[bytes, int]:
    """Return a body that holds so many random vertices, and its decoded size."""
    rng = np.random.default_rng(vertices)
    mesh_vertices = np.zeros(vertices, VERTEX)
    for name in ("position", "detail"):
        shape = mesh_vertices[name].shape
        mesh_vertices[name] = rng.integers(0, 2**15, shape)
    mesh = Mesh(np.zeros(3), 1.0, mesh_vertices, np.arange(vertices, dtype=np.uint16))
    objects = np.zeros(0 if proxies else BUILDINGS, OBJECT)
    objects["dimension_m"], objects["index_end"] = BUILDING_M, 3
    shapes = np.zeros(proxies, PROXY)
    shapes["child"], shapes["index_end"] = np.arange(proxies), 3
    tile = ObjectTile(cell, mesh, objects, shapes)
    return encode(tile), mesh.gpu_bytes + objects.nbytes + shapes.nbytes


def write_city(path: Path, side: int, vertices: int) -> NDArray[np.void]:
    """Write the store, with a tenth of the vertices in tiles of proxies."""
    things = city_records(city_blocks(side))
    named = np.flatnonzero(np.isin(cells.level(things["cell"]), TILE_LEVELS))
    with Writer(path) as writer:
        with writer.transaction():
            write_lane(writer, Lane.TERRAIN, deep_globe(), terrain_body)
        for start in range(0, len(named), BATCH):
            with writer.transaction():
                write_tiles(writer, things, named[start : start + BATCH], vertices)
            writer.trim_log()
        with writer.transaction():
            writer.replace_index(Lane.OBJECTS, things)
    return things


def write_tiles(
    writer: Writer, things: NDArray[np.void], places: NDArray[np.int64], vertices: int
) -> None:
    """Write the tiles of some records, and say in these what was written."""
    is_block = cells.level(things["cell"][places]) == BLOCK_LEVEL
    bodies = {
        kind: block_body(0, vertices if kind else vertices // 10, proxies=0 if kind else 4)
        for kind in (True, False)
    }
    ids = things["cell"][places].tolist()
    found = [bodies[bool(kind)] for kind in is_block]
    tiles = [(cell, body) for cell, (body, _) in zip(ids, found, strict=True)]
    things["row"][places] = writer.add_tiles(Lane.OBJECTS, tiles)
    things["tile_bytes"][places] = [len(body) for body, _ in found]
    things["memory_bytes"][places] = [size for _, size in found]
    things["check"][places] = [checksum(Lane.OBJECTS, *tile) for tile in tiles]


def flight(side: int, seconds: float) -> Iterator[ViewState]:
    """Fall to the middle of the city, then go round and round it, ever farther out."""
    site = Site(*SPOT)
    yield from approach(site, ABOVE_M, FALL_S)
    reach_m = side / 2 * zones.SIZE_RAD / 2**BLOCK_LEVEL * WGS84_A_M * 0.7
    angle = 0.0
    for i in range(round(seconds / FRAME_S)):
        radius_m = reach_m * i * FRAME_S / seconds
        angle += SPEED_M_S * FRAME_S / max(radius_m, ABOVE_M)
        east, north = (radius_m / WGS84_A_M * f(angle) for f in (math.cos, math.sin))
        spot = replace(site, lon_rad=site.lon_rad + east, lat_rad=site.lat_rad + north)
        pitch_rad = DOWN_RAD + (LOOK_RAD - DOWN_RAD) * min(i * FRAME_S / TURN_S, 1.0)
        yield spot.view(ABOVE_M, pitch_rad, t_s=FALL_S + i * FRAME_S)


@dataclass
class Flown:
    """What a flight took."""

    frames: int = 0
    holes: int = 0
    """frames whose ground is not whole, or in which an object has neither itself nor a
    proxy"""
    over_budget: int = 0
    peak_bytes: int = 0
    index_bytes: int = 0
    loaded: int = 0
    read_bytes: int = 0
    rss_over: int = 0
    """frames in which the process had grown by more than the budget and a little"""
    rss_first_bytes: int = 0
    """growth of the process when half of the flight was over"""
    rss_last_bytes: int = 0
    rss_most_bytes: int = 0
    raised: float = 1.0
    """how many times larger the threshold became at most"""


def fly(path: Path, side: int, settings: PagerSettings, seconds: float) -> Flown:
    """Fly over the city; everything is read, checked and decoded for real."""
    found = Flown()
    with Trial(path, settings, dry=False, holds=True) as trial:
        objects, views = ObjectHoles(trial.pager.forests), list(flight(side, seconds))
        trial.settle_globe(views[0])
        before_bytes = resident_bytes() - trial.pager.memory()["uploaded_bytes"]
        for i, view in enumerate(views):
            drawn = trial.frame(view)
            trial.seen.lists.clear()
            if i % EVERY == 0:
                found.holes += objects.count(drawn, view) > 0
            grown = resident_bytes() - before_bytes
            found.rss_over += grown > settings.budget_bytes + BESIDE_BYTES
            found.rss_most_bytes = max(found.rss_most_bytes, grown)
            if 2 * i < len(views):
                found.rss_first_bytes = grown
            found.raised = max(found.raised, drawn.threshold_px / settings.threshold_px)
        found.frames, found.rss_last_bytes = len(views), grown
        found.holes += trial.seen.holes
        memory, counters = trial.pager.memory(), trial.pager.counters
        found.over_budget = trial.seen.over_budget
        found.peak_bytes, found.index_bytes = memory["peak_bytes"], memory["index_bytes"]
        found.loaded, found.read_bytes = counters["tiles_loaded"], counters["bytes_read"]
    return found


def numbers(found: Flown, budget_bytes: int, store: str) -> list[Line]:
    """Hold what was found against the limits."""
    rss_bytes = budget_bytes + BESIDE_BYTES
    return [
        line(
            HUGE_HOLES,
            "0",
            f"{found.holes}",
            f"{store}; {found.frames:,} frames; the oracle can have no fewer",
            is_met=not found.holes,
        ),
        line(
            HUGE_BYTES,
            f"{budget_bytes / MIB:.0f} MiB",
            f"{found.peak_bytes / MIB:.2f} MiB",
            f"{found.over_budget} frames above; {found.index_bytes / MIB:.1f} MiB of index",
            is_met=not found.over_budget,
        ),
        line(
            HUGE_RSS,
            f"{rss_bytes / MIB:.0f} MiB",
            f"{found.rss_most_bytes / MIB:.0f} MiB",
            f"{found.rss_over} frames above; the limit is the budget and"
            f" {BESIDE_BYTES / MIB:.0f} MiB for code and tests",
            is_met=not found.rss_over,
        ),
    ]


def main(words: list[str]) -> int:
    """Write, fly, print, delete."""
    parser = argparse.ArgumentParser(prog="huge_city", description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--gigabytes", type=float, default=20.0)
    parser.add_argument("--budget", type=int, default=512, metavar="MIB")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--numbers", type=Path, metavar="OUT.json")
    given = parser.parse_args(words)
    vertices = 16_000
    size = len(block_body(0, vertices, proxies=0)[0])
    side = math.ceil(math.sqrt(given.gigabytes * 1e9 / size))
    path = given.folder / "huge.geopage"
    try:
        start_s = time.monotonic()
        things = write_city(path, side, vertices)
        store = (
            f"{side * side:,} blocks, {path.stat().st_size / 1e9:.1f} GB on disk,"
            f" {things['memory_bytes'].sum(dtype=np.int64) / 1e9:.1f} GB decoded"
        )
        said = [f"{store}, written in {time.monotonic() - start_s:.0f} s"]
        settings = PagerSettings(budget_bytes=given.budget * MIB, fade_s=0.0)
        start_s = time.monotonic()
        found = fly(path, side, settings, given.seconds)
        said += [f"{name}: {value:,}" for name, value in vars(found).items()]
        said.append(f"flown in {time.monotonic() - start_s:.0f} s")
    finally:
        for one in given.folder.glob("huge.geopage*"):
            one.unlink()
    lines = numbers(found, settings.budget_bytes, store)
    sys.stdout.write("\n".join([*said, *map(in_words, lines)]) + "\n")
    if given.numbers:
        kept = {"numbers": [as_dict(one) for one in lines]}
        given.numbers.write_text(json.dumps(kept, indent=1) + "\n")
    return int(any(one.verdict == MISSED for one in lines))


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))

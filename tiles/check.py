# SPDX-License-Identifier: Apache-2.0
"""Verify a store: every tile's bytes, and what must hold between index, tiles, objects."""

import json
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing

import numpy as np
from numpy.typing import NDArray

from tiles import cells, geodesy, objects, terrain, zones
from tiles.codec import zstd
from tiles.errors import TileFault
from tiles.forest import Forest, build_forest
from tiles.frames import Floats
from tiles.index_tree import is_monotone, rung_errors_m
from tiles.lanes import Lane
from tiles.store import Store

Progress = Callable[[int, int], None]
ROUNDING = 1e-6
"""Share by which an error is larger for being stored as float32"""


def faults_of(store: Store, progress: Progress = lambda done, total: None) -> Iterator[str]:
    """Yield a line for everything that is wrong with a store."""
    seen: list[int] = []
    for lane in Lane:
        try:
            forest = build_forest(store.index(lane))
        except (TileFault, sqlite3.DatabaseError) as fault:
            yield f"{lane.name} index: {fault}"
            continue
        yield from _shape_faults(lane, forest)
        yield from _tile_faults(store, lane, forest, seen, progress)
    for test in (_object_faults(store, seen), _source_faults(store), _file_faults(store)):
        try:
            yield from test
        except sqlite3.DatabaseError as error:
            yield f"file: {error}"


def bounds_m(records: NDArray[np.void]) -> Floats:
    """Return the errors that terrain cells may have, (n,): as large as their texels."""
    return np.asarray(geodesy.cell_edge_m(records["cell"]) / terrain.TEXTURE_SIDE)


def warnings_of(store: Store) -> Iterator[str]:
    """Yield a line for what is sound but could be better.

    An inner terrain cell is made within its bound of the finest source: its true edge over
    the texels along an edge. Where one states more, views refine sooner than for its size.
    """
    records = store.index(Lane.TERRAIN)
    inner = records[records["children"] > 0]
    share = inner["error_m"] / bounds_m(inner)
    over = int((share > 1.0 + ROUNDING).sum())
    if over:
        worst = int(share.argmax())
        name = cells.text(int(inner["cell"][worst]))
        yield (
            f"TERRAIN: {over} of {len(inner)} inner cells state a larger error than their"
            f" bound, up to {share[worst]:.2f} times ({name}): views refine sooner there"
        )


def _shape_faults(lane: Lane, forest: Forest) -> Iterator[str]:
    records = forest.records
    orphans = (forest.parent < 0) & (cells.level(records["cell"]) > 0)
    mask = ((forest.children >= 0) << np.arange(4)).sum(axis=1)
    wrong = {
        "has no parent in the index": orphans,
        "names children that are not there": mask != records["children"],
        "has a larger error than its parent": ~is_monotone(records, forest.parent),
    }
    if lane is Lane.TERRAIN and len(records):
        wrong["has neither 0 nor 4 children"] = ~np.isin(records["children"], (0, 15))
        wrong["has no tile"] = records["row"] == 0
        if (cells.level(records["cell"]) == 0).sum() != zones.COUNT:
            yield "terrain does not cover all zones"
    for what, where in wrong.items():
        for cell in records["cell"][where]:
            yield f"{lane.name} cell {cells.text(int(cell))} {what}"


def _tile_faults(
    store: Store, lane: Lane, forest: Forest, seen: list[int], progress: Progress
) -> Iterator[str]:
    named = forest.records[forest.records["row"] > 0]
    for done, record in enumerate(named):
        progress(done + 1, len(named))
        cell = int(record["cell"])
        try:
            body = store.checked_body(lane, cell, int(record["row"]), int(record["check"]))
            tile = terrain.decode(body) if lane is Lane.TERRAIN else objects.decode(body)
        except TileFault as fault:
            yield str(fault)
            continue
        if tile.cell != cell:
            yield f"{lane.name} tile {cells.text(cell)}: holds another cell's data"
        if tile.mesh.indices.max(initial=0) >= max(len(tile.mesh.vertices), 1):
            yield f"{lane.name} tile {cells.text(cell)}: an index beyond its vertices"
        if isinstance(tile, terrain.TerrainTile):
            stated = rung_errors_m(record[None])[0]
            if stated[np.isfinite(stated)].tolist() != tile.rungs["error_m"].tolist():
                yield f"{lane.name} tile {cells.text(cell)}: other rungs than stated"
        if isinstance(tile, objects.ObjectTile):
            seen += tile.objects["id"].tolist()
            if (np.diff(tile.objects["dimension_m"]) > 0).any():
                yield f"{lane.name} tile {cells.text(cell)}: objects are not largest first"


def _object_faults(store: Store, seen: list[int]) -> Iterator[str]:
    stored = [row[0] for row in store.connection.execute("SELECT id FROM object")]
    for missing in sorted(set(stored) - set(seen)):
        yield f"object {missing} is in no tile"
    ids, counts = np.unique(np.array(seen, np.int64), return_counts=True)
    for twice in ids[counts > 1]:
        yield f"object {twice} is in several tiles"
    for unknown in sorted(set(seen) - set(stored)):
        yield f"object {unknown} is in a tile but not in the object table"


def _source_faults(store: Store) -> Iterator[str]:
    """Look at the copies of the sources, from which terrain is made again."""
    rows = store.connection.execute(
        "SELECT source, level, row, col, body FROM raster_block"
    )
    with closing(rows):
        for source, level, row, col, body in rows:
            try:
                zstd.decompress(body)
            except (zstd.ZstdError, TypeError) as error:
                yield f"copy of {source}, level {level}, block {row} {col}: {error}"
    for name, details in store.connection.execute("SELECT name, details FROM source"):
        try:
            json.loads(details)
        except ValueError:
            yield f"source {name}: unreadable details"


def _file_faults(store: Store) -> Iterator[str]:
    with closing(store.connection.execute("PRAGMA quick_check(5)")) as rows:
        for (line,) in rows:
            if line != "ok":
                yield f"file: {line}"

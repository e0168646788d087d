# SPDX-License-Identifier: Apache-2.0
"""Heights as they are drawn: the finest stored meshes, and the coarser ones above them."""

from collections import OrderedDict

import numpy as np
from numpy.typing import NDArray

from tiles import cells, terrain, zones
from tiles.forest import Forest, build_forest
from tiles.frames import Floats, Ints
from tiles.index_tree import rung_errors_m
from tiles.kernels import inlined, kernel
from tiles.lanes import Lane
from tiles.patch import Patch, heights_on, patch_of
from tiles.store import Store
from tiles.terrain import MOST_RUNGS

CACHE_TILES = 256
_ALONG = 1 << cells.MAX_LEVEL
_STEP_RAD = zones.SIZE_RAD / _ALONG


class Surface:
    """The terrain of a store as a function of place. Thread: the one that made it.

    Places are looked up tile by tile, so that thousands in one call cost less than a
    microsecond each; they cost least where neighbours follow each other.
    """

    def __init__(self, store: Store) -> None:
        self._store = store
        self.forest: Forest = build_forest(store.index(Lane.TERRAIN))
        records = self.forest.records
        self._leaves = np.flatnonzero(records["children"] == 0)
        cell = records["cell"][self._leaves]
        order = np.argsort(cells.range_min(cell)) if len(cell) else np.zeros(0, np.int64)
        self._leaves = self._leaves[order]
        self._first = cells.range_min(cell[order]) if len(cell) else cell
        self._last = cells.range_max(cell[order]) if len(cell) else cell
        # With one entry more, for row -1, which is no tile.
        self.level = np.append(cells.level(records["cell"]), -1)
        """(rows + 1,) level of each tile"""
        self._parent = np.append(self.forest.parent, -1).astype(np.int64)
        self.error_m = np.append(records["error_m"], np.inf)
        """(rows + 1,) measured error of each tile's mesh"""
        self.selected_m = np.maximum(self.error_m, np.append(records["texel_m"], 0.0))
        """(rows + 1,) what the threshold is held against: the mesh's error or the texel"""
        none_m = np.full((1, MOST_RUNGS), np.inf)
        self._rung_m = np.concatenate([rung_errors_m(records), none_m])
        self._cache: OrderedDict[tuple[int, int], Patch] = OrderedDict()

    def rows(self, lon_rad: Floats, lat_rad: Floats) -> NDArray[np.int64]:
        """Return the forest row of the leaf at each place, -1 where there is no terrain.

        Raises
        ------
        ValueError
            When a longitude or latitude is not finite.
        """
        if not len(self._leaves):
            return np.full(np.shape(lon_rad), -1)
        if not (np.isfinite(lon_rad).all() and np.isfinite(lat_rad).all()):
            raise ValueError("a longitude or latitude is not a finite number")
        lon = np.ascontiguousarray(zones.wrap_lon(lon_rad), np.float64)
        lat = np.clip(np.asarray(lat_rad, np.float64), -np.pi / 2, np.pi / 2)
        found = np.empty(lon.size, np.int64)
        _find(
            self._first, self._last, lon.ravel(), np.ascontiguousarray(lat).ravel(), found
        )
        leaf = np.where(found >= 0, self._leaves[found], -1)
        return np.asarray(leaf.reshape(lon.shape))

    def heights(self, lon_rad: Floats, lat_rad: Floats) -> tuple[Floats, Floats]:
        """Return heights above the ellipsoid and the tiles' measured errors, m.

        Parameters
        ----------
        lon_rad, lat_rad : (n,) float64

        Returns
        -------
        height_m, error_m : (n,) float64; 0 and inf in a store without terrain

        Raises
        ------
        TileFault
            When a tile's bytes are not what was written.
        """
        rows = self.rows(lon_rad, lat_rad)
        return self.heights_in(rows, lon_rad, lat_rad), self.error_m[rows]

    def heights_at_level(
        self, lon_rad: Floats, lat_rad: Floats, level: int
    ) -> tuple[Floats, Floats]:
        """Return what `heights` does, of the tiles of a level, or of leaves above it."""
        rows = self.up_to(self.rows(lon_rad, lat_rad), level)
        return self.heights_in(rows, lon_rad, lat_rad), self.error_m[rows]

    def up_to(self, rows: Ints, level: int) -> Ints:
        """Return the rows of the tiles of a level above some rows; -1 stays."""
        while (deep := self.level[rows] > level).any():
            rows = np.where(deep, self._parent[rows], rows)
        return rows

    def heights_in(
        self, rows: Ints, lon_rad: Floats, lat_rad: Floats, rung: int = 0
    ) -> Floats:
        """Return the heights that the tiles in `rows`, (n,), have at places of theirs, m.

        Where a row is -1, the height is 0.

        Parameters
        ----------
        rung : 0 for the tiles' whole meshes
        """
        height = np.zeros(len(rows))
        order = np.argsort(rows, kind="stable")
        lon, lat, sorted_rows = lon_rad[order], lat_rad[order], rows[order]
        ends = np.flatnonzero(np.diff(sorted_rows, append=np.iinfo(np.int64).max)) + 1
        found, first = np.zeros(len(rows)), 0
        for end in ends.tolist():
            row, at = int(sorted_rows[first]), slice(first, end)
            if row >= 0:
                heights_on(self._patch(row, rung), lon[at], lat[at], found[at])
            first = end
        height[order] = found
        return height

    def lowest(self, lon_rad: Floats, lat_rad: Floats, within_m: Floats) -> Floats:
        """Return the lowest height of the coarser terrain that may be drawn instead, m.

        Parameters
        ----------
        lon_rad, lat_rad : (n,) float64
        within_m : (n,) rungs and the tiles above the leaf count up to this screen error,
            m (the mesh's or a texel)

        Returns
        -------
        (n,) float64; infinite where nothing coarser is within the error
        """
        rows = self.rows(lon_rad, lat_rad)
        low, at = np.full(len(rows), np.inf), np.arange(len(rows))
        while len(at):
            for rung in range(1, MOST_RUNGS + 1):
                good = self._rung_m[rows, rung - 1] <= within_m[at]
                few = np.flatnonzero((rows >= 0) & good)
                places = lon_rad[at[few]], lat_rad[at[few]]
                height = self.heights_in(rows[few], *places, rung)
                low[at[few]] = np.minimum(low[at[few]], height)
            rows = self._parent[rows]
            coarse = np.flatnonzero((rows >= 0) & (self.selected_m[rows] <= within_m[at]))
            rows, at = rows[coarse], at[coarse]
            height = self.heights_in(rows, lon_rad[at], lat_rad[at])
            low[at] = np.minimum(low[at], height)
        return low

    def height_at(self, lon_rad: float, lat_rad: float) -> float:
        """Return the height of one place above the ellipsoid, m."""
        return float(self.heights(np.array([lon_rad]), np.array([lat_rad]))[0][0])

    def _patch(self, row: int, rung: int) -> Patch:
        if (row, rung) in self._cache:
            self._cache.move_to_end((row, rung))
            return self._cache[row, rung]
        record = self.forest.records[row]
        key = int(record["cell"]), int(record["row"]), int(record["check"])
        tile = terrain.decode(self._store.checked_body(Lane.TERRAIN, *key))
        patch = self._cache[row, rung] = patch_of(tile, rung)
        if len(self._cache) > CACHE_TILES:
            self._cache.popitem(last=False)
        return patch


@kernel
def _find(first: Ints, last: Ints, lon_rad: Floats, lat_rad: Floats, found: Ints) -> None:
    """Write which range of cell ids holds each place, -1 where none does."""
    leaf = 0
    for i in range(len(lon_rad)):
        row = min(
            _line_below(lat_rad[i]) + zones.ROWS // 2 * _ALONG, zones.ROWS * _ALONG - 1
        )
        column = _line_below(lon_rad[i]) + zones.COLUMNS // 2 * _ALONG
        zone = row // _ALONG * zones.COLUMNS + column // _ALONG
        code = _spread(row % _ALONG) << 1 | _spread(column % _ALONG)
        place = (zone << 2 * cells.MAX_LEVEL | code) << 1 | 1
        if not first[leaf] <= place <= last[leaf]:
            leaf = max(int(np.searchsorted(first, place, side="right")) - 1, 0)
        found[i] = leaf if first[leaf] <= place <= last[leaf] else -1


@inlined
def _line_below(x: float) -> int:
    """Return the last grid line of the deepest level at or below x, as `zones` does."""
    line = np.floor(x / _STEP_RAD)
    return int(line + (x >= (line + 1) * _STEP_RAD) - (x < line * _STEP_RAD))


@inlined
def _spread(x: int) -> int:
    """Put zeros between the 28 bits of x."""
    x = (x | x << 16) & 0x0000FFFF0000FFFF
    x = (x | x << 8) & 0x00FF00FF00FF00FF
    x = (x | x << 4) & 0x0F0F0F0F0F0F0F0F
    x = (x | x << 2) & 0x3333333333333333
    return (x | x << 1) & 0x5555555555555555

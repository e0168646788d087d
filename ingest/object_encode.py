# SPDX-License-Identifier: Apache-2.0
"""The last step of a part: what the selection decides by, and the tiles' bytes."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ingest.object_cut import Cut
from ingest.object_tiles import OwnObjects, Proxies, make_tile
from tiles.codec import HEADER, checksum
from tiles.lanes import Lane
from tiles.objects import ObjectTile, encode

# Half a 16-bit step in three directions, in units of a sphere around the tile.
_ROUNDING = 6e-5


@dataclass(frozen=True, slots=True)
class Decided:
    """A part with all its errors and dimensions."""

    cut: Cut
    records: NDArray[np.void]
    proxies: Proxies


def decided(
    records: NDArray[np.void],
    cut: Cut,
    own: OwnObjects,
    proxies: Proxies,
    is_root: NDArray[np.bool_] | None = None,
) -> Decided:
    """Fill in what the selection decides by; errors and dimensions never grow downwards.

    Parameters
    ----------
    is_root : (c,) records that are known and stay
    """
    tree, parent = cut.tree, cut.tree.parent[cut.held]
    known = np.zeros(len(records), bool) if is_root is None else is_root
    worst, widest, largest = (
        np.where(known, records[name], 0.0)
        for name in ("error_m", "proxy_dimension_m", "subtree_dimension_m")
    )
    error = proxies.error_m + _ROUNDING * records["radius_m"][parent]
    np.maximum.at(worst, parent, error)
    np.maximum.at(widest, parent, proxies.dimension_m)
    largest[tree.has_own] = own.dimension_m[tree.own_first[tree.has_own]]
    records["own_dimension_m"] = np.where(known, records["own_dimension_m"], largest)
    records["subtree_dimension_m"] = tree.raised(np.maximum, largest)
    records["proxy_dimension_m"] = tree.raised(np.maximum, widest)
    worst = tree.raised(np.maximum, worst)
    records["error_m"] = worst
    bit = np.left_shift(1, proxies.child).astype(np.uint8)
    np.bitwise_or.at(records["proxies"], parent, bit)
    proxies = replace(proxies, error_m=np.maximum(error, worst[cut.held]))
    return Decided(cut, records, proxies)


def encoded(part: Decided, own: OwnObjects) -> list[bytes]:
    """Encode every tile, and say in the records how large it is and its checksum."""
    tree, proxies, records = part.cut.tree, part.proxies, part.records
    parent = tree.parent[part.cut.held]
    holds = tree.has_own
    holds[parent] = True
    where = np.flatnonzero(holds)
    proxy_first = np.searchsorted(parent, where)
    proxy_last = np.searchsorted(parent, where, side="right")
    bodies = []
    for k, place in enumerate(where.tolist()):
        own_range = slice(int(tree.own_first[place]), int(tree.own_last[place]))
        proxy_range = slice(int(proxy_first[k]), int(proxy_last[k]))
        cell = int(tree.cell[place])
        tile = make_tile(cell, own, proxies, own_range, proxy_range)
        body = encode(tile)
        records["tile_bytes"][place] = len(body)
        records["memory_bytes"][place] = _memory_bytes(tile)
        records["check"][place] = checksum(Lane.OBJECTS, cell, body)
        bodies.append(body)
    records["row"][where] = 1 + np.arange(len(where))
    return bodies


def _memory_bytes(tile: ObjectTile) -> int:
    tables = tile.objects.nbytes + tile.proxies.nbytes
    return HEADER.itemsize + tile.mesh.gpu_bytes + int(tables)

# SPDX-License-Identifier: Apache-2.0
"""A style applied to one store: an entry of the palette for each object.

The entries are written into the vertices of object tiles as these are decoded; a proxy
gets the entry of the objects that it stands for: the commonest category, or the mean of
the ramp, each object weighted by the square of its bounding dimension.
"""

from dataclasses import replace
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geopage.fields import known_field, values_of
from geopage.palettes import RAMPS
from geopage.scale import FIRST, MISSING_ENTRY, Scale, Values, scale_of
from geopage.style import Style
from tiles import cells
from tiles.errors import InputError
from tiles.frames import Ints
from tiles.mesh import Mesh
from tiles.objects import PROXY_ORDINAL, ObjectTile
from tiles.store import Store

ROWS_AT_ONCE = 20_000
ENTRIES = 256


class Styling:
    """The entries of a store's objects and proxies. Threads: any; it does not change.

    Parameters
    ----------
    scale : the entries of n objects, and what they mean
    number, cell : (n,) id and cell of each object
    weight : (n,) float32, how much each counts for the proxies that stand for it
    """

    def __init__(
        self, scale: Scale, number: Ints, cell: Ints, weight: NDArray[np.float32]
    ) -> None:
        self.palette = scale.palette
        """(256, 3) uint8 sRGB; entry 0 is not used"""
        self.legend: dict[str, Any] = scale.legend
        self._is_ramp = scale.is_ramp
        by_cell = np.argsort(cell, kind="stable")
        self._cell, self._weight = cell[by_cell], weight[by_cell]
        self._entry = scale.entry[by_cell]
        self._of_id = np.full(int(number.max()) + 2, MISSING_ENTRY, np.uint8)
        self._of_id[number] = scale.entry

    def styled(self, tile: ObjectTile) -> ObjectTile:
        """Return a tile with its style in the vertices; all arrays are copies.

        The decompressed bytes are not kept, so a styled tile takes no more memory.
        """
        vertices, indices = tile.mesh.vertices.copy(), tile.mesh.indices.copy()
        own = np.zeros(PROXY_ORDINAL + 1, np.uint8)
        # Who came after the style was made is missing.
        number = np.minimum(tile.objects["id"], len(self._of_id) - 1)
        own[: len(number)] = self._of_id[number]
        entry = own[vertices["detail"][:, 1]]
        for proxy in tile.proxies:
            span = indices[proxy["index_start"] : proxy["index_end"]]
            child = cells.children(tile.cell)[proxy["child"]]
            entry[span] = self.of_subtree(int(child))
        vertices["normal"][:, 3] = entry.view(np.int8)
        mesh = Mesh(tile.mesh.centre, tile.mesh.scale_m, vertices, indices)
        objects, proxies = tile.objects.copy(), tile.proxies.copy()
        return replace(tile, mesh=mesh, objects=objects, proxies=proxies)

    def of_subtree(self, cell: int) -> int:
        """Return the entry that stands for all objects at or below a cell."""
        ends = int(cells.range_min(cell)), int(cells.range_max(cell)) + 1
        first, last = np.searchsorted(self._cell, ends)
        weight = np.bincount(
            self._entry[first:last], self._weight[first:last], minlength=ENTRIES
        )
        if not self._is_ramp:
            return int(weight.argmax()) or MISSING_ENTRY
        valued = weight[FIRST:]
        if not valued.any():
            return MISSING_ENTRY
        return FIRST + round(float(valued @ np.arange(len(valued)) / valued.sum()))


def styling_of(store: Store, style: Style) -> Styling:
    """Look at all objects of a store, once.

    Raises
    ------
    InputError
        When no object has the field, or the style does not suit its values.
    """
    try:
        field = known_field(store, style.field)
    except InputError as error:
        subject, reason, advice = error.args
        ramps = f"; ramps are {', '.join(RAMPS)}" if ":" in style.field else ""
        raise InputError(subject, reason, advice + ramps) from None
    rows, values, parts = values_of(store, field), Values(), []
    while some := list(islice(rows, ROWS_AT_ONCE)):
        *columns, value = zip(*some, strict=True)
        values.add(value)
        parts.append([np.array(column) for column in columns])
    if not parts:
        raise InputError(store.path, "holds no buildings", "ingest some first")
    number, cell, size_m = (np.concatenate(part) for part in zip(*parts, strict=True))
    weight = np.square(size_m).astype(np.float32)
    return Styling(scale_of(style, field.name, values), number, cell, weight)

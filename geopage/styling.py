# SPDX-License-Identifier: Apache-2.0
"""A style applied to one store: an entry of the palette for each object.

A proxy gets the entry of the objects that it stands for: the commonest category, or the
mean of the ramp, each object weighted by the square of its bounding dimension.
"""

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
from tiles.kernels import kernel
from tiles.store import Store

ROWS_AT_ONCE = 20_000
ENTRIES = 256
U1 = NDArray[np.uint8]


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

    def of_objects(self, number: Ints) -> U1:
        """Return the entries of objects by their ids, (n,).

        Who came after the style was made is missing.
        """
        return self._of_id[np.minimum(number, len(self._of_id) - 1)]

    def of_children(self, cell: Ints) -> U1:
        """Return the entries that stand for all objects at or below cells' children.

        Parameters
        ----------
        cell : (n,) above the deepest level

        Returns
        -------
        entries : (n, 4) by child
        """
        children = np.asarray(cells.children(cell)).ravel()
        first = np.searchsorted(self._cell, np.asarray(cells.range_min(children)))
        last = np.searchsorted(self._cell, np.asarray(cells.range_max(children)), "right")
        own = self._entry, self._weight
        return together(first, last, *own, self._is_ramp).reshape(-1, 4)


@kernel
def together(
    first: Ints,
    last: Ints,
    entry: U1,
    weight: NDArray[np.float32],
    is_ramp: bool,  # noqa: FBT001
) -> U1:
    """Return the entry that stands for each of some ranges of objects, (r,)."""
    found = np.empty(len(first), np.uint8)
    for r in range(len(first)):
        weights = np.zeros(ENTRIES, np.float64)
        for i in range(first[r], last[r]):
            weights[entry[i]] += weight[i]
        found[r] = MISSING_ENTRY
        valued = weights[FIRST:].sum()
        if is_ramp and valued > 0.0:
            mean = (weights[FIRST:] * np.arange(ENTRIES - FIRST)).sum() / valued
            found[r] = FIRST + round(mean)
        elif not is_ramp and first[r] < last[r]:
            found[r] = weights.argmax()
    return found


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

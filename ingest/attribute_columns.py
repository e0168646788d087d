# SPDX-License-Identifier: Apache-2.0
"""Attributes that every feature names for itself, as columns."""

from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import chain
from typing import Any

from ingest.heights import USUAL_NAMES
from ingest.raw_features import Columns, objects

MAX_COLUMNS = 250
REST = "other_attributes"
"""Column of dictionaries with the attributes that few features have."""


def columns_of(properties: Sequence[dict[str, Any]]) -> Columns:
    """Return a column for each name; beyond 250 names the rarest share one column.

    Parameters
    ----------
    properties : (n,) names and values of each feature
    """
    names, rare = _names(properties)
    values: dict[str, list[Any]] = {name: [None] * len(properties) for name in names}
    for place, found in enumerate(properties):
        for name, value in found.items():
            if name in values:
                values[name][place] = value
    if rare:
        values[REST] = [_some(found, rare) for found in properties]
    return {name: objects(column) for name, column in values.items()}


def _names(properties: Iterable[dict[str, Any]]) -> tuple[list[str], set[str]]:
    counts = Counter(chain.from_iterable(properties))
    if len(counts) <= MAX_COLUMNS:
        return list(counts), set()
    common = {name for name, _ in counts.most_common(MAX_COLUMNS)}
    kept = [name for name in counts if name in common or name.lower() in USUAL_NAMES]
    return kept, counts.keys() - set(kept)


def _some(found: dict[str, Any], rare: set[str]) -> dict[str, Any] | None:
    return {name: found[name] for name in found if name in rare} or None

# SPDX-License-Identifier: Apache-2.0
"""One small world for all paging tests: as forests, and as a real store."""

from pathlib import Path

import pytest

from geopage.selection import trees_of
from geopage.tree import Tree
from tests.geopage.worlds import (
    deep_globe,
    object_records,
    wide_globe,
    write_index,
    write_store,
)
from tiles.forest import Forest, build_forest
from tiles.lanes import Lane


@pytest.fixture(scope="session")
def forests() -> dict[Lane, Forest]:
    """A globe of three levels with one deep spot, and a town there."""
    land, things = deep_globe(), object_records()
    return {Lane.TERRAIN: build_forest(land), Lane.OBJECTS: build_forest(things)}


@pytest.fixture(scope="session")
def trees(forests: dict[Lane, Forest]) -> dict[Lane, Tree]:
    """The same world's arrays."""
    return trees_of(forests)


@pytest.fixture(scope="session")
def store_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A real store of the same world, with tiles of one triangle."""
    path = tmp_path_factory.mktemp("world") / "world.geopage"
    write_store(path, deep_globe(), object_records())
    return path


@pytest.fixture(scope="session")
def wide_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store of a larger globe with a strip of detail, without tiles: to be paged dry."""
    path = tmp_path_factory.mktemp("wide") / "wide.geopage"
    write_index(path, wide_globe(), object_records())
    return path

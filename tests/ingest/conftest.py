# SPDX-License-Identifier: Apache-2.0
"""A small world of two nested rasters, made once."""

from pathlib import Path

import pytest

from tests.ingest.rasters import nested


@pytest.fixture(scope="session")
def nested_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of coarse.tif, inset.tif and world.geopage; not to be changed."""
    return nested(tmp_path_factory.getbasetemp())

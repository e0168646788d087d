# SPDX-License-Identifier: Apache-2.0
"""Heights at random places of the sources: what is right is found right, and only that."""

from pathlib import Path

import numpy as np
import pytest

from ingest.terrain import ingest_rasters
from tests.ingest.rasters import EGM96, coarse, own_surface_m
from tiles.post_tree import build_tree
from tiles.source_posts import read_rasters, terrain_sources
from tiles.store import Store
from tiles.surface import Surface
from viewer.random_heights import PLACES, places_in, random_heights

RAISED_M = 200.0


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Posts 2 km apart; the earth bends away from their triangles by less than 0.2 m."""
    folder = tmp_path_factory.mktemp("heights")
    file = coarse(folder / "coarse.tif")
    ingest_rasters(folder / "world.geopage", [(file, EGM96)], workers=1)
    return folder / "world.geopage"


def test_differences_are_those_from_the_file_itself(store: Path) -> None:
    with Store(store) as opened:
        surface, tree = Surface(opened), build_tree(read_rasters(opened))
        (found,) = random_heights(surface, tree, opened, 3)
        (source,) = terrain_sources(opened)
        lon, lat = places_in(source, np.random.default_rng(3))
        height_m, _ = surface.heights(lon, lat)
    file = store.parent / "coarse.tif"
    own_m = own_surface_m(file, np.degrees(lon), np.degrees(lat), egm96=True)
    gap_m = np.abs(height_m - own_m)[np.isfinite(own_m)]
    assert found["places"] == PLACES
    assert found["share_within"] == 1.0
    assert found["p50_m"] == pytest.approx(np.median(gap_m), abs=0.2)
    assert found["max_m"] == pytest.approx(gap_m.max(), rel=0.1)
    assert 0.2 < found["share_of_bound"] <= 1.0


def test_a_surface_that_is_off_is_found(store: Path) -> None:
    with Store(store) as opened:
        rasters = read_rasters(opened)
        raised = rasters._replace(height_m=rasters.height_m + np.float32(RAISED_M))
        (found,) = random_heights(Surface(opened), build_tree(raised), opened, 3)
    assert found["share_within"] == 0.0
    assert found["p50_m"] == pytest.approx(RAISED_M, rel=0.1)

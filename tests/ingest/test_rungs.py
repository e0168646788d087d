# SPDX-License-Identifier: Apache-2.0
"""The coarser meshes of a leaf of real mountains."""

from pathlib import Path

import numpy as np

from ingest.rungs import laddered
from ingest.terrain_tile import LEAF_SIDE, inner_bound_m
from ingest.truth import places_of, truth_of
from tests.ingest.rasters import EGM96, leaf_at, mosaic_of
from tiles.samples import SAMPLES

MOUNTAINS_DEG = 85.5, 28.2
BOUND_M = 0.5


def test_rungs_of_mountains_each_have_about_half_the_triangles_of_the_finer_one(
    tmp_path: Path,
) -> None:
    source = SAMPLES / "langtang.tif"
    mosaic, connection = mosaic_of(tmp_path / "a.geopage", [(source, EGM96)])
    cell = leaf_at(*MOUNTAINS_DEG, mosaic.layers[0].spacing_m, LEAF_SIDE)
    truth = truth_of(mosaic, cell, LEAF_SIDE)
    connection.close()
    whole, error_m, rungs = laddered(cell, places_of(truth), BOUND_M, [truth])
    surfaces = [whole, *(rung.surface for rung in rungs)]
    errors_m = np.array(
        [error_m, *(rung.error_m for rung in rungs), 2 * inner_bound_m(cell)]
    )
    counts = np.array([len(one.triangles) for one in surfaces])
    # Else a view draws several times what it needs: between the leaf and its parent lies
    # a factor of 20, and the least that it draws is the coarsest rung.
    assert len(rungs) == 3
    assert (errors_m[2:] / errors_m[1:-1] < 2.3).all()
    assert (counts[1:] < 0.6 * counts[:-1]).all()
    assert counts[-1] < 0.1 * counts[0]

# SPDX-License-Identifier: Apache-2.0
"""Ground that is nothing but cliffs: inner cells keep their bound, or nearly."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from ingest.terrain import ingest_rasters
from tests.ingest.rasters import ELLIPSOID, Floats, ecef, north_up, post_places_deg, write
from tiles import cells, terrain
from tiles.check import ROUNDING, bounds_m
from tiles.lanes import Lane
from tiles.store import Store

STEP = 0.01
Posts = Callable[[], Floats]


def checker() -> Floats:
    """Every other post stands on a tower: no vertex can be left out."""
    return (np.indices((56, 56)).sum(axis=0) % 2) * 3000.0


def spikes() -> Floats:
    """Mountains of one post."""
    posts, rng = np.zeros((70, 70)), np.random.default_rng(5)
    posts[tuple(rng.integers(2, 68, (2, 14)))] = 6000.0
    return posts


def mesa() -> Floats:
    """Few triangles, but with a cliff all around: at the raster's rim is the sea."""
    return np.full((50, 50), 5000.0)


@pytest.mark.parametrize(("posts", "most"), [(checker, 1.25), (spikes, 1), (mesa, 1)])
def test_cells_on_cliffs_keep_their_bound(
    posts: Posts, most: float, tmp_path: Path
) -> None:
    """Shortest distances of posts from the triangles as they are stored, by trimesh."""
    where = north_up(10.0, 50.0, STEP)
    file = write(tmp_path / "a.tif", posts().astype(np.float32), where, "EPSG:4326")
    ingest_rasters(tmp_path / "a.geopage", [(file, ELLIPSOID)], workers=1)
    lon, lat = post_places_deg(file)
    points = ecef(lon.ravel(), lat.ravel(), posts().ravel())
    with Store(tmp_path / "a.geopage") as store:
        index = store.index(Lane.TERRAIN)
        share = index["error_m"] / bounds_m(index)
        assert share.max() <= most * (1 + ROUNDING)
        inner = index[(index["children"] > 0) & (cells.level(index["cell"]) > 3)]
        assert len(inner) > 1
        for record in inner:
            tile = terrain.decode(
                store.checked_body(
                    Lane.TERRAIN,
                    int(record["cell"]),
                    int(record["row"]),
                    int(record["check"]),
                )
            )
            west, south, east, north = np.degrees(cells.bounds_rad(record["cell"]))
            mine = (lon > west) & (lon < east) & (lat > south) & (lat < north)
            mesh = trimesh.Trimesh(tile.mesh.local, tile.surface(), process=False)
            some = points[mine.ravel()][:: max(1, int(mine.sum()) // 200)]
            places = some - tile.mesh.centre
            far_m = trimesh.proximity.closest_point_naive(mesh, places)[1]
            assert far_m.max(initial=0.0) <= record["error_m"]

# SPDX-License-Identifier: Apache-2.0
"""Posts in ECEF, against pyproj."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.tiles.posts import GEO, UTM, ecef_posts, hills, source, tree_of
from tiles.post_chunks import SIDE, load, new_room, squares
from tiles.post_tree import HIGH, LOW, RADIUS, PostTree
from tiles.source_posts import STEP

POLAR = "EPSG:3413"


def all_posts(tree: PostTree, one: int = 0) -> np.ndarray[Any, Any]:
    """Put all chunks of a source together."""
    high, wide = squares(tree.rasters, one)
    out = np.full((high + 1, wide + 1, 3), np.nan)
    room = new_room()
    for row in range(-(-high // SIDE)):
        for col in range(-(-wide // SIDE)):
            h, w = load(tree.rasters, one, row, col, (0.0, 0.0, 0.0), room)
            top, left = row * SIDE, col * SIDE
            out[top : top + h + 1, left : left + w + 1] = room[: h + 1, : w + 1, :3]
    return out


CASES = {
    "longitude and latitude": (source(hills(40, 51)), 0),
    "south up": (source(hills(20, 30), (0.01, 0, 10.0, 0, 0.01, 45.0)), 0),
    "rotated": (source(hills(50, 60), (0.005, 0.001, 10, 0.001, -0.005, 45), GEO), 16),
    "UTM, 30 m": (source(hills(300, 270), (30, 0, 5e5, 0, -30, 5e6), UTM, 30.0), 64),
    "UTM, 4 km": (source(hills(30, 20), (4e3, 0, 4e5, 0, -4e3, 5e6), UTM, 4e3), 1),
    "over the pole": (
        source(hills(120, 130), (500, 0, -3e4, 0, -500, 3e4), POLAR, 500.0),
        32,
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_posts_are_where_pyproj_puts_them(name: str, tmp_path: Path) -> None:
    one, step = CASES[name]
    tree = tree_of(tmp_path, one)
    assert tree.rasters.shape[0, STEP] == step
    assert np.abs(all_posts(tree) - ecef_posts(one)).max() < 1e-4


def test_a_globe_closes_at_the_antimeridian_and_at_both_poles(tmp_path: Path) -> None:
    heights = np.arange(8 * 12.0).reshape(8, 12)
    one = source(heights, (30, 0, -180, 0, -22.5, 90), spacing_m=3e6)
    posts = all_posts(tree_of(tmp_path, one))
    assert posts.shape == (10, 13, 3)
    assert np.array_equal(posts[:, 0], posts[:, -1])
    assert np.abs(posts[1:-1, :-1] - ecef_posts(one)).max() < 1e-6
    for row, beside in ((0, heights[0]), (-1, heights[-1])):
        assert np.ptp(posts[row], axis=0).max() < 1e-9
        pole = 6356752.314245 + beside.mean()
        assert abs(posts[row, 0, 2]) == pytest.approx(pole, abs=1e-6)


def test_no_data_takes_part_in_no_ball(tmp_path: Path) -> None:
    heights = hills(33, 33)
    heights[:, 16:] = np.nan
    heights[0, 0] = 9000.0
    heights[0, 1] = heights[1, 1] = np.nan
    tree = tree_of(tmp_path, source(heights))
    rows, cols = tree.level[0, 0, 1:]
    radius = tree.node[: rows * cols, RADIUS].reshape(rows, cols)
    assert (radius[:, 2:] < 0).all()
    assert (radius[:, :2] > 0).all()
    assert tree.node[:, HIGH].max() < 9000.0  # that post is the corner of no triangle


def test_every_node_holds_the_posts_below_it(tmp_path: Path) -> None:
    one = source(hills(70, 45))
    tree, points = tree_of(tmp_path, one), ecef_posts(one)
    for level in range(int(tree.top[0]) + 1):
        first, rows, cols = tree.level[0, level]
        side = SIDE << level
        for row in range(rows):
            for col in range(cols):
                node = tree.node[first + row * cols + col]
                part = np.s_[
                    row * side : (row + 1) * side + 1, col * side : (col + 1) * side + 1
                ]
                away = np.linalg.norm(points[part] - node[:3], axis=-1)
                assert away.max() <= node[RADIUS]
                assert one["posts"][part].max() <= node[HIGH]
                assert one["posts"][part].min() >= node[LOW]
    assert rows == cols == 1


def test_a_raster_of_one_row_has_no_surface(tmp_path: Path) -> None:
    tree = tree_of(tmp_path, source(hills(1, 9)), source(hills(20, 20)))
    assert sorted(tree.top.tolist()) == [-1, 2]

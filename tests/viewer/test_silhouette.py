# SPDX-License-Identifier: Apache-2.0
"""Edges of made-up depth pictures that were moved by known distances."""

import numpy as np

from viewer.silhouette import FARTHEST_PX, silhouette

NEAR, FAR = 100.0, 5000.0
NOTHING = np.zeros((40, 60), bool)
ALLOWED = np.full((40, 60), 1.0)


def edge(at: int, behind: float) -> np.ndarray:
    picture = np.full((40, 60), behind)
    picture[:, :at] = NEAR
    return picture


def test_an_edge_that_moved_is_found_with_its_distance() -> None:
    for behind in (FAR, np.inf):
        for by in (4, 9):
            found = silhouette(edge(20 + by, behind), edge(20, behind), NOTHING, ALLOWED)
            assert found.moved_px.max() == by
            # All of the strip between, but for the rows at the picture's edges.
            assert len(found.moved_px) == 38 * by
            assert len(found.beyond_px) > 0


def test_an_edge_that_moved_by_a_pixel_is_the_same() -> None:
    for behind in (FAR, np.inf):
        found = silhouette(edge(21, behind), edge(20, behind), NOTHING, ALLOWED)
        assert not len(found.moved_px)
        assert found.compared == 40 * (60 if behind == FAR else 21)


def test_what_the_error_allows_is_not_beyond() -> None:
    found = silhouette(edge(24, FAR), edge(20, FAR), NOTHING, np.full((40, 60), 3.0))
    assert len(found.moved_px) > 0
    assert not len(found.beyond_px)


def test_what_is_not_there_at_all_is_as_far_as_can_be() -> None:
    shown = np.full((40, 60), np.inf)
    shown[20, 30] = NEAR
    found = silhouette(shown, np.full((40, 60), np.inf), NOTHING, ALLOWED)
    assert found.compared == 1
    assert found.moved_px.tolist() == [FARTHEST_PX]


def test_pixels_that_are_not_known_are_not_compared() -> None:
    blind = NOTHING.copy()
    blind[:, 18:30] = True
    found = silhouette(edge(24, FAR), edge(20, FAR), blind, ALLOWED)
    assert not len(found.moved_px)
    assert found.compared == 40 * 48


def test_a_slope_that_is_seen_at_a_low_angle_is_no_silhouette() -> None:
    row = np.arange(40)[:, None] + np.zeros((40, 60))
    slope, moved = 100 * 1.3**row, 100 * 1.3 ** (row + 0.9)
    assert not len(silhouette(slope, moved, NOTHING, ALLOWED).moved_px)

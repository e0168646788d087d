# SPDX-License-Identifier: Apache-2.0
"""A source's rim is every edge of its triangles that is not between two of them."""

from collections import Counter

import numpy as np
import pytest

from ingest.rim_lines import LONE, halved, rim_edges, rim_lines
from tests.ingest.rasters import Floats, north_up
from tests.ingest.test_layer import (
    Opener,
    opened,  # noqa: F401  (a fixture)
)

Edge = tuple[tuple[int, int], tuple[int, int]]


def rim_by_hand(known: np.ndarray) -> set[Edge]:
    """Return edges, (column, row) twice, that fewer than two whole triangles share."""
    height, width = known.shape
    shares: Counter[Edge] = Counter()
    posts = {(c, r) for r in range(height) for c in range(width) if known[r, c]}
    for c, r in posts:
        for corner in ((c + 1, r), (c, r + 1)):
            far = (c + 1, r + 1)
            if corner in posts and far in posts:
                shares[(c, r), corner] += 1
                shares[corner, far] += 1
                shares[(c, r), far] += 1
    steps = ((1, 0), (0, 1), (1, 1))
    edges = {((c, r), (c + x, r + y)) for c, r in posts for x, y in steps}
    edges = {edge for edge in edges if edge[1] in posts}
    touched = {post for edge in edges for post in edge}
    return {e for e in edges if shares[e] < 2} | {(p, p) for p in posts - touched}


@pytest.mark.parametrize("share", [0.05, 0.5, 0.95, 1.0])
def test_the_rim_is_found_whole(
    opened: Opener,  # noqa: F811
    share: float,
    rng: np.random.Generator,
) -> None:
    known = rng.random((33, 47)) < share
    posts = np.where(known, np.arange(33 * 47).reshape(33, 47), -9999).astype(np.float32)
    layer = opened(posts, north_up(11, 46, 0.01), "EPSG:4326", nodata=-9999)
    found = set()
    for at, height in rim_edges(layer):
        for ends, ends_m in zip(at, height, strict=True):
            whole = np.rint(ends + (LONE * 1e-3)).astype(int)
            a, b = (tuple(int(v) for v in one) for one in whole)
            found.add((a, b))
            assert ends_m.tolist() == [posts[a[1], a[0]], posts[b[1], b[0]]]
    assert found == rim_by_hand(known)


def test_parts_of_a_large_raster_fit_together(opened: Opener) -> None:  # noqa: F811
    posts = np.zeros((520, 2100), np.float32)
    posts[255:257, 2047:2049] = np.nan
    layer = opened(posts, north_up(11, 46, 0.001), "EPSG:4326")
    count = sum(len(at) for at, _ in rim_edges(layer))
    around_hole = 10
    assert count == 2 * (519 + 2099) + around_hole


def test_a_raster_round_the_globe_has_no_rim(opened: Opener) -> None:  # noqa: F811
    layer = opened(np.zeros((18, 36), np.float32), north_up(-180, 90, 10), "EPSG:4326")
    assert not list(rim_edges(layer))


def test_lines_are_halved_where_the_coarser_surface_has_a_fold(
    opened: Opener,  # noqa: F811
    rng: np.random.Generator,
) -> None:
    layer = opened(np.zeros((30, 30), np.float32), north_up(11, 46, 0.01), "EPSG:4326")

    def roof(lon_rad: Floats, lat_rad: Floats) -> Floats:
        del lat_rad
        return 50.0 * np.abs(np.degrees(lon_rad) - 11.1234) / 0.01

    edges, height = next(iter(rim_edges(layer)))
    at, delta = halved(layer, roof, edges, height)
    assert len(edges) < len(at) < len(edges) + 2 * 7
    # Along every line the delta is now linear to a few centimetres.
    t = rng.uniform(0, 1, len(at))
    place = at[:, 0] + t[:, None] * (at[:, 1] - at[:, 0])
    linear = delta[:, 0] + t * (delta[:, 1] - delta[:, 0])
    np.testing.assert_allclose(linear, -roof(*layer.places(*place.T)), atol=0.2)


def test_an_endless_rim_is_thinned(opened: Opener) -> None:  # noqa: F811
    posts = np.where(np.indices((200, 200)).sum(axis=0) % 3, 5.0, np.nan)
    layer = opened(posts.astype(np.float32), north_up(11, 46, 0.001), "EPSG:4326")
    flat = lambda lon, lat: np.zeros(len(lon))  # noqa: E731
    ends, _ = rim_lines(layer, flat)
    fewer, delta = rim_lines(layer, flat, most=len(ends) // 3)
    assert len(ends) // 8 < len(fewer) <= len(ends) // 3
    assert len(delta) == len(fewer)

# SPDX-License-Identifier: Apache-2.0
"""A source's rim is every edge of its triangles that is not between two of them."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from ingest.cli_report import about
from ingest.rim import Rim
from ingest.rim_lines import LONE, halved, missed_m, rim_edges, rim_lines
from tests.ingest.rasters import EGM96, Floats, coarse, hills, inset, mosaic_of, north_up
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


def test_what_the_thinning_of_an_endless_rim_costs_is_known(
    opened: Opener,  # noqa: F811
) -> None:
    """As far as the bent surface ends from the source at 99 of 100 edges' middles."""
    posts = np.where(
        np.indices((200, 200)).sum(axis=0) % 3, hills((200, 200), 1, 50), np.nan
    )
    layer = opened(posts.astype(np.float32), north_up(11, 46, 0.001), "EPSG:4326")
    flat = lambda lon, lat: np.zeros(len(lon))  # noqa: E731
    parts = [(layer, None)]
    ends, delta, stride = rim_lines(parts, flat)
    assert stride == 1
    rim = Rim.of(ends, delta, 1000.0, 100.0)
    assert missed_m(rim, parts, flat) < 1e-3
    fewer, delta, stride = rim_lines(parts, flat, most=len(ends) // 3)
    assert stride == 4
    assert len(delta) == len(fewer)
    assert len(ends) // 8 < len(fewer) <= len(ends) // 3
    rim = Rim.of(fewer, delta, 1000.0, 100.0)
    off = [
        np.abs(rim.deltas(*layer.places(*at.mean(axis=1).T))[0] - height.mean(axis=1))
        for at, height in rim_edges(layer)
    ]
    truth_m = np.percentile(np.concatenate(off), 99)
    assert truth_m > 1.0
    assert missed_m(rim, parts, flat) == pytest.approx(truth_m, rel=0.25)


def test_of_many_sources_none_is_thinned_before_all_are_too_long(
    opened: Opener,  # noqa: F811
) -> None:
    """A ragged one may take what smooth ones leave."""
    flat = lambda lon, lat: np.zeros(len(lon))  # noqa: E731
    ragged = np.where(np.indices((60, 60)).sum(axis=0) % 3, 5.0, np.nan)
    layer = opened(ragged.astype(np.float32), north_up(11, 46, 0.001), "EPSG:4326")
    none = lambda lon, lat: np.zeros(len(lon), np.bool_)  # noqa: E731
    whole, _, _ = rim_lines([(layer, None)], flat)
    parts = [(layer, None), *[(layer, none)] * 9]
    together, _, stride = rim_lines(parts, flat, most=len(whole))
    assert stride == 1
    assert len(together) == len(whole)


def test_a_thinned_rim_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    files = [(coarse(tmp_path / "a.tif"), EGM96), (inset(tmp_path / "b.tif"), EGM96)]
    missed = []
    for most in (1000, 40):
        monkeypatch.setattr(rim_lines, "__defaults__", (most,))
        mosaic, connection = mosaic_of(tmp_path / f"{most}.geopage", files)
        connection.close()
        missed.append([mosaic.missed_m(layer) for layer in mosaic.layers])
    assert missed[0] == [0.0, 0.0]
    assert missed[1][0] > 1.0
    assert missed[1][1] > 1.0
    source = {"name": "b", "bounds_deg": (11, 46, 12, 47), "spacing_m": 200.0}
    source |= {"skipped": {}, "reach_m": 2000.0, "meets": "a", "missed_m": missed[1][1]}
    assert f"is missed by over {missed[1][1]:.2g} m" in about(source)
    assert "missed" not in about({**source, "missed_m": 0.0})

# SPDX-License-Identifier: Apache-2.0
"""What a lattice misses of a surface that is bent along lines is found."""

import numpy as np
import pytest

from ingest.lattice_gap import bends, missed_between
from ingest.sampling import triangulated
from tests.ingest.rasters import Floats

SIDE = 48


def between(posts: Floats, x: Floats, y: Floats) -> Floats:
    """Read posts' triangles; columns and rows, with the diagonal of the sources."""
    found = triangulated(posts.astype(np.float32), np.ravel(x), np.ravel(y))
    return found.reshape(np.shape(x))


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("posts", [3, 7, 20])
def test_no_place_is_further_off_than_is_said(posts: int, seed: int) -> None:
    """A million places, against the coarse posts' own triangles."""
    rng = np.random.default_rng(seed)
    coarse = rng.normal(0.0, 100.0, (posts + 3, posts + 3)).astype(np.float32)
    shift = rng.uniform(0.0, 1.0, 2)

    def surface(lon: Floats, lat: Floats) -> Floats:
        return between(coarse, shift[0] + posts * lon, shift[1] + posts * lat)

    lon, lat = np.meshgrid(*[np.linspace(0.0, 1.0, SIDE + 1)] * 2)
    heights = surface(lon, lat)
    u, v = rng.uniform(size=(2, 1_000_000))
    gap_m = np.abs(surface(u, v) - between(heights, SIDE * u, SIDE * v)).max()
    said_m = missed_between(surface, lon, lat, heights)
    assert gap_m <= said_m + 1e-3
    assert said_m <= 1.3 * gap_m


def test_a_lattice_of_its_own_posts_misses_nothing(rng: np.random.Generator) -> None:
    heights = rng.normal(0.0, 100.0, (SIDE + 1, SIDE + 1)).astype(np.float32)

    def surface(lon: Floats, lat: Floats) -> Floats:
        return between(heights, lon, lat)

    lon, lat = np.meshgrid(*[np.arange(SIDE + 1.0)] * 2)
    assert missed_between(surface, lon, lat, np.float64(heights)) < 1e-3


@pytest.mark.parametrize("share", [0.25, 0.5, 0.9])
def test_one_bend_lifts_an_edge_by_what_the_samples_beside_it_say(share: float) -> None:
    """A roof with its ridge between two columns of a lattice, and 7 m steeper there."""
    ridge = 10 + share
    x = np.tile(np.arange(SIDE + 1.0), (SIDE + 1, 1))
    found = bends(-7.0 * np.abs(x - ridge) / 2)
    lost_m = 7.0 * share * (1 - share)
    assert found[5:-5, 10] == pytest.approx(np.full(SIDE - 10, lost_m))

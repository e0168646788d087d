# SPDX-License-Identifier: Apache-2.0
"""The delta surface meets the whole rim, has no steps, and costs little."""

import pickle
from pathlib import Path

import numpy as np
import pytest

from ingest.rim import Rim
from ingest.rim_kernels import REACH
from tests.ingest.rasters import Floats
from tiles.geodesy import to_ecef

LON, LAT = np.radians(11.0), np.radians(46.0)
METRE = 1 / 6.37e6
"""One metre northwards, radians"""


def places(east_m: Floats, north_m: Floats) -> tuple[Floats, Floats]:
    return LON + east_m * METRE / np.cos(LAT), LAT + north_m * METRE


def ecef(east_m: Floats, north_m: Floats) -> Floats:
    return np.asarray(to_ecef(*places(east_m, north_m), 0.0))


def rim_of(ends_m: Floats, delta_m: Floats, feather_m: float = 5000.0) -> Rim:
    """Build a rim of lines, (n, 2, 2) east and north, m."""
    ends = ecef(ends_m[..., 0], ends_m[..., 1])
    return Rim.of(ends, delta_m.astype(np.float32), feather_m, 30.0)


@pytest.fixture
def scattered(rng: np.random.Generator) -> tuple[Floats, Floats]:
    """3,000 short lines on both banks of a winding river, deltas that jump about."""
    along = np.linspace(0, 30_000, 1501)
    wind = 800 * np.sin(along / 900) + rng.normal(size=1501) * 20
    bank = [np.stack([along, wind + off], axis=1) for off in (-400.0, 400.0)]
    ends = np.concatenate([np.stack([b[:-1], b[1:]], axis=1) for b in bank])
    height = rng.normal(size=(2, 1501)) * 50
    deltas = np.concatenate([np.stack([h[:-1], h[1:]], axis=1) for h in height])
    return ends, deltas


def test_the_distance_is_that_of_the_nearest_line(
    scattered: tuple[Floats, Floats], rng: np.random.Generator
) -> None:
    ends, deltas = scattered
    rim = rim_of(ends, deltas)
    east, north = rng.uniform(-4000, 34_000, 300), rng.uniform(-4000, 4000, 300)
    found = rim.deltas(*places(east, north))[1]
    place = ecef(east, north)[:, None]
    a, b = np.moveaxis(ecef(ends[..., 0], ends[..., 1]), 1, 0)
    t = np.clip(((place - a) * (b - a)).sum(-1) / ((b - a) ** 2).sum(-1), 0, 1)
    away = np.linalg.norm(place - a - t[..., None] * (b - a), axis=-1).min(axis=1)
    np.testing.assert_allclose(found, np.minimum(away, 5000), atol=2e-3)


def test_the_delta_is_the_integral_along_the_lines(rng: np.random.Generator) -> None:
    """Against lines cut into 4,000 points each."""
    ends = rng.uniform(-500, 500, (6, 2, 2))
    deltas = rng.normal(size=(6, 2)) * 100
    rim = rim_of(ends, deltas)
    east, north = rng.uniform(-200, 200, 40), rng.uniform(-200, 200, 40)
    found, near = rim.deltas(*places(east, north))
    t = (np.arange(4000) + 0.5) / 4000
    points = ends[:, :1] + t[None, :, None] * (ends[:, 1:] - ends[:, :1])
    delta = deltas[:, :1] + t * (deltas[:, 1:] - deltas[:, :1])
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)[:, None] / 4000
    for k in range(40):
        away = np.linalg.norm(points - (east[k], north[k]), axis=2)
        line = 1 - (away.min(axis=1, keepdims=True) / (REACH * near[k])) ** 2
        weight = np.maximum(line, 0) ** 2 * length / away**3
        assert found[k] == pytest.approx((weight * delta).sum() / weight.sum(), abs=0.5)


def test_the_rim_itself_is_met_between_posts_too(
    scattered: tuple[Floats, Floats], rng: np.random.Generator
) -> None:
    ends, deltas = scattered
    rim = rim_of(ends, deltas)
    line, t = rng.integers(0, len(ends), 2000), rng.uniform(0, 1, 2000)
    place = ends[line, 0] + t[:, None] * (ends[line, 1] - ends[line, 0])
    wanted = deltas[line, 0] + t * (deltas[line, 1] - deltas[line, 0])
    found, near = rim.deltas(*places(place[:, 0], place[:, 1] + 0.001))
    assert near.max() < 0.02
    np.testing.assert_allclose(found, wanted, atol=0.15)


def test_the_delta_has_no_steps(scattered: tuple[Floats, Floats]) -> None:
    """Where a surface has no steps, half the stride is half the largest change."""
    rim = rim_of(*scattered)
    largest = []
    for stride_m in (2.0, 1.0, 0.5):
        north = np.arange(450.0, 4500.0, stride_m)
        walks = [
            rim.deltas(*places(np.full(len(north), east), north))[0]
            for east in (3333.0, 15_001.0, 22_222.2)
        ]
        largest.append(max(np.abs(np.diff(walk[walk != 0])).max() for walk in walks))
    assert largest[1] < 0.6 * largest[0]
    assert largest[2] < 0.6 * largest[1]


def test_one_delta_all_round_is_that_delta_everywhere(
    scattered: tuple[Floats, Floats], rng: np.random.Generator
) -> None:
    ends, _ = scattered
    rim = rim_of(ends, np.full((len(ends), 2), 12.5))
    found, near = rim.deltas(*places(rng.uniform(0, 3e4, 500), rng.uniform(-8e3, 8e3, 500)))
    assert (near < 5000).sum() > 300
    np.testing.assert_allclose(found, np.where(near < 5000, 12.5, 0.0), rtol=1e-9)


def test_worker_processes_share_a_rim_and_leave_no_file(
    scattered: tuple[Floats, Floats],
) -> None:
    rim = rim_of(*scattered)
    sent = pickle.dumps(rim)
    assert len(sent) < 1000
    there = pickle.loads(sent)
    north = np.linspace(-3000, 3000, 100)
    where = places(np.full(100, 9000.0), north)
    np.testing.assert_array_equal(there.deltas(*where), rim.deltas(*where))
    folder = Path(rim.__reduce__()[1][2])
    assert folder.is_dir()
    del rim, there
    assert not folder.exists()


def test_over_the_sea_a_coast_slopes_down_at_once() -> None:
    """A coast 30 m high: the sea bed stays below the sea some 100 m from it."""
    posts = np.stack([np.arange(-9000.0, 9001.0, 100.0), np.zeros(181)], axis=1)
    shore = np.stack([posts[:-1], posts[1:]], axis=1)
    rim = rim_of(shore, np.full((180, 2), 50.0))
    north = np.array([0.001, 10.0, 45.0, 95.0, 1000.0, 4999.0])
    lon, lat = places(np.zeros(6), north)
    bed, sea = np.full(6, -20.0), np.zeros(6)
    found, _ = rim.bent(bed, sea, lon, lat)
    assert found[0] == pytest.approx(30, abs=0.01)
    assert (np.diff(found) <= 0).all()
    assert found[2] > 5
    assert (found[3:] <= 0).all()
    inland, _ = rim.bent(bed + 100, sea, lon, lat)
    assert inland[3] == pytest.approx(130, abs=0.2)

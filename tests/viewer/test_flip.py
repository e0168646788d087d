# SPDX-License-Identifier: Apache-2.0
"""FLIP: hand-made facts, and what its authors' own program says of the same pictures."""

import numpy as np
import pytest
from numpy.typing import NDArray

from viewer.flip import F4, TO_XYZ, compare, prepare

Rgb = NDArray[np.uint8]
SHAPE = (40, 60, 3)


def flip(reference: Rgb, shown: Rgb) -> F4:
    """Return the difference of two pictures, (h, w, 3) sRGB, pixel by pixel."""
    return compare(prepare(reference), prepare(shown))


def plain(*rgb: int) -> Rgb:
    return np.full(SHAPE, rgb, np.uint8)


def step(at: int) -> Rgb:
    picture = np.full((60, 80, 3), 51, np.uint8)
    picture[:, at:] = 178
    return picture


@pytest.fixture
def blocks() -> Rgb:
    values = np.random.default_rng(3).integers(0, 256, (5, 8, 3)).astype(np.uint8)
    return values.repeat(8, 0).repeat(8, 1)


def test_a_picture_does_not_differ_from_itself(blocks: Rgb) -> None:
    assert (flip(blocks, blocks) == 0).all()


def test_black_and_white_differ_nearly_as_much_as_can_be() -> None:
    found = flip(plain(0, 0, 0), plain(255, 255, 255))
    assert np.ptp(found) < 1e-6
    assert 0.95 < found.mean() < 1.0


def test_green_and_blue_are_the_colours_farthest_apart() -> None:
    found = flip(plain(0, 255, 0), plain(0, 0, 255))
    assert found.mean() == pytest.approx(1.0, abs=1e-5)


def test_it_does_not_matter_which_picture_is_the_reference(blocks: Rgb) -> None:
    other = np.roll(blocks, 3, axis=1)
    assert np.array_equal(flip(blocks, other), flip(other, blocks))


def test_a_larger_change_counts_more() -> None:
    found = [
        flip(plain(128, 128, 128), plain(g, g, g)).mean() for g in (130, 140, 180, 250)
    ]
    assert found == sorted(found)
    assert found[0] > 0


def test_a_moved_edge_is_seen_at_the_edge_alone() -> None:
    found = flip(step(40), step(41))
    assert found[:, 40].min() > 0.3
    # Beyond the filters' reach of 10 pixels nothing has changed.
    assert found[:, :25].max() == 0
    assert found[:, 56:].max() == 0


def test_fine_noise_is_seen_less_than_a_change_as_large_all_over() -> None:
    signs = np.indices(SHAPE).sum(axis=0) % 2 * 2 - 1
    noisy = (128 + 20 * signs).astype(np.uint8)
    brighter = plain(148, 148, 148)
    grey = plain(128, 128, 128)
    assert flip(grey, noisy).mean() < 0.5 * flip(grey, brighter).mean()


@pytest.mark.parametrize(
    ("a", "b", "mean", "largest"),
    [
        (plain(0, 0, 0), plain(255, 255, 255), 0.96738833, 0.96738833),
        (step(40), step(41), 0.024411086, 0.53517663),
        (plain(0, 255, 0), plain(255, 0, 0), 0.98666483, 0.98666495),
    ],
)
def test_the_authors_own_program_says_the_same(
    a: Rgb, b: Rgb, mean: float, largest: float
) -> None:
    # flip-evaluator 1.7, `evaluate(a, b, "LDR", applyMagma=False)`.
    found = flip(a, b)
    assert found.mean() == pytest.approx(mean, abs=1e-4)
    assert found.max() == pytest.approx(largest, abs=1e-4)


def test_the_authors_own_program_says_the_same_of_many_colours(blocks: Rgb) -> None:
    found = flip(blocks, np.roll(blocks, 3, axis=1))
    assert found.mean() == pytest.approx(0.54820764, abs=1e-4)
    assert found.max() == pytest.approx(0.9856965, abs=1e-4)


def test_the_matrix_is_that_of_srgb() -> None:
    # IEC 61966-2-1
    standard = [
        [0.4124, 0.3576, 0.1805],
        [0.2126, 0.7152, 0.0722],
        [0.0193, 0.1192, 0.9505],
    ]
    assert np.allclose(TO_XYZ, standard, atol=2e-4)

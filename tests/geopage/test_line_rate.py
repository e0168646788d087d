# SPDX-License-Identifier: Apache-2.0
import math

import pytest

from geopage.line_rate import MEMORY_BYTES, LineRate


def test_a_rate_is_unlimited_until_something_took_time() -> None:
    rate = LineRate()
    assert math.isinf(rate.bytes_per_s)
    rate.timed(1000, 1.0, 1.0)
    assert math.isinf(rate.bytes_per_s)


def test_what_comes_side_by_side_shares_the_time() -> None:
    rate = LineRate()
    for i in range(10):
        rate.timed(500, float(i), i + 2.0)
    assert rate.bytes_per_s == pytest.approx(5000 / 11, rel=0.01)


def test_waiting_for_nothing_does_not_count() -> None:
    rate = LineRate()
    rate.timed(500, 0.0, 1.0)
    rate.timed(500, 100.0, 101.0)
    assert rate.bytes_per_s == pytest.approx(500)


def test_the_newest_counts_most() -> None:
    rate = LineRate()
    size = int(MEMORY_BYTES / 10)
    for i in range(50):
        rate.timed(size, float(i), i + 1.0)
    for i in range(50, 100):
        rate.timed(size, float(i), i + 0.5)
    assert rate.bytes_per_s == pytest.approx(2 * size, rel=0.02)

# SPDX-License-Identifier: Apache-2.0
import math
from datetime import UTC, datetime, timedelta, timezone

import numpy as np
import pytest

from viewer.sun import sun_direction


def overhead_deg(utc: datetime) -> tuple[float, float]:
    """Longitude and declination of the sun."""
    x, y, z = sun_direction(utc)
    return math.degrees(math.atan2(y, x)), math.degrees(math.asin(z))


def test_the_sun_is_where_meeus_computes_it() -> None:
    """Astronomical Algorithms, 2nd edition, examples 25.a, 25.b and 28.a."""
    lon, declination = overhead_deg(datetime(1992, 10, 13, tzinfo=UTC))
    assert declination == pytest.approx(-7.78507, abs=0.02)
    assert lon == pytest.approx(180 - 3.427351, abs=0.02)  # less the equation of time


@pytest.mark.parametrize(
    ("utc", "declination"),
    [
        (datetime(2024, 3, 20, 3, 6, tzinfo=UTC), 0.0),
        (datetime(2024, 6, 20, 20, 51, tzinfo=UTC), 23.44),
        (datetime(2024, 9, 22, 12, 44, tzinfo=UTC), 0.0),
        (datetime(2024, 12, 21, 9, 21, tzinfo=UTC), -23.44),
    ],
)
def test_seasons_begin_when_almanacs_say(utc: datetime, declination: float) -> None:
    assert overhead_deg(utc)[1] == pytest.approx(declination, abs=0.01)


def test_the_direction_is_a_unit_vector_and_knows_time_zones() -> None:
    east = timezone(timedelta(hours=8))
    here = sun_direction(datetime(2026, 5, 4, 3, 2, 1, tzinfo=UTC))
    assert np.linalg.norm(here) == pytest.approx(1.0)
    assert np.allclose(here, sun_direction(datetime(2026, 5, 4, 11, 2, 1, tzinfo=east)))

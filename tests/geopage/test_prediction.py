# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geopage.motion import rotation_of, rotation_vector, row_under
from geopage.prediction import LEAST_HEIGHT_M, ground_under, motion_of, predict
from geopage.view import ViewState
from tests.geopage.worlds import SPOT, view_at
from tiles import cells, geodesy
from tiles.forest import Forest
from tiles.frames import Ecef
from tiles.lanes import Lane

TIMES = np.arange(0, 0.3, 1 / 60)


def test_a_fly_in_goes_on_by_the_same_factor() -> None:
    heights = 1e5 * np.exp(-0.46 * TIMES)
    views = [view_at(h, t_s=float(t)) for t, h in zip(TIMES, heights, strict=True)]
    motion = motion_of(views, 0.0)
    assert motion is not None
    ahead = predict(views[-1], motion, 1.0)
    _, _, height_m = geodesy.to_geodetic(ahead.eye)
    assert float(height_m) == pytest.approx(heights[-1] * math.exp(-0.46), rel=1e-6)
    assert ahead.t_s == views[-1].t_s + 1.0


def test_a_flight_goes_on_along_its_course_across_the_antimeridian() -> None:
    lon = np.radians(179.9) + 0.002 * TIMES
    views = [
        view_at(5e3, (float(x), 0.5), t_s=float(t)) for t, x in zip(TIMES, lon, strict=True)
    ]
    motion = motion_of(views, 0.0)
    assert motion is not None
    found, lat, height_m = geodesy.to_geodetic(predict(views[-1], motion, 1.0).eye)
    assert math.remainder(float(found) - lon[-1] - 0.002, 2 * math.pi) == pytest.approx(
        0, abs=1e-9
    )
    assert float(lat) == pytest.approx(0.5)
    assert float(height_m) == pytest.approx(5e3, rel=1e-6)


def test_a_turn_goes_on_at_its_rate() -> None:
    views = [view_at(2e3, pitch_deg=-10, heading_deg=40 * t, t_s=float(t)) for t in TIMES]
    motion = motion_of(views, 0.0)
    assert motion is not None
    assert motion.turn_rad_s == pytest.approx(math.radians(40), rel=1e-6)
    there = view_at(2e3, pitch_deg=-10, heading_deg=40 * (TIMES[-1] + 0.5))
    np.testing.assert_allclose(
        predict(views[-1], motion, 0.5).rotation, there.rotation, atol=1e-6
    )


def test_a_dive_ends_above_the_ground() -> None:
    views = [view_at(h, t_s=t) for h, t in ((150.0, 0.0), (110.0, 0.1), (101.0, 0.2))]
    motion = motion_of(views, 100.0)
    assert motion is not None
    _, _, height_m = geodesy.to_geodetic(predict(views[-1], motion, 1.0).eye)
    assert float(height_m) >= 100.0 + LEAST_HEIGHT_M - 1e-6


def repeated(view: ViewState) -> list[ViewState]:
    return [view_at(100.0, t_s=0.0), view_at(101.0, t_s=0.1), view, view]


@pytest.mark.parametrize(
    "views",
    [
        [view_at(100.0)],
        repeated(view_at(102.0, t_s=0.2)),
        [view_at(1e4), view_at(1e4, (0.0, 0.0), t_s=0.02)],
        [view_at(1e4, t_s=0.0), view_at(1.1e4, t_s=5.0)],
        [view_at(1e4, t_s=1.0), view_at(1.1e4, t_s=1.0)],
        [view_at(1e4, t_s=2.0), view_at(1.1e4, t_s=1.0)],
        [view_at(1e4, pitch_deg=-90.0), view_at(1e4, pitch_deg=-40.0, t_s=0.1)],
    ],
    ids=["first", "still", "jump", "pause", "no time", "back in time", "turned at once"],
)
def test_there_is_no_motion_to_continue(views: list[ViewState]) -> None:
    assert motion_of(views, 0.0) is None


def test_motion_is_told_from_what_came_after_a_jump() -> None:
    views = [view_at(1e4, (0.0, 0.0))]
    views += [view_at(1e4 * (1 + t), t_s=0.1 + t) for t in (0.0, 0.01, 0.02)]
    motion = motion_of(views, 0.0)
    assert motion is not None
    assert motion.climb == pytest.approx(math.log(1.02) / 0.02, rel=1e-3)
    assert motion.lon_rad_s == pytest.approx(0.0, abs=1e-9)


@given(st.lists(st.floats(-1.7, 1.7), min_size=3, max_size=3))
def test_a_rotation_vector_makes_its_rotation(numbers: list[float]) -> None:
    vector = np.array(numbers)
    np.testing.assert_allclose(rotation_vector(rotation_of(vector)), vector, atol=1e-7)
    np.testing.assert_allclose(rotation_of(vector) @ vector, vector, atol=1e-12)


def deepest_at(forest: Forest, lon_rad: float, lat_rad: float) -> int:
    """Return the row of the deepest cell that contains a place."""
    levels = np.arange(cells.MAX_LEVEL + 1)
    return int(forest.row_of(cells.cell_at(lon_rad, lat_rad, levels)).max())


def test_the_ground_is_that_of_the_deepest_cell_under_the_eye(
    forests: dict[Lane, Forest],
) -> None:
    forest = forests[Lane.TERRAIN]
    row = deepest_at(forest, *SPOT)
    records = forest.records.copy()
    records["min_height_m"] = -500.0
    records["min_height_m"][row] = 77.0
    changed = Forest(
        records,
        forest.parent,
        forest.children,
        forest.links,
        forest.centre,
        forest.radius_m,
    )
    assert ground_under(changed, view_at(1e6).eye) == 77.0
    assert ground_under(changed, Ecef(-view_at(1e6).eye)) == -500.0


def test_the_row_under_an_eye_is_found_as_the_forest_finds_it(
    forests: dict[Lane, Forest], rng: np.random.Generator
) -> None:
    forest = forests[Lane.TERRAIN]
    lon = np.r_[rng.uniform(-math.pi, math.pi, 300), rng.normal(SPOT[0], 1e-2, 300)]
    lat = np.r_[rng.uniform(-1.57, 1.57, 300), rng.normal(SPOT[1], 1e-2, 300)]
    found = [row_under(forest.children, eye) for eye in geodesy.to_ecef(lon, lat, 1e5)]
    wanted = [deepest_at(forest, *place) for place in zip(lon, lat, strict=True)]
    assert found == wanted
    assert len(set(found)) > 100

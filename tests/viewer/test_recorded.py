# SPDX-License-Identifier: Apache-2.0
import math
from pathlib import Path

import numpy as np
import pytest

from tiles.errors import InputError
from viewer.camera import Pose, pose_of, view_state
from viewer.recorded import read_flight

HEAD = "t_s,lat_deg,lon_deg,height_m,heading_deg,pitch_deg,frame_ms\n"


@pytest.mark.parametrize("pitch_deg", [-90.0, -89.9, -30.0, 0.0, 60.0])
@pytest.mark.parametrize("heading_deg", [0.0, 137.0, 359.0])
def test_a_view_gives_its_pose_back(heading_deg: float, pitch_deg: float) -> None:
    pose = Pose(2.1, -0.6, 1234.5, math.radians(heading_deg), math.radians(pitch_deg))
    view = view_state(pose, (640, 360))
    again = view_state(pose_of(view), (640, 360))
    assert np.abs(again.eye - view.eye).max() < 1e-6
    assert np.abs(again.rotation - view.rotation).max() < 1e-7


def test_a_recorded_flight_goes_where_its_frames_were(tmp_path: Path) -> None:
    file = tmp_path / "frames.csv"
    rows = [(i / 60, 37.0 + 1e-6 * i, -122.0, 50.0 + i, 2.0 * i, -10.0) for i in range(20)]
    lines = [",".join(map(repr, row)) + ",16.7\n" for row in rows]
    file.write_text(HEAD + "".join(lines))
    path = read_flight(file)
    assert path.duration_s == pytest.approx(19 / 60)
    for t_s, lat, lon, height_m, heading, pitch in rows:
        pose = path.pose_at(t_s)
        found = np.degrees((pose.lat_rad, pose.lon_rad, pose.heading_rad, pose.pitch_rad))
        assert found == pytest.approx((lat, lon, heading, pitch), abs=1e-9)
        assert pose.height_m == pytest.approx(height_m)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "no frames"),
        (HEAD, "no frames"),
        ("t_s,lat_deg\n0,1\n", "column lon_deg"),
        (HEAD + "0,1,2,3,4,x,1\n1,1,2,3,4,5,1\n", "pitch_deg"),
        (HEAD + "0,1,2,3,4,5,1\n", "keyframes"),
        (HEAD + "1,1,2,3,4,5,1\n" * 2, "not after"),
    ],
)
def test_a_table_that_is_no_flight_is_one_line(
    tmp_path: Path, text: str, reason: str
) -> None:
    file = tmp_path / "frames.csv"
    file.write_text(text)
    with pytest.raises(InputError, match=reason) as found:
        read_flight(file)
    assert str(file) in str(found.value)

# SPDX-License-Identifier: Apache-2.0
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tiles.errors import InputError
from viewer.camera_path import (
    CameraPath,
    Keyframe,
    PathFile,
    monotone_slopes,
    read_path,
    write_path,
)

KEY, END = (0.0, 47.0, 8.0, 1000.0, 10.0, -60.0), (5.0, 47.1, 8.1, 20.0, 40.0, -5.0)
GEOD = pyproj.Geod(a=1.0, f=0.0)


def keyframe(t_s: float, **changes: float) -> dict[str, float]:
    frame = {
        "lat_deg": 37.76,
        "lon_deg": -122.447,
        "height_m": 100.0,
        "heading_deg": 0.0,
        "pitch_deg": -30.0,
    }
    return {"t_s": t_s, **frame, **changes}


def document(*frames: dict[str, float], **changes: object) -> dict[str, Any]:
    whole = {
        "name": "test",
        "duration_s": 30.0,
        "height_reference": "ellipsoid",
        "interpolation": "log_height",
        "keyframes": list(frames),
    }
    return {**whole, **changes}


def load(folder: Path, whole: object) -> CameraPath:
    file = folder / "path.json"
    file.write_text(whole if isinstance(whole, str) else json.dumps(whole))
    return read_path(file)


def test_poses_at_keyframes_are_the_keyframes(tmp_path: Path) -> None:
    frames = (
        keyframe(0, height_m=1e7, pitch_deg=-90),
        keyframe(10, height_m=5e3, lon_deg=-122.3, heading_deg=350),
        keyframe(30, height_m=10, lat_deg=37.7, heading_deg=20, pitch_deg=5),
    )
    path = load(tmp_path, document(*frames))
    for frame in frames:
        pose = path.pose_at(frame["t_s"])
        assert math.degrees(pose.lon_rad) == pytest.approx(frame["lon_deg"])
        assert math.degrees(pose.lat_rad) == pytest.approx(frame["lat_deg"])
        assert pose.height_m == pytest.approx(frame["height_m"])
        turn = math.degrees(pose.heading_rad) - frame["heading_deg"]
        assert (turn + 180) % 360 - 180 == pytest.approx(0.0, abs=1e-9)
        assert math.degrees(pose.pitch_rad) == pytest.approx(frame["pitch_deg"])


def test_log_height_goes_through_the_geometric_mean(tmp_path: Path) -> None:
    path = load(tmp_path, document(keyframe(0, height_m=1e7), keyframe(30, height_m=10)))
    assert path.pose_at(15.0).height_m == pytest.approx(1e4)


def test_linear_height_goes_through_the_mean(tmp_path: Path) -> None:
    frames = keyframe(0, height_m=-20), keyframe(30, height_m=80)
    path = load(tmp_path, document(*frames, interpolation="linear"))
    assert path.pose_at(15.0).height_m == pytest.approx(30.0)


def test_the_track_is_a_great_circle_over_the_antimeridian(tmp_path: Path) -> None:
    a, b = (170.0, 50.0), (-170.0, 60.0)
    frames = [keyframe(t, lon_deg=lon, lat_deg=lat) for t, (lon, lat) in ((0, a), (30, b))]
    path = load(tmp_path, document(*frames))
    azimuth, _, length = GEOD.inv(*a, *b)
    for share in (0.25, 0.5, 0.8):
        lon, lat, _ = GEOD.fwd(*a, azimuth, length * share)
        pose = path.pose_at(30.0 * share)
        assert math.degrees(pose.lon_rad) == pytest.approx(lon, abs=1e-9)
        assert math.degrees(pose.lat_rad) == pytest.approx(lat, abs=1e-9)


def test_the_heading_turns_the_shorter_way(tmp_path: Path) -> None:
    path = load(
        tmp_path, document(keyframe(0, heading_deg=350), keyframe(30, heading_deg=20))
    )
    assert math.degrees(path.pose_at(15.0).heading_rad) == pytest.approx(5.0)


def test_heights_over_the_ground_need_and_use_the_ground(tmp_path: Path) -> None:
    frames = keyframe(0, height_m=10), keyframe(30, height_m=10)
    path = load(tmp_path, document(*frames, height_reference="ground"))
    assert path.pose_at(3.0, lambda *_: 240.0).height_m == pytest.approx(250.0)
    with pytest.raises(ValueError, match="ground"):
        path.pose_at(3.0)


def test_time_outside_the_flight_stands_still(tmp_path: Path) -> None:
    path = load(tmp_path, document(keyframe(1, height_m=50), keyframe(30)))
    assert path.pose_at(0.0) == path.pose_at(1.0)
    assert path.pose_at(99.0) == path.pose_at(30.0)


@given(
    values=st.lists(st.floats(-100, 100), min_size=3, max_size=6),
    steps=st.lists(st.floats(0.1, 10), min_size=5, max_size=5),
)
def test_the_cubic_does_not_overshoot(values: list[float], steps: list[float]) -> None:
    t = np.cumsum([0.0, *steps])[: len(values)]
    slopes = monotone_slopes(t, np.array(values)[:, None])[:, 0]
    secants = np.diff(values) / np.diff(t)
    # Fritsch and Carlson: monotone where both slopes lie within 0..3 secants.
    for i, secant in enumerate(secants):
        for slope in slopes[i : i + 2]:
            assert slope * np.sign(secant) >= 0
            assert abs(slope) <= 3 * abs(secant) * (1 + 1e-9)


BAD: dict[str, tuple[Any, str]] = {
    "no file content": ("", "truncated"),
    "not JSON": ("{keyframes", "malformed"),
    "missing field": (
        document({k: v for k, v in keyframe(0).items() if k != "t_s"}),
        "missing required field `t_s`",
    ),
    "unknown field": (document(keyframe(0, roll_deg=3), keyframe(1)), "roll_deg"),
    "unknown interpolation": (
        document(keyframe(0), keyframe(1), interpolation="cubic"),
        "cubic",
    ),
    "one keyframe": (document(keyframe(0)), "fewer than 2"),
    "same time": (document(keyframe(5), keyframe(5)), "not after"),
    "going back": (document(keyframe(5), keyframe(4)), "not after"),
    "too long": (document(keyframe(0), keyframe(31)), "after duration_s"),
    "no duration": (document(keyframe(0), keyframe(1), duration_s=0), "duration_s"),
    "latitude": (document(keyframe(0, lat_deg=91), keyframe(1)), "lat_deg is 91"),
    "pitch": (document(keyframe(0), keyframe(1, pitch_deg=-91)), "pitch_deg is -91"),
    "log of nothing": (document(keyframe(0, height_m=0), keyframe(1)), "log_height"),
    "NaN": (
        json.dumps(document(keyframe(0, height_m=math.nan), keyframe(1))),
        "malformed",
    ),
    "infinite": (
        json.dumps(document(keyframe(0, height_m=1), keyframe(1))).replace(
            "100.0", "1e999"
        ),
        "",
    ),
    "text for a number": (
        json.dumps(document(keyframe(0), keyframe(1))).replace("-30.0", '"down"'),
        "float",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_path_is_one_line_that_names_the_file(name: str, tmp_path: Path) -> None:
    whole, expected = BAD[name]
    with pytest.raises(InputError) as caught:
        load(tmp_path, whole)
    message = str(caught.value)
    assert "path.json" in message
    assert "\n" not in message
    assert expected in message


def test_a_missing_file_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        read_path(tmp_path / "nothing.json")


def test_a_written_path_is_read_again(tmp_path: Path) -> None:
    file = PathFile(
        "tour", 5.0, "ellipsoid", "log_height", [Keyframe(*KEY), Keyframe(*END)]
    )
    write_path(tmp_path / "tour.json", file)
    read = read_path(tmp_path / "tour.json")
    assert (read.name, read.duration_s) == ("tour", 5.0)
    pose = read.pose_at(5.0)
    assert (pose.height_m, pose.pitch_rad) == pytest.approx((20.0, math.radians(-5.0)))


def test_no_path_is_written_that_could_not_be_read(tmp_path: Path) -> None:
    keys = [Keyframe(*END), Keyframe(*KEY)]
    with pytest.raises(InputError, match="keyframe 1"):
        write_path(tmp_path / "x.json", PathFile("x", 5.0, "ellipsoid", "linear", keys))
    assert not (tmp_path / "x.json").exists()
    good = PathFile("x", 5.0, "ellipsoid", "linear", keys[::-1])
    with pytest.raises(InputError, match="can be written"):
        write_path(tmp_path / "nowhere" / "x.json", good)

# SPDX-License-Identifier: Apache-2.0
"""Scripted flights: a JSON file of keyframes, and the pose at any time between them."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np

from tiles.errors import InputError
from tiles.frames import Floats
from viewer.camera import Pose

GroundHeight = Callable[[float, float], float]
"""Ellipsoidal height (m) of the ground at a longitude and latitude (rad)."""
SMALL_RAD = 1e-9
LONGEST_S = 1e6
ADVICE = "correct the camera path (see the example in the README)"


class Keyframe(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Where the eye is at one time; angles in degrees as people write them."""

    t_s: float
    lat_deg: float
    lon_deg: float
    height_m: float
    heading_deg: float
    pitch_deg: float


class PathFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The file as it is."""

    name: str
    duration_s: float
    height_reference: Literal["ellipsoid", "ground"]
    interpolation: Literal["log_height", "linear"]
    keyframes: list[Keyframe]


RANGES = {
    "lat_deg": (-90.0, 90.0),
    "lon_deg": (-360.0, 360.0),
    "height_m": (-12_000.0, 1e9),
    "heading_deg": (-36_000.0, 36_000.0),
    "pitch_deg": (-90.0, 90.0),
    "t_s": (0.0, LONGEST_S),
}


class CameraPath:
    """A flight that can be asked for its pose at any time.

    The ground track is a great circle from keyframe to keyframe. Heading (the shorter
    way round), pitch and height, or with "log_height" the logarithm of the height,
    follow a monotone cubic: no overshoot, no jerk at a keyframe.
    """

    def __init__(self, file: PathFile) -> None:
        self.name, self.duration_s = file.name, file.duration_s
        self.height_reference = file.height_reference
        frames = file.keyframes
        self._t = np.array([k.t_s for k in frames])
        lon = np.radians([k.lon_deg for k in frames])
        lat = np.radians([k.lat_deg for k in frames])
        self._track = np.stack(
            (np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)), -1
        )
        self._log = file.interpolation == "log_height"
        heights = np.array([k.height_m for k in frames])
        heading = np.unwrap(np.radians([k.heading_deg for k in frames]))
        pitch = np.radians([k.pitch_deg for k in frames])
        self._values = np.stack(
            (np.log(heights) if self._log else heights, heading, pitch), -1
        )
        self._slopes = monotone_slopes(self._t, self._values)

    def pose_at(self, t_s: float, ground_height: GroundHeight | None = None) -> Pose:
        """Return the pose at a time; before the first and after the last it stands still.

        Parameters
        ----------
        ground_height : needed when heights are above the ground
        """
        i, share = self._segment(t_s)
        height, heading, pitch = self._smooth(i, share)
        height = math.exp(height) if self._log else height
        x, y, z = _between(self._track[i], self._track[i + 1], share)
        lon, lat = math.atan2(y, x), math.atan2(z, math.hypot(x, y))
        if self.height_reference == "ground":
            if ground_height is None:
                raise ValueError(f"path {self.name!r} needs the ground's height")
            height += ground_height(lon, lat)
        pitch = min(max(pitch, -math.pi / 2), math.pi / 2)
        return Pose(lon, lat, float(height), float(heading % (2 * math.pi)), float(pitch))

    def _segment(self, t_s: float) -> tuple[int, float]:
        t = min(max(t_s, float(self._t[0])), float(self._t[-1]))
        i = int(np.clip(np.searchsorted(self._t, t, "right") - 1, 0, len(self._t) - 2))
        return i, float((t - self._t[i]) / (self._t[i + 1] - self._t[i]))

    def _smooth(self, i: int, x: float) -> tuple[float, float, float]:
        """Cubic Hermite between keyframes i and i + 1."""
        step = self._t[i + 1] - self._t[i]
        a, b = self._values[i], self._values[i + 1]
        rise = x * x * (3 - 2 * x)
        lead, trail = x * (1 - x) ** 2, x * x * (x - 1)
        value = (
            a
            + (b - a) * rise
            + step * (lead * self._slopes[i] + trail * self._slopes[i + 1])
        )
        return float(value[0]), float(value[1]), float(value[2])


def monotone_slopes(t: Floats, values: Floats) -> Floats:
    """Return slopes at samples that make a cubic without overshoot (Fritsch, Butland).

    Parameters
    ----------
    t : (n,) increasing
    values : (n, k)
    """
    steps = np.diff(t)[:, None]
    secants = np.diff(values, axis=0) / steps
    slopes = np.empty_like(values)
    slopes[0], slopes[-1] = secants[0], secants[-1]
    before, after = secants[:-1], secants[1:]
    w1, w2 = 2 * steps[1:] + steps[:-1], steps[1:] + 2 * steps[:-1]
    same_sign = before * after > 0
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        mean = (w1 + w2) / (w1 / before + w2 / after)
    slopes[1:-1] = np.where(same_sign, mean, 0.0)
    return slopes


def _between(a: Floats, b: Floats, share: float) -> tuple[float, float, float]:
    """Return the point at a share of the great circle from a to b."""
    angle = math.atan2(float(np.linalg.norm(np.cross(a, b))), float(a @ b))
    sine = math.sin(angle)
    if sine < SMALL_RAD:
        point = a + (b - a) * share
    else:
        point = (a * math.sin((1 - share) * angle) + b * math.sin(share * angle)) / sine
    return float(point[0]), float(point[1]), float(point[2])


def read_path(file: Path) -> CameraPath:
    """Read and check a camera path.

    Raises
    ------
    InputError
        Naming the file and the first thing that is wrong.
    """
    try:
        text = file.read_bytes()
    except OSError as error:
        raise InputError(
            file, str(error.strerror or error), "name a camera path"
        ) from error
    try:
        path = msgspec.json.decode(text, type=PathFile)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise InputError(file, str(error), ADVICE) from error
    return checked(file, path)


def checked(file: Path, path: PathFile) -> CameraPath:
    """Return the flight of a file that has all its fields.

    Raises
    ------
    InputError
        Naming the file and the first thing that is wrong.
    """
    reason = _fault(path)
    if reason:
        raise InputError(file, reason, ADVICE)
    return CameraPath(path)


def write_path(file: Path, path: PathFile) -> None:
    """Write a camera path.

    Raises
    ------
    InputError
        When it is none that `read_path` would take, or the file can't be written.
    """
    checked(file, path)
    try:
        file.write_bytes(msgspec.json.format(msgspec.json.encode(path)) + b"\n")
    except OSError as error:
        reason = str(error.strerror or error)
        raise InputError(file, reason, "choose a folder that can be written") from error


def _fault(path: PathFile) -> str | None:
    """Return what is wrong with a path that has all its fields, None where nothing is."""
    frames = path.keyframes
    if len(frames) <= 1:
        return "fewer than 2 keyframes"
    if not 0.0 < path.duration_s <= LONGEST_S:
        return f"duration_s is {path.duration_s}, not above 0"
    for i, frame in enumerate(frames):
        fault = _frame_fault(frame, log=path.interpolation == "log_height")
        if fault:
            return f"keyframe {i}: {fault}"
        if i and frame.t_s <= frames[i - 1].t_s:
            return f"keyframe {i}: t_s {frame.t_s} is not after {frames[i - 1].t_s}"
    if frames[-1].t_s > path.duration_s:
        return f"the last keyframe is at {frames[-1].t_s} s, after duration_s"
    return None


def _frame_fault(frame: Keyframe, *, log: bool) -> str | None:
    for field, (low, high) in RANGES.items():
        value = getattr(frame, field)
        if not low <= value <= high:
            return f"{field} is {value}, outside {low:g} to {high:g}"
    if log and frame.height_m <= 0.0:
        return f"height_m is {frame.height_m}, but log_height needs it above 0"
    return None

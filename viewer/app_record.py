# SPDX-License-Identifier: Apache-2.0
"""Tours: what was flown becomes a camera path, and a camera path is flown again."""

import math
from typing import TYPE_CHECKING

from tiles.errors import InputError
from viewer.camera import Pose
from viewer.camera_path import CameraPath, Keyframe, PathFile, write_path
from viewer.files import free_name

if TYPE_CHECKING:
    from pathlib import Path

    from viewer.app import App

EVERY_S = 0.25
"""Time between keyframes."""
LEAD_S = 0.5
"""A replay waits so long at its first pose."""


class Recorder:
    """Writes poses down, four times a second."""

    def __init__(self) -> None:
        self.on = False
        self._frames: list[tuple[float, Pose]] = []

    @property
    def duration_s(self) -> float:
        """How long it has been recording."""
        return self._frames[-1][0] - self._frames[0][0] if self._frames else 0.0

    def toggle(self, app: "App") -> None:
        """Begin, or end and save."""
        self.on = not self.on
        if self.on:
            self._frames = [(app.now_s, app.navigator.pose)]
            app.say("recording a tour: V again saves it")
            return
        self._add(app, 1e-3)
        if len(self._frames) < 2:
            app.say("nothing was recorded")
            return
        name = free_name(app.state.out, f"{app.session.store.path.stem}-tour", ".json")
        try:
            write_path(name, path_file(name.stem, self._frames))
        except InputError as error:
            app.say(str(error))
        else:
            app.say(f"tour saved: {name}")
            app.replayer.last = name

    def step(self, app: "App") -> None:
        """Write the pose down where it is time."""
        if self.on:
            self._add(app, EVERY_S)

    def _add(self, app: "App", after_s: float) -> None:
        if app.now_s - self._frames[-1][0] >= after_s:
            self._frames.append((app.now_s, app.navigator.pose))


class Replayer:
    """Flies a camera path in real time."""

    def __init__(self) -> None:
        self.path: CameraPath | None = None
        self.last: Path | None = None
        """the tour that was saved last"""
        self.t_s = 0.0
        self._start_s = 0.0

    @property
    def on(self) -> bool:
        """Whether it is flying."""
        return self.path is not None

    def start(self, path: CameraPath, now_s: float) -> None:
        """Begin."""
        self.path, self._start_s, self.t_s = path, now_s + LEAD_S, 0.0

    def stop(self) -> None:
        """End where it is."""
        self.path = None

    def step(self, app: "App") -> None:
        """Put the eye where the path has it now."""
        if self.path is None:
            return
        self.t_s = min(max(app.now_s - self._start_s, 0.0), self.path.duration_s)
        ground = app.ground.height_m
        app.navigator.pose = self.path.pose_at(self.t_s, ground)
        if self.t_s >= self.path.duration_s:
            self.stop()
            app.say("end of the tour")


def path_file(name: str, frames: list[tuple[float, Pose]]) -> PathFile:
    """Return a camera path of times and poses; it begins at 0 s."""
    start_s = frames[0][0]
    keys = [
        Keyframe(
            round(t_s - start_s, 4),
            math.degrees(pose.lat_rad),
            math.degrees(pose.lon_rad),
            pose.height_m,
            math.degrees(pose.heading_rad),
            math.degrees(pose.pitch_rad),
        )
        for t_s, pose in frames
    ]
    above = all(pose.height_m > 0 for _, pose in frames)
    return PathFile(
        name, keys[-1].t_s, "ellipsoid", "log_height" if above else "linear", keys
    )

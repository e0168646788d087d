# SPDX-License-Identifier: Apache-2.0
"""A film of a tour, made by `geopage film` in a process of its own."""

import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, TYPE_CHECKING

if TYPE_CHECKING:
    from viewer.app import App

SIZE = "1280x720"


class Filming:
    """One film at a time, while the window lives on."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._said: IO[bytes] | None = None
        self._out = Path()

    @property
    def on(self) -> bool:
        """Whether a film is being made."""
        return self._process is not None

    def start(self, app: "App", tour: Path) -> None:
        """Begin the film of a tour; it lies beside it."""
        if self.on:
            return
        self._out = tour.with_suffix(".mp4")
        words = ["film", str(app.session.store.path), str(tour), "-o", str(self._out)]
        words += ["--size", SIZE]
        if app.state.style:
            words += ["--style", app.state.style]
        self._said = TemporaryFile()  # noqa: SIM115  (it lives as long as the process)
        self._process = subprocess.Popen(
            [sys.executable, "-m", "geopage", *words],
            stdout=subprocess.DEVNULL,
            stderr=self._said,
        )
        app.say("making the film: you may fly on")

    def step(self, app: "App") -> None:
        """Say so when it is done."""
        if self._process is None or (code := self._process.poll()) is None:
            return
        app.say(f"film saved: {self._out}" if code == 0 else self._last_line())
        self.close()

    def _last_line(self) -> str:
        assert self._said
        self._said.seek(0)
        lines = self._said.read().decode("utf-8", "replace").split("\n")
        return next((line for line in reversed(lines) if line.strip()), "no film")

    def close(self) -> None:
        """End the process, if it has not ended; the same command then goes on there."""
        if self._process:
            self._process.terminate()
            self._process.wait()
        if self._said:
            self._said.close()
        self._process = self._said = None

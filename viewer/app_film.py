# SPDX-License-Identifier: Apache-2.0
"""A film of a tour, made by `geopage film` in a process of its own."""

import re
import shlex
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, TYPE_CHECKING

if TYPE_CHECKING:
    from viewer.app import App

SIZE = "1280x720"
PERCENT = re.compile(r"(\d+)%\|")
TAIL_BYTES = 2000
"""Of what the process says, for its last line."""
LOOK_S = 0.5


class Filming:
    """One film at a time, while the window lives on."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._said: IO[bytes] | None = None
        self._words: list[str] = []
        self._out = Path()
        self._stopped = False
        self._look_s = 0.0
        self.percent = 0
        """how much is done"""

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
        self._words, self._stopped, self._look_s, self.percent = words, False, 0.0, 0
        # Appended to, so that reading it moves no place where the process writes.
        self._said = TemporaryFile("a+b")  # noqa: SIM115  (as long as the process)
        self._process = subprocess.Popen(
            [sys.executable, "-m", "geopage", *words],
            stdout=subprocess.DEVNULL,
            stderr=self._said,
        )
        app.say("making the film: you may fly on")

    def stop(self) -> None:
        """End the process soon; begun again, it goes on where it was."""
        if self._process:
            self._stopped = True
            self._process.terminate()

    def step(self, app: "App") -> None:
        """See how far it is, and say so when it is done."""
        if self._process is None or app.now_s < self._look_s:
            return
        self._look_s = app.now_s + LOOK_S
        if (code := self._process.poll()) is None:
            done = PERCENT.findall(self._tail())
            if done and int(done[-1]) != self.percent:
                self.percent = int(done[-1])
                app.refresh()
            return
        stopped = "film stopped: Make film goes on where it was"
        failed = stopped if self._stopped else self._last_line()
        app.say(f"film saved: {self._out}" if code == 0 else failed)
        self._end()

    def _tail(self) -> str:
        """Return the end of what the process has said."""
        assert self._said
        size = self._said.seek(0, 2)
        self._said.seek(max(size - TAIL_BYTES, 0))
        return self._said.read().decode("utf-8", "replace")

    def _last_line(self) -> str:
        lines = re.split(r"[\r\n]+", self._tail())
        return next((line for line in reversed(lines) if line.strip()), "no film")

    def _end(self) -> None:
        if self._process:
            self._process.wait()
        if self._said:
            self._said.close()
        self._process = self._said = None

    def close(self) -> list[str]:
        """End the process, if it has not ended; returns how to go on with the film."""
        self.stop()
        unfinished = self.on
        self._end()
        if not unfinished:
            return []
        return [f"the film is unfinished; to go on: geopage {shlex.join(self._words)}"]

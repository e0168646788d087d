# SPDX-License-Identifier: Apache-2.0
"""A virtual screen with a real mouse and real keys."""

import os
import shutil
import struct
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

SIZE = 1024, 640
NEEDED = "Xvfb", "xdotool"


class Screen:
    """A screen in memory."""

    def __init__(self, display: str, folder: Path) -> None:
        self.display, self._file = display, folder / "Xvfb_screen0"

    def do(self, *words: str) -> str:
        """Move the mouse, press keys: a command of xdotool."""
        done = subprocess.run(
            ["xdotool", *words],
            env={**os.environ, "DISPLAY": self.display},
            check=True,
            capture_output=True,
            text=True,
            timeout=20,
        )
        return done.stdout.strip()

    def picture(self) -> NDArray[np.uint8]:
        """Return what is on the screen, (height, width, 3) uint8 sRGB."""
        data = self._file.read_bytes()
        head = struct.unpack(">25I", data[:100])
        width, height, row_bytes = head[4], head[5], head[12]
        start = head[0] + head[19] * 12
        whole = np.frombuffer(data, np.uint8, row_bytes * height, start)
        return whole.reshape(height, row_bytes // 4, 4)[:, :width, 2::-1].copy()


@contextmanager
def open_screen(folder: Path) -> Iterator[Screen]:
    """Start a virtual screen and make it this process's; skip where there is none."""
    missing = [name for name in NEEDED if not shutil.which(name)]
    if missing:
        pytest.skip(f"not installed: {', '.join(missing)}")
    read, write = os.pipe()
    words = ["Xvfb", "-displayfd", str(write), "-fbdir", str(folder), "-noreset"]
    words += ["-screen", "0", f"{SIZE[0]}x{SIZE[1]}x24"]
    with (
        pytest.MonkeyPatch.context() as patch,
        subprocess.Popen(words, pass_fds=(write,), stderr=subprocess.DEVNULL) as process,
    ):
        os.close(write)
        try:
            with os.fdopen(read) as told:
                number = told.readline().strip()
            if not number:
                pytest.skip("Xvfb does not start here")
            patch.setenv("DISPLAY", f":{number}")
            patch.delenv("WAYLAND_DISPLAY", raising=False)
            yield Screen(f":{number}", folder)
        finally:
            process.terminate()

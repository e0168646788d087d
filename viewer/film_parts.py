# SPDX-License-Identifier: Apache-2.0
"""The finished parts of a film that is being made, so that it can go on after a stop.

They lie in a folder beside the film until it is done, each named by its first frame and
the number of its frames. A part gets its name when it is whole; what a killed process
leaves has none, and is made again.
"""

import json
import os
import shutil
import subprocess
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiles.errors import InputError, interrupts_held
from viewer.film import Encoder, ffmpeg

Json = dict[str, Any]
PART_S = 20.0
"""A part ends with the frame that is drawn so long after the part began."""
CRF, PRESET = 18, "fast"


class Parts:
    """Takes the frames of a film in order; those of an earlier attempt are kept.

    Parameters
    ----------
    out : the film
    about : everything that its pictures depend on, for JSON
    """

    def __init__(
        self,
        out: Path,
        size_px: tuple[int, int],
        hz: float,
        about: Json,
        part_s: float = PART_S,
    ) -> None:
        self.out, self.folder = out, out.with_name(out.name + ".parts")
        self._size_px, self._hz, self._part_s = size_px, hz, part_s
        self._ffmpeg = ffmpeg(out)
        self._encoder: Encoder | None = None
        self._ends_s = 0.0
        self._open_folder()
        self._parts = self._finished()
        self.count = sum(_span(part)[1] for part in self._parts)
        """frames that are there"""
        self._keep(about)

    def _open_folder(self) -> None:
        try:
            self.folder.mkdir(exist_ok=True)
        except OSError as error:
            reason = str(error.strerror or error)
            raise InputError(
                self.out, reason, "name a file in a folder to write in"
            ) from error

    def _finished(self) -> list[Path]:
        """Return the parts that follow each other from frame 0 on; remove all else."""
        parts, count = [], 0
        for part in sorted(self.folder.glob("[0-9]*.mp4"), key=_span):
            if _span(part)[0] == count:
                parts.append(part)
                count += _span(part)[1]
            else:
                part.unlink()
        return parts

    def _keep(self, about: Json) -> None:
        """Write down what the film is made from, or compare it with what is there.

        Raises
        ------
        InputError
            When the parts that are there are those of another film.
        """
        file = self.folder / "film.json"
        about = json.loads(json.dumps(about))
        if self._parts:
            before = json.loads(file.read_text())
            changed = [key for key in about if before.get(key) != about[key]]
            if changed:
                reason = f"was begun with another {_told(changed[0], before, about)}"
                advice = f"go on with the same, or remove {self.folder} to begin anew"
                raise InputError(self.out, reason, advice)
        fresh = self.folder / "fresh.json"
        fresh.write_text(json.dumps(about, indent=2))
        fresh.replace(file)

    def add(self, rgb: NDArray[np.uint8]) -> None:
        """Append frame number `count`; Ctrl-C waits for that."""
        with interrupts_held():
            self._add(rgb)

    def _add(self, rgb: NDArray[np.uint8]) -> None:
        if self._encoder is None:
            file = self.folder / f"unfinished-{os.getpid()}.mp4"
            self._encoder = Encoder(file, self._size_px, self._hz, CRF, PRESET)
            self._ends_s = time.monotonic() + self._part_s
        self._encoder.add(rgb)
        self.count += 1
        if time.monotonic() >= self._ends_s:
            self._close()

    def close(self) -> None:
        """Finish the part that is being made and give it its name."""
        with interrupts_held():
            self._close()

    def _close(self) -> None:
        encoder, self._encoder = self._encoder, None
        if encoder is None:
            return
        encoder.close()
        first = sum(_span(part)[1] for part in self._parts)
        if frames := self._frames_in(encoder.path):
            part = self.folder / f"{first:07d}-{frames}.mp4"
            self._parts.append(encoder.path.replace(part))
        self.count = first + frames

    def _frames_in(self, file: Path) -> int:
        """Count the frames that a file really has; none where its end is missing."""
        try:
            return int(self._ffmpeg.count_frames_and_secs(str(file))[0])
        except RuntimeError:
            return 0

    def join(self) -> None:
        """Put the parts together without coding them again, and remove them.

        Raises
        ------
        InputError
        """
        self.close()
        listed, whole = self.folder / "parts.txt", self.folder / "whole.mp4"
        lines = [f"file '{part.name}'" for part in self._parts]
        listed.write_text("\n".join(["ffconcat version 1.0", *lines]) + "\n")
        words = ["-v", "error", "-y", "-f", "concat", "-i", str(listed), "-c", "copy"]
        command = [self._ffmpeg.get_ffmpeg_exe(), *words, "-movflags", "+faststart"]
        done = subprocess.run([*command, str(whole)], check=False, capture_output=True)
        if done.returncode or self._frames_in(whole) != self.count:
            advice = f"make room and run the command again, or remove {self.folder}"
            raise InputError(self.out, "its parts can't be put together", advice)
        try:
            whole.replace(self.out)
        except OSError as error:
            reason = str(error.strerror or error)
            raise InputError(self.out, reason, "name a file that can be written") from error
        shutil.rmtree(self.folder)


def _span(part: Path) -> tuple[int, int]:
    """Return a part's first frame and its number of frames."""
    first, count = part.stem.split("-")
    return int(first), int(count)


def _told(key: str, before: Json, now: Json) -> str:
    """Say what has changed, and how where a person can read it."""
    if isinstance(now[key], str):  # a digest
        return key
    old, new = (one[key] for one in (before, now))
    if key == "style":
        old, new = ((one or {}).get("field", "none") for one in (old, new))
    return f"{key} ({old}, now {new})"

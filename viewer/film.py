# SPDX-License-Identifier: Apache-2.0
"""Films as files."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiles.errors import InputError

FILM_HZ = 30
FILTERS = "crop=trunc(iw/2)*2:trunc(ih/2)*2,scale=out_color_matrix=bt709:out_range=tv"
"""H.264 wants even sides, so an odd one loses a line."""
TAGS = ("-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "bt709")
"""Players take a film without these for one of the standard of 1982."""


def ffmpeg(path: Path) -> Any:
    """Return the library that makes films; `path` is what it is needed for.

    Raises
    ------
    InputError
        When it, or the program that it brings, is not installed.
    """
    try:
        import imageio_ffmpeg  # noqa: PLC0415  (an extra)
    except ImportError as error:
        advice = "install the extra `video`: pip install geopage[video]"
        raise InputError(path, "films need imageio-ffmpeg", advice) from error
    try:
        imageio_ffmpeg.get_ffmpeg_exe()
    except RuntimeError as error:
        advice = "install ffmpeg, or set IMAGEIO_FFMPEG_EXE to where it is"
        raise InputError(path, "imageio-ffmpeg came without ffmpeg", advice) from error
    return imageio_ffmpeg


class Encoder:
    """Writes pictures as H.264, one after the other.

    Parameters
    ----------
    crf : quality: 18 can't be told from the pictures, 23 is good; less is larger
    """

    def __init__(
        self,
        path: Path,
        size_px: tuple[int, int],
        hz: float,
        crf: int = 23,
        preset: str = "veryfast",
    ) -> None:
        self.path = path
        quality = ("-crf", str(crf), "-preset", preset, "-movflags", "+faststart")
        self._writer: Any = ffmpeg(path).write_frames(
            str(path),
            size_px,
            fps=hz,
            codec="libx264",
            quality=None,
            macro_block_size=1,
            ffmpeg_log_level="quiet",
            output_params=[*quality, "-vf", FILTERS, *TAGS],
        )
        self._writer.send(None)

    def add(self, rgb: NDArray[np.uint8]) -> None:
        """Append a picture, (h, w, 3) uint8 sRGB.

        Raises
        ------
        InputError
            When the file can't be written.
        """
        try:
            self._writer.send(np.ascontiguousarray(rgb))
        except OSError as error:
            advice = "name a file in a folder that can be written and has room"
            raise InputError(self.path, "the film can't be written", advice) from error

    def close(self) -> None:
        """Finish the file."""
        self._writer.close()


class Film:
    """An MP4 that shows frames at the times when the flight showed them."""

    def __init__(self, path: Path, size_px: tuple[int, int]) -> None:
        self._encoder = Encoder(path, size_px, FILM_HZ)
        self._last: NDArray[np.uint8] | None = None
        self._count = 0

    def show(self, t_s: float, rgb: NDArray[np.uint8]) -> None:
        """Show a picture from a time on."""
        self._fill(t_s)
        self._last = rgb

    def _fill(self, t_s: float) -> None:
        while self._last is not None and self._count < t_s * FILM_HZ:
            self._encoder.add(self._last)
            self._count += 1

    def end(self, t_s: float) -> None:
        """Show the last picture until a time, and finish the file."""
        self._fill(t_s)
        self._encoder.close()


@contextmanager
def film(
    path: Path | None, size_px: tuple[int, int], end_s: float
) -> Iterator[Film | None]:
    """Open a film, or none when there is no path."""
    if path is None:
        yield None
        return
    made = Film(path, size_px)
    yield made
    made.end(end_s)

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


class Film:
    """An MP4 that shows frames at the times when the flight showed them."""

    def __init__(self, path: Path, size_px: tuple[int, int]) -> None:
        try:
            import imageio_ffmpeg  # noqa: PLC0415  (an extra)
        except ImportError as error:
            advice = "install the extra `video`: pip install geopage[video]"
            raise InputError(path, "films need imageio-ffmpeg", advice) from error
        self._writer: Any = imageio_ffmpeg.write_frames(
            str(path),
            size_px,
            fps=FILM_HZ,
            codec="libx264",
            macro_block_size=2,
            output_params=["-crf", "23", "-preset", "veryfast", "-movflags", "+faststart"],
        )
        self._writer.send(None)
        self._last: NDArray[np.uint8] | None = None
        self._count = 0

    def show(self, t_s: float, rgb: NDArray[np.uint8]) -> None:
        """Show a picture from a time on."""
        self._fill(t_s)
        self._last = rgb

    def _fill(self, t_s: float) -> None:
        while self._last is not None and self._count < t_s * FILM_HZ:
            self._writer.send(np.ascontiguousarray(self._last))
            self._count += 1

    def end(self, t_s: float) -> None:
        """Show the last picture until a time, and finish the file."""
        self._fill(t_s)
        self._writer.close()


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

# SPDX-License-Identifier: Apache-2.0
"""Pictures as files."""

from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from tiles.errors import InputError


def write_png(path: Path, rgb: NDArray[np.uint8]) -> None:
    """Write a picture.

    Parameters
    ----------
    rgb : (height, width, 3) uint8, top row first

    Raises
    ------
    InputError
        When the file can't be written.
    """
    try:
        with path.open("wb") as file:
            png_file(file, rgb)
    except OSError as error:
        advice = "give a path in a folder that exists and can be written"
        raise InputError(path, str(error.strerror or error), advice) from error


def png_file(file: BinaryIO, rgb: NDArray[np.uint8]) -> None:
    """Write a picture, (height, width, 3) uint8, into an open file.

    Raises
    ------
    InputError
        When Pillow is not installed.
    """
    try:
        from PIL import Image  # noqa: PLC0415  an extra; drawing itself works without it
    except ImportError as error:
        advice = "install the extra `report`: pip install geopage[report]"
        raise InputError("PNG", "pictures need Pillow", advice) from error
    Image.fromarray(np.ascontiguousarray(rgb)).save(file, "PNG", compress_level=4)

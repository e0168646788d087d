# SPDX-License-Identifier: Apache-2.0
"""Pictures as files."""

from pathlib import Path

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
    from PIL import Image  # noqa: PLC0415  an extra; drawing itself works without it

    try:
        Image.fromarray(np.ascontiguousarray(rgb)).save(path, "PNG", compress_level=4)
    except OSError as error:
        advice = "give a path in a folder that exists and can be written"
        raise InputError(path, str(error.strerror or error), advice) from error

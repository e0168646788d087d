# SPDX-License-Identifier: Apache-2.0
"""A picture that a script holds and a notebook shows."""

import io
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from viewer.picture import png_file, write_png


class Image:
    """A drawn picture; `numpy.asarray(image)` is its pixels.

    Parameters
    ----------
    rgb : (h, w, 3) uint8 sRGB, top row first
    about : what is known of it: place, figures, legend
    """

    def __init__(self, rgb: NDArray[np.uint8], about: dict[str, Any]) -> None:
        self.rgb = rgb
        self.about = about

    @property
    def shape(self) -> tuple[int, ...]:
        """(h, w, 3)."""
        return self.rgb.shape

    def __array__(
        self,
        dtype: Any = None,
        copy: bool | None = None,  # noqa: FBT001 (numpy's protocol)
    ) -> NDArray[Any]:
        return np.array(self.rgb, dtype, copy=copy)

    def save(self, path: str | Path) -> None:
        """Write a PNG.

        Raises
        ------
        InputError
        """
        write_png(Path(path), self.rgb)

    def _repr_png_(self) -> bytes:
        file = io.BytesIO()
        png_file(file, self.rgb)
        return file.getvalue()

    def __repr__(self) -> str:
        height, width, _ = self.shape
        return f"<geopage image, {width} x {height} pixels>"

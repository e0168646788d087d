# SPDX-License-Identifier: Apache-2.0
"""What a new store starts from: the sample earth."""

from pathlib import Path

from ingest.terrain import RasterOptions
from tiles.errors import InputError
from tiles.samples import SAMPLES

EARTH = "earth.tif"
PICTURE = "earth_picture.tif"


def samples(names: tuple[str, ...]) -> list[Path]:
    """Return the paths of sample files that are there.

    Raises
    ------
    InputError
        When one is missing.
    """
    paths = [SAMPLES / name for name in names]
    for path in paths:
        if not path.is_file():
            raise InputError(
                path, "sample file is missing", "install geopage again, or use --bare"
            )
    return paths


def earth_files() -> list[tuple[Path, RasterOptions]]:
    """Return what a new store starts from: the whole earth at 10', and its picture.

    Raises
    ------
    InputError
        When a sample file is missing.
    """
    earth, picture = samples((EARTH, PICTURE))
    return [
        (earth, RasterOptions(datum="egm96", is_sample=True)),
        (picture, RasterOptions("imagery", is_sample=True)),
    ]

# SPDX-License-Identifier: Apache-2.0
"""What a new store starts from: the sample earth."""

from pathlib import Path
from typing import Any

from ingest.raster_blocks import Progress
from ingest.terrain import RasterOptions, ingest_rasters
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


def ingest_earth(store: Path, progress: Progress) -> dict[str, Any]:
    """Start a new store: the whole earth at 10 minutes of arc, and its picture."""
    earth, picture = samples((EARTH, PICTURE))
    heights = RasterOptions(kind="terrain", datum="egm96")
    return ingest_rasters(
        store, [(earth, heights), (picture, RasterOptions("imagery"))], progress
    )

# SPDX-License-Identifier: Apache-2.0
"""Open a raster, and refuse in one line what would not do: nothing is unpacked yet."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import rasterio
from rasterio.errors import NotGeoreferencedWarning, RasterioError

from ingest import vrt
from tiles.errors import InputError

CACHE_MIB = 128
"""What GDAL may keep of a file's own blocks: 256 whole rows of 130,000 posts"""
LARGEST_BLOCK_BYTES = 256 << 20
"""A file's own block is unpacked whole, however little of it is needed."""
MOST_POSTS, MOST_POSTS_A_BYTE = 1 << 30, 2000
"""A larger raster must have more bytes than that: else it is all but empty."""
MOST_TIMES = 4
"""Likewise a VRT more posts in its parts"""
DRIVERS = {
    ".hgt": "SRTMHGT",
    ".zip": "SRTMHGT",
    ".nc": "netCDF",
    ".img": "HFA",
    ".asc": "AAIGrid",
    ".bil": "EHdr",
    ".flt": "EHdr",
    ".dt0": "DTED",
    ".dt1": "DTED",
    ".dt2": "DTED",
    ".png": "PNG",
    ".jpg": "JPEG",
    ".jpeg": "JPEG",
    ".vrt": "VRT",
}
"""The driver of each ending, GTiff of all others: a file can't choose its own reader, so a
VRT disguised as a TIFF, which could name any other file, is refused. So are the parts of a
VRT by what else GDAL knows: that might fetch them over a network."""

ADVICES = {
    ".hgt": "name it by its corner, like N43E007.hgt",
    ".zip": "zip one tile as N43E007.hgt.zip, or unpack it",
    ".gz": "unpack it first",
}


@contextmanager
def bounded() -> Iterator[None]:
    """Read rasters with a small cache of GDAL's, and nothing over a network.

    What a VRT is made of is looked at before; this is for what that missed.
    """
    with rasterio.Env(GDAL_CACHEMAX=CACHE_MIB, CPL_VSIL_CURL_ALLOWED_EXTENSIONS=".none"):
        yield


def open_raster(path: str | Path) -> rasterio.DatasetReader:
    """Open a raster with an allow-listed driver; nothing of it is unpacked yet.

    Raises
    ------
    InputError
    """
    path = Path(path)
    if not path.exists():
        raise InputError(path, "no such file", "check the path")
    driver = driver_of(path)
    if driver == "VRT":
        vrt.refuse_remote(path, path.read_text(errors="replace"))
    dataset = quiet_open(path, driver)
    try:
        require_usable(path, dataset)
    except BaseException:
        dataset.close()
        raise
    return dataset


def driver_of(path: Path) -> str:
    """Return the name of what may read a file."""
    return DRIVERS.get(path.suffix.lower(), "GTiff")


def require_usable(path: Path, dataset: rasterio.DatasetReader) -> None:
    """Refuse what holds no numbers, and what would unpack to gigabytes.

    Raises
    ------
    InputError
    """
    if not dataset.count:
        raise InputError(path, "holds several rasters", "extract one with gdal_translate")
    if np.dtype(dataset.dtypes[0]).kind == "c":
        raise InputError(path, "holds complex numbers", "give elevations in metres")
    if dataset.driver == "VRT":
        held = 0
        for part in parts_of(path, path, dataset):
            if part.driver != "VRT":
                require_small_blocks(path, part)
                held += part.width * part.height
        require_full(path, dataset, MOST_TIMES * held)
    else:
        require_full(path, dataset, MOST_POSTS_A_BYTE * path.stat().st_size)
        require_small_blocks(path, dataset)


def require_full(path: Path, dataset: rasterio.DatasetReader, most: int) -> None:
    """Refuse a raster of many more posts than it can hold."""
    if dataset.width * dataset.height > max(MOST_POSTS, most):
        size = f"{dataset.width} x {dataset.height} posts"
        advice = "cut out what it holds with gdal_translate -projwin"
        raise InputError(path, f"all but empty for its {size}", advice)


def parts_of(
    path: Path, inner: Path, dataset: rasterio.DatasetReader, deep: int = vrt.MOST_DEEP
) -> Iterator[rasterio.DatasetReader]:
    """Open what a VRT is made of, one after the other, and what VRTs in it are made of.

    Parameters
    ----------
    path : that the user named
    inner, dataset : the VRT that is looked at, the same or one in it

    Raises
    ------
    InputError
        When a part can't be read, or lies on a network.
    """
    if not deep:
        raise InputError(path, "a VRT of VRTs of VRTs", "name the innermost ones")
    vrt.refuse_remote(path, inner.read_text(errors="replace"))
    for name in vrt.parts_of(inner, dataset.files):
        vrt.refuse_remote(path, name)
        with quiet_open(name, driver_of(Path(name)), path) as part:
            yield part
            if part.driver == "VRT":
                yield from parts_of(path, Path(name), part, deep - 1)


def files_of(path: Path, dataset: rasterio.DatasetReader) -> list[str]:
    """Return every file that a raster is read from: of a VRT also what its parts are."""
    parts = parts_of(path, path, dataset) if dataset.driver == "VRT" else ()
    return [str(path), *dataset.files, *(name for part in parts for name in part.files)]


def require_small_blocks(path: Path, dataset: rasterio.DatasetReader) -> None:
    """Refuse a file whose blocks don't fit the memory that an ingest may take."""
    rows, cols = dataset.block_shapes[0]
    together = dataset.count if dataset.profile.get("interleave") == "pixel" else 1
    block_bytes = rows * cols * np.dtype(dataset.dtypes[0]).itemsize * together
    if block_bytes > LARGEST_BLOCK_BYTES:
        advice = "write it again with gdal_translate -co TILED=YES"
        raise InputError(path, f"has blocks of {block_bytes >> 20} MiB", advice)


def quiet_open(
    path: str | Path, driver: str, whole: Path | None = None
) -> rasterio.DatasetReader:
    """Open a raster, or say in one line why it can't be read.

    Parameters
    ----------
    whole : that it is a part of
    """
    try:
        with warnings.catch_warnings(), bounded():
            # `describe` refuses it, in a line of its own.
            warnings.simplefilter("ignore", NotGeoreferencedWarning)
            return rasterio.open(path, driver=driver)
    except (RasterioError, OSError) as error:
        if whole and not str(path).startswith("/vsi") and not Path(path).exists():
            reason = f"made of {path}, which is not there"
            raise InputError(whole, reason, "put it there, or make the VRT anew") from error
        if whole:
            reason = f"made of {path}, which can't be read as a raster"
            raise InputError(whole, reason, "give that as a GeoTIFF, HGT or VRT") from error
        raise unreadable(path, error) from error


def unreadable(path: str | Path, error: Exception) -> InputError:
    """Say in one line why GDAL can't read a file."""
    # rasterio's own message may only point to GDAL's, which says what is wrong.
    found = error.__cause__ or error
    reason = (str(found).splitlines() or [type(found).__name__])[0]
    reason = reason.replace(f"'{path}'", "it is").replace(str(path), "it").rstrip(".")
    advice = ADVICES.get(Path(path).suffix.lower(), "give a GeoTIFF, HGT or VRT file")
    return InputError(path, f"can't be read as a raster ({reason})", advice)

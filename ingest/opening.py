# SPDX-License-Identifier: Apache-2.0
"""What a vector file is, by its first bytes; packed ones unpacked within bounds.

Only the reader that the first bytes name may open a file, so that a disguised one can't
make a library open something else.
"""

import gzip
import io
import json
import re
import tempfile
import zlib
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import BinaryIO, TextIO

from ingest.unpacking import LINE_SUFFIXES, Unpacking, out_of_zip
from ingest.wkt_table import is_table
from tiles.errors import InputError

FORMATS = (
    "GeoPackage, GeoJSON, GeoJSON lines, FlatGeobuf, Shapefile, GeoParquet, OSM,"
    " CSV with WKT, CityJSON or CityGML"
)
_HEAD_BYTES = 65536
_BOM = b"\xef\xbb\xbf"
_FIRST_BYTES = {
    b"\x1f\x8b": "gzip",
    b"PK\x03\x04": "zip",
    b"PK\x05\x06": "zip",
    b"BZh": "bzip2",
    b"\xfd7zXZ": "xz",
    b"\x28\xb5\x2f\xfd": "zstd",
    b"7z\xbc\xaf": "7-Zip",
    b"Rar!": "RAR",
}
_RASTERS = (
    *(b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"),
    *(b"CDF", b"\x89HDF", b"\x89PNG", b"\xff\xd8"),
)
"""First bytes of TIFF, BigTIFF, netCDF, HDF5, PNG and JPEG."""


class Kind(Enum):
    """Which reader a file is for."""

    JSON = "GeoJSON"
    LINES = "GeoJSON lines"
    TABLE = "CSV with WKT"
    OSM = "OSM"
    GDAL = "GeoPackage, FlatGeobuf or Shapefile"
    PARQUET = "GeoParquet"
    MODEL = "CityJSON or CityGML"


@dataclass(frozen=True, slots=True)
class Opening:
    """A file that can be read, and what it is."""

    path: Path
    """as the user named it"""
    place: Path
    """where it lies: the same, or a copy out of a ZIP"""
    kind: Kind
    is_gzip: bool
    closing: ExitStack
    """what is closed and deleted when the reading ends"""

    def text(self) -> BinaryIO:
        """Open as a stream of unpacked bytes, after a byte order mark."""
        if self.is_gzip:
            file: BinaryIO = io.BufferedReader(Unpacking(self.path, self.place), 1 << 20)
        else:
            file = self.place.open("rb")
        self.closing.callback(file.close)
        if file.read(3) != _BOM:
            file.seek(0)
        return file

    def lines(self) -> TextIO:
        """Open as UTF-8, with a mark in place of what is none."""
        text = io.TextIOWrapper(self.text(), "utf-8", errors="replace", newline="")
        self.closing.callback(text.close)
        return text


@contextmanager
def opened(path: Path) -> Iterator[Opening]:
    """Find out what a file is; a copy out of a ZIP is deleted at the end.

    Raises
    ------
    InputError
        When it is nothing that can be read.
    """
    if not path.is_file():
        what = "is a folder" if path.is_dir() else "no such file"
        raise InputError(path, what, "name a file" if path.is_dir() else "check the path")
    with ExitStack() as closing:
        place = path
        if _packing(path) == "zip":
            folder = closing.enter_context(tempfile.TemporaryDirectory(prefix="geopage-"))
            place = out_of_zip(path, Path(folder))
        kind, is_gzip = _recognised(path, place)
        yield Opening(path, place, kind, is_gzip, closing)


def _packing(path: Path) -> str:
    try:
        with path.open("rb") as file:
            head = file.read(8)
    except OSError as error:
        raise InputError(path, f"can't be read ({error})", "check the file") from error
    found = [name for first, name in _FIRST_BYTES.items() if head.startswith(first)]
    return found[0] if found else ""


def _recognised(path: Path, place: Path) -> tuple[Kind, bool]:
    packing = _packing(place)
    if packing not in {"", "gzip"}:
        raise InputError(path, f"a {packing} file", "unpack it first")
    is_gzip = packing == "gzip"
    try:
        with gzip.open(place) if is_gzip else place.open("rb") as file:
            head = file.read(_HEAD_BYTES)
    except (OSError, EOFError, zlib.error) as error:
        raise InputError(path, f"can't be read ({error})", "check the file") from error
    if not head.strip():
        raise InputError(path, "empty file", "check how it was made")
    kind = _kind(place, head)
    if kind is None:
        if head.startswith(_RASTERS):
            advice = "use `geopage ingest terrain` or `geopage ingest imagery`"
            raise InputError(path, "a raster, not footprints", advice)
        packed = "gzip of what is " if is_gzip else ""
        what = f"{packed}not a {FORMATS} file"
        raise InputError(path, what, "convert it, as with ogr2ogr")
    if is_gzip and (kind in {Kind.GDAL, Kind.PARQUET} or _is_pbf(head)):
        raise InputError(path, f"a gzip of {kind.value}", "unpack it first")
    return kind, is_gzip


def _kind(place: Path, head: bytes) -> Kind | None:
    text = head.removeprefix(_BOM).lstrip()
    # It needs what reads it, which begins with this module.
    from ingest.city_models import is_city_model  # noqa: PLC0415

    found = None
    geopackage = head.startswith(b"SQLite format 3\0") and head[68:70] == b"GP"
    if geopackage or head.startswith((b"fgb\x03", b"\x00\x00\x27\x0a")):
        found = Kind.GDAL
    elif head.startswith(b"PAR1"):
        found = Kind.PARQUET
    elif _is_pbf(head) or _is_osm_xml(text):
        found = Kind.OSM
    elif is_city_model(head, place.name):
        found = Kind.MODEL
    elif text.startswith((b"{", b"\x1e")):
        found = Kind.LINES if _is_lines(place, text) else Kind.JSON
    elif not text.startswith(b"<") and is_table(place.name, text):
        found = Kind.TABLE
    return found


def _is_pbf(head: bytes) -> bool:
    """Tell whether a length and the blob type OSMHeader come first."""
    return head[4:15] == b"\x0a\x09OSMHeader"


def _is_osm_xml(text: bytes) -> bool:
    """Tell whether the root is <osm>, and nothing is there that GDAL takes for a VRT."""
    start = re.match(rb"(<\?xml[^>]*\?>\s*)?(<!--.*?-->\s*)*<osm[\s>]", text, re.DOTALL)
    return start is not None and b"<OGRVRT" not in text


def _is_lines(place: Path, text: bytes) -> bool:
    """Tell whether JSON text is one feature a line."""
    suffixes = {suffix.lower() for suffix in place.suffixes}
    if text.startswith(b"\x1e") or suffixes & LINE_SUFFIXES:
        return True
    first, newline, rest = text.partition(b"\n")
    if not newline or not rest.lstrip().startswith(b"{"):
        return False
    try:
        return bool(json.loads(first).get("type") == "Feature")
    except (ValueError, AttributeError, RecursionError):
        return False

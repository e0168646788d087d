# SPDX-License-Identifier: Apache-2.0
"""Packed vector files unpacked: gzip as a stream, ZIP as a copy, both within bounds."""

import gzip
import io
import shutil
import zipfile
import zlib
from pathlib import Path

from tiles.errors import InputError

MAX_RATIO = 300
SLACK_BYTES = 64 << 20
"""A file that unpacks to more than so many times its size, and this, is a bomb."""
LINE_SUFFIXES = {".geojsonl", ".geojsons", ".geojsonseq", ".jsonl", ".ndjson", ".json-seq"}
_BINARY = {".gpkg", ".shp", ".fgb", ".parquet", ".geoparquet", ".pbf"}
_TEXT = {".geojson", ".json", ".csv", ".tsv", ".osm", ".gml"} | LINE_SUFFIXES
_SIDECARS = {".shx", ".dbf", ".prj", ".cpg"}


class Unpacking(io.RawIOBase):
    """A gzip stream that ends in one line, also where it is broken or a bomb."""

    def __init__(self, path: Path, place: Path) -> None:
        self._path, self._file = path, gzip.open(place)  # noqa: SIM115 - closed in close
        self._left_bytes = MAX_RATIO * place.stat().st_size + SLACK_BYTES

    def readable(self) -> bool:
        """Say that it can be read."""
        return True

    def seekable(self) -> bool:
        """Say that it can go back."""
        return True

    def seek(self, offset: int, whence: int = 0) -> int:
        """Go to a place in the unpacked bytes."""
        return self._file.seek(offset, whence)

    def readinto(self, buffer: "memoryview") -> int:  # type: ignore[override]
        """Read and count."""
        try:
            count = self._file.readinto(buffer)
        except (OSError, EOFError, zlib.error) as error:
            raise InputError(
                self._path, f"can't be read ({error})", "check the file"
            ) from error
        self._left_bytes -= count
        if self._left_bytes < 0:
            raise _bomb(self._path)
        return int(count)

    def close(self) -> None:
        """Close the packed file too."""
        self._file.close()
        super().close()


def _bomb(path: Path) -> InputError:
    reason = f"unpacks to more than {MAX_RATIO} times its size"
    return InputError(path, reason, "unpack it yourself if you trust it")


def out_of_zip(path: Path, folder: Path) -> Path:
    """Copy the one vector file in a ZIP, with what belongs to it, into a folder."""
    try:
        with zipfile.ZipFile(path) as archive:
            inside = [one for one in archive.infolist() if _is_file(one)]
            chosen = _only_vector(path, [Path(one.filename) for one in inside])
            stem = chosen.with_suffix("")
            place = folder / f"file{''.join(chosen.suffixes[-2:]).lower()}"
            wanted = {chosen: place} | {
                Path(one.filename): folder / f"file{Path(one.filename).suffix.lower()}"
                for one in inside
                if Path(one.filename).with_suffix("") == stem
                and Path(one.filename).suffix.lower() in _SIDECARS
            }
            members = [one for one in inside if Path(one.filename) in wanted]
            size = sum(one.file_size for one in members)
            if size > MAX_RATIO * path.stat().st_size + SLACK_BYTES:
                raise _bomb(path)
            if size > shutil.disk_usage(folder).free:
                raise InputError(path, f"unpacks to {size:,} bytes", "make room for it")
            for one in members:
                _copy(path, archive, one, wanted[Path(one.filename)])
    except (zipfile.BadZipFile, OSError, EOFError, zlib.error) as error:
        raise InputError(path, f"broken ZIP ({error})", "check the file") from error
    except (RuntimeError, NotImplementedError) as error:  # a password, an odd method
        raise InputError(path, f"can't be read ({error})", "unpack it first") from error
    return place


def _is_file(one: zipfile.ZipInfo) -> bool:
    name = Path(one.filename)
    return not (one.is_dir() or "__MACOSX" in name.parts or name.name.startswith("."))


def _only_vector(path: Path, names: list[Path]) -> Path:
    found = [name for name in names if name.suffix.lower() in _BINARY | _TEXT]
    if len(found) == 1:
        return found[0]
    reason = "a ZIP file without a vector file in it"
    if found:
        listed = ", ".join(str(name) for name in found[:5])
        reason = f"a ZIP file with {len(found)} vector files in it ({listed[:200]})"
    raise InputError(path, reason, "unpack it and name the file inside")


def _copy(path: Path, archive: zipfile.ZipFile, one: zipfile.ZipInfo, place: Path) -> None:
    left = one.file_size
    with archive.open(one) as source, place.open("wb") as target:
        while block := source.read(1 << 20):
            left -= len(block)
            if left < 0:
                raise _bomb(path)
            target.write(block)

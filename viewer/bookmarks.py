# SPDX-License-Identifier: Apache-2.0
"""Places to come back to, kept beside the store or else in the user's own folder."""

import math
import os
import sys
from pathlib import Path

import msgspec

from tiles.errors import InputError
from viewer.camera import Pose

ADVICE = "correct it, or delete it to begin anew"


class Bookmark(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A pose with a name; height above the ellipsoid."""

    name: str
    lat_deg: float
    lon_deg: float
    height_m: float
    heading_deg: float
    pitch_deg: float

    def pose(self) -> Pose:
        """Return where it leads."""
        lon, lat = math.radians(self.lon_deg), math.radians(self.lat_deg)
        turned = math.radians(self.heading_deg), math.radians(self.pitch_deg)
        return Pose(lon, lat, self.height_m, *turned)


def bookmark_of(name: str, pose: Pose) -> Bookmark:
    """Return a bookmark of a pose."""
    place = math.degrees(pose.lat_rad), math.degrees(pose.lon_rad), pose.height_m
    turned = math.degrees(pose.heading_rad), math.degrees(pose.pitch_rad)
    return Bookmark(name, *place, *turned)


def files_of(store: Path) -> tuple[Path, Path]:
    """Return where bookmarks of a store may be: beside it, and in the user's folder."""
    name = f"{store.name}.bookmarks.json"
    home = Path.home()
    folders = {
        "win32": os.environ.get("APPDATA") or home / "AppData" / "Roaming",
        "darwin": home / "Library" / "Application Support",
    }
    default = os.environ.get("XDG_CONFIG_HOME") or home / ".config"
    folder = Path(folders.get(sys.platform, default))
    return store.with_name(name), folder / "geopage" / name


def read_bookmarks(store: Path) -> list[Bookmark]:
    """Return a store's bookmarks, none where there is no file.

    Raises
    ------
    InputError
    """
    for file in files_of(store):
        try:
            return msgspec.json.decode(file.read_bytes(), type=list[Bookmark])
        except OSError:
            continue
        except (msgspec.DecodeError, UnicodeDecodeError) as error:
            raise InputError(file, str(error), ADVICE) from error
    return []


def write_bookmarks(store: Path, bookmarks: list[Bookmark]) -> Path:
    """Keep a store's bookmarks, and return in which file.

    Raises
    ------
    InputError
    """
    text = msgspec.json.format(msgspec.json.encode(bookmarks))
    failed: OSError | None = None
    for file in files_of(store):
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(text + b"\n")
        except OSError as error:
            failed = error
        else:
            return file
    reason = str(failed.strerror if failed else "")
    raise InputError(file, reason, "make one of the folders writable")

# SPDX-License-Identifier: Apache-2.0
"""The camera path of a recorded flight or session: its frames.csv."""

import csv
from pathlib import Path

import msgspec

from tiles.errors import InputError
from viewer.camera_path import CameraPath, Keyframe, PathFile, checked, read_path

ADVICE = "name a frames.csv of `geopage fly` or of a recorded session"


def read_flight(file: Path) -> CameraPath:
    """Read a camera path, or the one that a table of frames was flown along.

    Raises
    ------
    InputError
        Naming the file and the first thing that is wrong.
    """
    if file.suffix.lower() != ".csv":
        return read_path(file)
    try:
        with file.open(newline="") as lines:
            rows = list(csv.DictReader(lines))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(file, str(error), ADVICE) from error
    names = Keyframe.__struct_fields__
    missing = [name for name in names if rows and rows[0].get(name) is None]
    if missing or not rows:
        reason = f"has no column {missing[0]}" if missing else "holds no frames"
        raise InputError(file, reason, ADVICE)
    try:
        frames = [
            msgspec.convert({name: row[name] for name in names}, Keyframe, strict=False)
            for row in rows
        ]
    except msgspec.ValidationError as error:
        raise InputError(file, str(error), ADVICE) from error
    last_s = frames[-1].t_s
    return checked(file, PathFile(file.stem, last_s, "ellipsoid", "linear", frames))

# SPDX-License-Identifier: Apache-2.0
"""Names for new files."""

from itertools import count
from pathlib import Path


def free_name(folder: Path, stem: str, suffix: str) -> Path:
    """Return a name that no file in a folder has: STEM-1, STEM-2, ..."""
    for number in count(1):
        file = folder / f"{stem}-{number}{suffix}"
        if not file.exists():
            break
    return file

# SPDX-License-Identifier: Apache-2.0
"""What a source is called when nobody says: as its file, and when that hides another."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

INNER = {".city", ".geojson", ".gml", ".hgt", ".json", ".jsonl", ".osm", ".tif"}
"""What stands before the last ending of names like N43E007.hgt.zip"""


def name_of(path: str | Path) -> str:
    """Return a file's name without its endings; other dots stay."""
    name = Path(Path(path).name).with_suffix("")
    while name.suffix.lower() in INNER:
        name = name.with_suffix("")
    return str(name)


def replaced(
    before: Mapping[str, Mapping[str, Any]], new: Mapping[str, Iterable[str]]
) -> list[str]:
    """Warn of sources that take the place of others made from other files.

    Parameters
    ----------
    before : by name, the sources of the store
    new : by name, the files that it is made from now
    """
    found = []
    for name, files in new.items():
        old = before.get(name, {})
        had = [str(old["path"])] if "path" in old else list(old.get("files", ()))
        if had and sorted(had) != sorted(files):
            told = ", ".join(had)
            found.append(f"{name}: takes the place of {told}; --name would keep both")
    return found

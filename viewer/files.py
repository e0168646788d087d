# SPDX-License-Identifier: Apache-2.0
"""New files: their names, and tables that say where they were measured."""

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from itertools import count
from pathlib import Path


def free_name(folder: Path, stem: str, suffix: str) -> Path:
    """Return a name that no file in a folder has: STEM-1, STEM-2, ..."""
    for number in count(1):
        file = folder / f"{stem}-{number}{suffix}"
        if not file.exists():
            break
    return file


def csv_text(
    about: Mapping[str, object], head: Sequence[str], rows: Iterable[Sequence[object]]
) -> str:
    """Return a table of figures, after comment lines that say where it was measured."""
    text = io.StringIO()
    for key, value in about.items():
        text.write(f"# {key.replace('_', ' ')}: {value}\n")
    table = csv.writer(text, lineterminator="\n")
    table.writerow(head)
    table.writerows(rows)
    return text.getvalue()

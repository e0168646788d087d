# SPDX-License-Identifier: Apache-2.0
"""A whole vector file at once, for tests."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ingest.footprints import Footprints, read_parts
from ingest.raw_features import objects


def read_footprints(
    path: str | Path, layer: str | None = None, crs: str | None = None
) -> Footprints:
    """All parts of a file as one."""
    parts = list(read_parts(path, layer, crs))
    names = dict.fromkeys(name for part in parts for name in part.columns)
    return replace(
        parts[0],
        feature=np.concatenate([part.feature for part in parts]),
        geometry=np.concatenate([part.geometry for part in parts]),
        columns={name: _joined_column(parts, name) for name in names},
        warnings=tuple(dict.fromkeys(text for part in parts for text in part.warnings)),
        unreadable=tuple(one for part in parts for one in part.unreadable),
    )


def _joined_column(parts: list[Footprints], name: str) -> NDArray[Any]:
    return np.concatenate(
        [part.columns.get(name, objects([None] * len(part.feature))) for part in parts]
    )

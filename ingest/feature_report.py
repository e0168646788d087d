# SPDX-License-Identifier: Apache-2.0
"""`--report OUT.gpkg`: features to look at, to open in QGIS."""

import os
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
import pyogrio.errors
import pyogrio.raw

from tiles.errors import InputError

LAYER = "features_to_look_at"
TOGETHER = 20_000
"""Rows that are written at once; no more than these stay in memory."""
_COLUMNS = ["source", "file", "feature", "remark"]


class FeatureReport:
    """A GeoPackage that is written as features come, and named when all are there.

    Used in a `with`: whatever goes wrong inside, an older file of this name stays.
    """

    def __init__(self, path: Path) -> None:
        """Take the name of the file to make.

        Raises
        ------
        InputError
        """
        if path.suffix != ".gpkg" or not path.parent.is_dir():
            advice = "name a .gpkg file in a folder that exists"
            raise InputError(path, "can't be written", advice)
        self._path = path
        self._new = path.with_name(f".{os.getpid()}.{path.name}")
        self._rows: list[tuple[str, str, int, str, bytes | None]] = []

    def add(
        self,
        source: str,
        file: str,
        feature: Sequence[int],
        remark: Sequence[str],
        wkb: Sequence[bytes | None],
    ) -> None:
        """List features of one file, each with why it is to be looked at."""
        rows = zip(feature, remark, wkb, strict=True)
        self._rows += [(source, file, *row) for row in rows]
        if len(self._rows) >= TOGETHER:
            self._write()

    def _write(self) -> None:
        columns = [list(column) for column in zip(*self._rows, strict=True)] or [[]] * 5
        self._rows = []
        source, file, feature, words, shape = columns
        fields = [
            np.array(source, object),
            np.array(file, object),
            np.array(feature, np.int64),
            np.array(words, object),
        ]
        try:
            pyogrio.raw.write(
                self._new,
                np.array(shape, object),
                fields,
                _COLUMNS,
                layer=LAYER,
                driver="GPKG",
                geometry_type="Unknown",
                crs="EPSG:4326",
                append=self._new.exists(),
            )
        except (pyogrio.errors.DataSourceError, OSError) as error:
            reason = f"can't be written ({error})"
            raise InputError(self._path, reason, "choose another place") from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        try:
            if kind is None:
                if self._rows or not self._new.exists():
                    self._write()
                self._new.replace(self._path)
        finally:
            self._new.unlink(missing_ok=True)

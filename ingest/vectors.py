# SPDX-License-Identifier: Apache-2.0
"""GeoPackage, FlatGeobuf, Shapefile and OSM through GDAL, some thousand features a time."""

import logging
import re
import warnings
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import pyogrio.errors
import pyogrio.raw
import shapely

from ingest.raw_features import (
    Geometries,
    RawFeatures,
    RawLayer,
    no_polygons,
    objects,
    unreadable,
)
from ingest.rings import HEIGHTS_DROPPED
from tiles.errors import InputError

LATIN = "text that is no UTF-8 was taken as ISO-8859-1"
_BUILDINGS = re.compile("build|footprint|house|geb(ae|ä)ude|batiment|edific", re.IGNORECASE)
_POLYGONAL = ("Polygon", "Surface", "Unknown", "GeometryCollection")
_FEATURE_ERRORS = (pyogrio.errors.FeatureError, pyogrio.errors.GeometryError)
_MAX_BROKEN = 50
"""So many features are found one by one; a file with more of them is broken itself."""
_LATIN_1 = "ISO-8859-1"
READ_ERRORS = (
    pyogrio.errors.DataSourceError,
    pyogrio.errors.DataLayerError,
    pyogrio.errors.FeatureError,
    pyogrio.errors.FieldError,
    pyogrio.errors.GeometryError,
    UnicodeError,
    ValueError,
    RuntimeError,
)
# Reports reach the user through InputError and the ingest report, not as log lines.
logging.getLogger("pyogrio").setLevel(logging.CRITICAL)


def gdal_layer(path: Path, place: str, layer: str | None, at_most: int) -> RawLayer:
    """Open a layer of a file whose first bytes were looked at.

    Parameters
    ----------
    path : named in errors
    place : what to hand to GDAL
    layer : by default the first one that can hold polygons, rather one called buildings
    at_most : features in a part
    """
    with warnings.catch_warnings(action="ignore"):  # the parts say it again
        name, notes = _choose_layer(path, place, layer)
        try:
            info = pyogrio.read_info(place, layer=name)
        except READ_ERRORS as error:
            raise unreadable(path, error) from error
    if info["geometry_type"] is None:
        raise no_polygons(path, f"layer {name} has no geometry")
    return RawLayer(name, info["crs"], _parts(path, place, name, at_most), notes)


def _choose_layer(path: Path, place: str, layer: str | None) -> tuple[str, list[str]]:
    try:
        found = [(str(name), str(kind)) for name, kind in pyogrio.list_layers(place)]
    except READ_ERRORS as error:
        raise unreadable(path, error) from error
    names = [name for name, _ in found]
    if layer is not None and layer not in names:
        known = ", ".join(names[:10])
        raise InputError(path, f"no layer named {layer}", f"the layers are: {known}")
    fitting = [name for name, kind in found if any(word in kind for word in _POLYGONAL)]
    if layer is not None:
        return layer, []
    if not found:
        raise unreadable(path, "no layers")
    if not fitting:
        raise no_polygons(path, ", ".join(sorted({kind for _, kind in found})))
    called = [name for name in fitting if _BUILDINGS.search(name)]
    chosen = (called or fitting)[0]
    listed = ", ".join(fitting)[:200]
    others = [f"{path.name}: took layer {chosen} of {listed} (--layer)"]
    return chosen, others if len(fitting) > 1 else []


def _parts(path: Path, place: str, layer: str, at_most: int) -> Iterator[RawFeatures]:
    reader = _Reader(path, place, layer)
    first, count = 0, at_most
    while count == at_most:
        count = 0
        for part in reader.some(first, at_most):
            count += len(part.feature) + len(part.unreadable)
            yield part
        first += count


class _Reader:
    """Reads ranges of features; a range that can't be read is halved until one is left."""

    def __init__(self, path: Path, place: str, layer: str) -> None:
        self._path, self._place, self._layer = path, place, layer
        self._encoding: str | None = None
        self._broken = 0

    def some(self, first: int, count: int) -> list[RawFeatures]:
        try:
            return [self._read(first, count)]
        except _FEATURE_ERRORS as error:
            self._broken += count == 1
            if self._broken > _MAX_BROKEN:
                where = f"more than {_MAX_BROKEN} broken features up to {first:,}"
                raise unreadable(self._path, f"{where}: {error}") from error
            if count == 1:
                return [self._bad(first)]
        except READ_ERRORS as error:
            where = f"after {first:,} features: " if first else ""
            raise unreadable(self._path, f"{where}{error}") from error
        half = count // 2
        return [*self.some(first, half), *self.some(first + half, count - half)]

    def _read(self, first: int, count: int, **options: Any) -> RawFeatures:
        options |= {"skip_features": first, "max_features": count, "layer": self._layer}
        try:
            read = gdal_read(self._place, encoding=self._encoding, **options)
        except UnicodeDecodeError:
            if self._encoding is not None:
                raise
            self._encoding = _LATIN_1
            return self._read(first, count, **options)
        return replace(read, notes=(*read.notes, LATIN)) if self._encoding else read

    def _bad(self, first: int) -> RawFeatures:
        """List one feature, by the number that its other columns have."""
        try:
            _, number, _, _ = pyogrio.raw.read(
                self._place,
                layer=self._layer,
                read_geometry=False,
                return_fids=True,
                skip_features=first,
                max_features=1,
            )
            name = int(number[0])
        except (*READ_ERRORS, IndexError):
            name = first
        none = np.zeros(0, np.int64)
        return RawFeatures(none, objects([]), {}, ((name, "broken geometry"),))


def gdal_read(place: str, **options: Any) -> RawFeatures:
    """Read features with what GDAL warned of; raises one of READ_ERRORS."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        meta, fids, wkb, values = pyogrio.raw.read(
            place, return_fids=True, datetime_as_string=True, **options
        )
    if wkb is None:
        raise ValueError("no geometry")
    notes = sorted({" ".join(str(warning.message).split()) for warning in caught})
    columns = dict(zip(meta["fields"].tolist(), values, strict=True))
    return from_wkb(fids.astype(np.int64), wkb, columns, tuple(notes))


def from_wkb(
    feature: "np.ndarray[Any, np.dtype[np.int64]]",
    wkb: Geometries,
    columns: dict[str, Any],
    notes: tuple[str, ...] = (),
) -> RawFeatures:
    """Make geometries of WKB, and list the features where it is none."""
    geometry = np.asarray(shapely.from_wkb(wkb, on_invalid="fix"), object)
    bad = shapely.is_missing(geometry) & np.array([one is not None for one in wkb], bool)
    if shapely.has_z(geometry).any():
        notes = (*notes, HEIGHTS_DROPPED)
    if not bad.any():
        return RawFeatures(feature, geometry, columns, (), notes)
    listed = tuple((int(k), "broken geometry") for k in feature[bad])
    kept = {name: values[~bad] for name, values in columns.items()}
    return RawFeatures(feature[~bad], geometry[~bad], kept, listed, notes)

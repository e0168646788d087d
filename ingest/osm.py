# SPDX-License-Identifier: Apache-2.0
"""Buildings and parts of buildings of an OpenStreetMap file, PBF or XML.

GDAL puts ways and multipolygon relations together. A feature's number is the id of its
way, or minus the id of its relation.
"""

import tempfile
from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np

from ingest.attribute_columns import columns_of
from ingest.raw_features import RawFeatures, RawLayer, unreadable
from ingest.rings import RINGS_CLOSED
from ingest.vectors import READ_ERRORS, gdal_read
from tiles.errors import InputError

_LAYER = "multipolygons"
_KEYS = ("building", "building:part")
_WHERE = " OR ".join(f'("{key}" IS NOT NULL AND "{key}" <> \'no\')' for key in _KEYS)
_CONFIG = """\
closed_ways_are_polygons=building,building:part
attribute_name_laundering=no
tags_format=json
[multipolygons]
osm_id=yes
attributes=building,building:part
other_tags=yes
"""


MAX_BUILDINGS = 4_000_000
"""They are in memory together, about 1 kB each."""


def osm_layer(path: Path, place: str, layer: str | None, at_most: int) -> RawLayer:
    """Open the areas of an OSM file that are buildings.

    Parameters
    ----------
    path : named in errors
    place : what to hand to GDAL
    layer : None, or the only one that fits
    at_most : features in a part
    """
    if layer not in {None, _LAYER}:
        raise InputError(path, f"no layer named {layer}", f"the layer is: {_LAYER}")
    return RawLayer(_LAYER, "EPSG:4326", _parts(path, place, at_most))


def _parts(path: Path, place: str, at_most: int) -> Iterator[RawFeatures]:
    """Read in one pass, then give parts.

    A pass that begins later is no way: GDAL puts the whole file together again for it.
    Nor is a stream of Arrow batches: it ends without a word where the file is cut off.
    """
    with tempfile.TemporaryDirectory(prefix="geopage-") as folder:
        config = Path(folder) / "osmconf.ini"
        config.write_text(_CONFIG, encoding="utf-8")
        options = {"layer": _LAYER, "where": _WHERE, "CONFIG_FILE": str(config)}
        try:
            read = gdal_read(place, max_features=MAX_BUILDINGS + 1, **options)
        except READ_ERRORS as error:
            raise unreadable(path, error) from error
    count = len(read.feature) + len(read.unreadable)
    if not count:
        raise InputError(path, "no area is tagged building", "name another file")
    if count > MAX_BUILDINGS:
        raise InputError(
            path, f"more than {MAX_BUILDINGS:,} buildings", "cut it, or convert it to .gpkg"
        )
    for first in range(0, max(len(read.feature), 1), at_most):
        yield _part(read, slice(first, first + at_most))


def _part(read: RawFeatures, rows: slice) -> RawFeatures:
    columns = {name: values[rows] for name, values in read.columns.items()}
    relation = np.array([one is not None for one in columns["osm_id"]], bool)
    feature = np.where(relation, -read.feature[rows], read.feature[rows])
    tags = [msgspec.json.decode(text or "{}") for text in columns["other_tags"]]
    for key in _KEYS:
        for tag, value in zip(tags, columns[key], strict=True):
            if value is not None:
                tag[key] = value
    kinds = np.where(relation, "relation/", "way/")
    for tag, kind, number in zip(tags, kinds, np.abs(feature), strict=True):
        tag["osm_id"] = f"{kind}{number}"
    first = rows.start == 0
    return RawFeatures(
        feature,
        read.geometry[rows],
        columns_of(tags),
        read.unreadable if first else (),
        (RINGS_CLOSED,)
        if first and any("closed ring" in one for one in read.notes)
        else (),
    )

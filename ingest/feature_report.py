# SPDX-License-Identifier: Apache-2.0
"""`--report OUT.gpkg`: features to look at, to open in QGIS."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyogrio.errors
import pyogrio.raw
import shapely

from ingest.features import Features
from tiles.errors import InputError
from tiles.frames import Ints

LAYER = "features_to_look_at"


def write_feature_report(
    path: Path,
    features: Mapping[str, Features],
    ids: Mapping[str, Ints],
    noted: Mapping[str, Ints],
) -> None:
    """Write what was skipped, merged or repaired, and what floats or is sunk.

    Parameters
    ----------
    path : GeoPackage to write; an older one is replaced
    features : by name of the source
    ids : object ids of each source's stored features
    noted : object ids by remark, such as "floating"
    """
    rows: list[tuple[str, str, int, str, object]] = []
    for name, one in features.items():
        remarks = _remarks(one, ids[name], noted)
        for k, remark in remarks:
            shape = one.original[k] if one.polygon[k] is None else one.polygon[k]
            file = one.files[one.file[k]].path.name
            rows.append((name, file, int(one.feature[k]), remark, shape))
    columns = [list(column) for column in zip(*rows, strict=True)] or [[]] * 5
    source, file, feature, words, shape = columns
    path.unlink(missing_ok=True)
    try:
        pyogrio.raw.write(
            path,
            shapely.to_wkb(np.array(shape, object)),
            [np.array(column, object) for column in (source, file)]
            + [np.array(feature, np.int64), np.array(words, object)],
            ["source", "file", "feature", "remark"],
            layer=LAYER,
            driver="GPKG",
            geometry_type="Unknown",
            crs="EPSG:4326",
        )
    except (pyogrio.errors.DataSourceError, OSError) as error:
        raise InputError(
            path, f"can't be written ({error})", "choose another place"
        ) from error


def _remarks(
    features: Features, ids: Ints, noted: Mapping[str, Ints]
) -> list[tuple[int, str]]:
    """Return (feature, remark) pairs; a feature can have several."""
    found = [
        (int(k), str(features.reason[k])) for k in np.flatnonzero(features.reason != "")
    ]
    kept = features.kept
    found += [(int(k), "repaired") for k in kept[features.was_repaired[kept]]]
    for remark, objects in noted.items():
        found += [(int(k), remark) for k in kept[np.isin(ids, objects)]]
    return found

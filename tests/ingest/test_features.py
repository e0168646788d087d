# SPDX-License-Identifier: Apache-2.0
"""Heights and dimensions of city models' features, before they are stored."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from ingest.city_models import read_city_model
from ingest.features import DEFAULT, FROM_GEOMETRY, Features, features_of, packed
from ingest.footprints import Footprints
from ingest.heights import HeightRules
from tests.ingest.city_samples import box, document, gable, write


def made(tmp_path: Path, whole: dict[str, Any], **named: str) -> Features:
    (part,) = read_city_model(write(tmp_path / "a.json", whole))
    return features_of((packed(part), HeightRules(**named)))


def two_houses() -> dict[str, Any]:
    """Return a plain one, 4 m high, and one with a roof, 9 m, with other attributes."""
    whole = document(box(10, 8, 4), gable())
    for one in whole["CityObjects"].values():
        one["attributes"] = {"measuredHeight": 30.0, "storeysAboveGround": 5}
    return whole


def test_the_geometry_says_the_height_whatever_the_attributes_say(tmp_path: Path) -> None:
    found = made(tmp_path, two_houses())
    assert [one is None for one in found.rows.solid] == [True, False]
    assert found.rows.height_m == pytest.approx([4.0, 9.0])
    assert ((found.how & FROM_GEOMETRY) > 0).all()
    assert not (found.how & 0b111).any()


@pytest.mark.parametrize(
    ("named", "height_m"),
    [({"height": "measuredHeight"}, 30.0), ({"levels": "storeysAboveGround"}, 30.0)],
)
def test_a_named_field_says_the_height_of_prisms_only(
    tmp_path: Path, named: dict[str, str], height_m: float
) -> None:
    found = made(tmp_path, two_houses(), **named)
    assert found.rows.height_m == pytest.approx([height_m, 9.0])
    assert ((found.how & FROM_GEOMETRY) > 0).tolist() == [False, True]


def test_a_named_field_without_a_value_leaves_the_height_to_the_geometry(
    tmp_path: Path,
) -> None:
    whole = two_houses()
    whole["CityObjects"]["b0"]["attributes"] = {"hoch": "?"}
    found = made(tmp_path, whole, height="hoch")
    assert found.rows.height_m == pytest.approx([4.0, 9.0])
    assert not (found.how & DEFAULT).any()


def test_a_dimension_holds_the_roofs_that_overhang(tmp_path: Path) -> None:
    whole = document(gable(), box(14, 8, 1).moved(-2, 0, 6))
    roof = whole["CityObjects"].pop("b1")["geometry"][0]
    del roof["semantics"]
    whole["CityObjects"]["b0"]["geometry"].append(roof)
    found = made(tmp_path, whole)
    assert found.rows.dimension_m >= 14 * 0.999


def rolled(shape: shapely.Geometry) -> shapely.Geometry:
    """The same footprint, its rings and parts in another order, begun elsewhere."""
    if isinstance(shape, shapely.MultiPolygon):
        return shapely.MultiPolygon([rolled(part) for part in shape.geoms][::-1])
    shell, *holes = (np.roll(ring.coords[:-1], 1, axis=0) for ring in rings_of(shape))
    return shapely.Polygon(shell, holes[::-1])


def rings_of(shape: shapely.Geometry) -> list[shapely.LinearRing]:
    return [shape.exterior, *shape.interiors]


def outlines() -> tuple[Footprints, Footprints]:
    """Boxes, one with holes and one in two parts, and the same again."""
    rng = np.random.default_rng(1)
    box = shapely.box(*rng.uniform(0, 1e-3, (2, 50)), *rng.uniform(2e-3, 3e-3, (2, 50)))
    yards = shapely.box((1.1e-3, 1.5e-3), 1.1e-3, (1.3e-3, 1.7e-3), 1.3e-3)
    box[3] = shapely.difference(box[3], shapely.union_all(yards))
    box[7] = shapely.MultiPolygon([box[7], shapely.box(0.01, 0, 0.02, 0.01)])
    again = np.array([rolled(one) for one in box], object)
    return footprints(box), footprints(again[::-1])


def footprints(geometry: np.ndarray) -> Footprints:
    number = np.arange(len(geometry))
    return Footprints(Path("a.shp"), "a", "EPSG:4326", number, geometry, {}, ())


def test_a_footprint_has_one_digest_wherever_its_rings_begin() -> None:
    one, other = (features_of((packed(part), HeightRules())) for part in outlines())
    assert len(np.unique(one.digest, axis=0)) == len(one.feature) == 50
    assert np.array_equal(one.digest, other.digest[::-1])

# SPDX-License-Identifier: Apache-2.0
"""Repair: what comes out can be built on, what does not says why."""

import numpy as np
import pyproj
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from ingest.repair import MAX_VERTICES, area_m2, metres_per_degree, repair, size_m

DEGREE_M = 111_194.0


def near(*ring: tuple[float, float]) -> list[tuple[float, float]]:
    """A ring in metres around longitude 10, latitude 0.1."""
    return [(10 + x / DEGREE_M, 0.1 + y / DEGREE_M) for x, y in ring]


def shapes(*found: shapely.Geometry | None) -> np.ndarray:
    array = np.empty(len(found), object)
    array[:] = found
    return array


def odd(x: float) -> shapely.Geometry:
    """A ring with a coordinate that is no finite number, as a file can hold it."""
    with np.errstate(invalid="ignore"):
        return shapely.Polygon([*SQUARE, (x, 0.1)])


SQUARE = near((0, 0), (20, 0), (20, 20), (0, 20))


def test_a_bow_tie_becomes_its_two_triangles() -> None:
    found = repair(shapes(shapely.Polygon(near((0, 0), (20, 20), (20, 0), (0, 20)))))
    assert found.was_repaired[0]
    assert found.polygon[0].geom_type == "MultiPolygon"
    assert area_m2(found.polygon)[0] == pytest.approx(200, rel=0.01)


def test_a_spike_across_itself_and_a_hole_outside_are_repaired() -> None:
    spike = shapely.Polygon(near((0, 0), (20, 0), (60, 0), (20, 0), (20, 20), (0, 20)))
    outside = shapely.Polygon(SQUARE, [near((30, 30), (35, 30), (35, 35))])
    found = repair(shapes(spike, outside))
    assert found.reason.tolist() == ["", ""]
    assert found.was_repaired.all()
    assert shapely.is_valid(found.polygon).all()
    assert area_m2(found.polygon) == pytest.approx([400, 400], rel=0.01)


def test_holes_that_cross_their_shell_or_each_other_are_taken_out_of_it() -> None:
    across = near((10, -5), (30, -5), (30, 25), (10, 25))
    twice = shapely.Polygon(SQUARE, [across, near((5, 5), (15, 5), (15, 15), (5, 15))])
    all_of_it = shapely.Polygon(SQUARE, [SQUARE])
    apart = shapely.MultiPolygon([twice, shapely.Polygon(near((50, 0), (60, 0), (60, 10)))])
    found = repair(shapes(twice, all_of_it, apart))
    assert found.reason.tolist() == ["", "no area left after repair", ""]
    assert area_m2(found.polygon)[[0, 2]] == pytest.approx([150, 200], rel=0.01)


def test_the_polygons_of_a_collection_are_kept_as_one_object() -> None:
    far = shapely.Polygon(near((30, 0), (40, 0), (40, 10), (30, 10)))
    mixed = shapely.GeometryCollection(
        [shapely.Polygon(SQUARE), shapely.Point(10, 0.1), shapely.GeometryCollection([far])]
    )
    found = repair(shapes(mixed))
    assert area_m2(found.polygon)[0] == pytest.approx(500, rel=0.01)
    assert shapely.get_num_geometries(found.polygon[0]) == 2


def test_a_valid_polygon_is_not_called_repaired_and_loses_its_third_coordinate() -> None:
    solid = shapely.force_3d(shapely.Polygon(SQUARE), 7.0)
    found = repair(shapes(solid))
    assert not found.was_repaired[0]
    assert not shapely.has_z(found.polygon[0])
    assert found.polygon[0].equals(shapely.Polygon(SQUARE))


@pytest.mark.parametrize(
    ("shape", "reason"),
    [
        (None, "no geometry"),
        (shapely.Polygon(), "no geometry"),
        (shapely.Point(10, 0.1), "not a polygon"),
        (shapely.LineString(SQUARE), "not a polygon"),
        (
            odd(np.nan),
            "coordinates that are no finite numbers",
        ),
        (
            odd(np.inf),
            "coordinates that are no finite numbers",
        ),
        (shapely.box(10, 90, 10.0001, 90.0001), "outside longitude +-360, latitude +-90"),
        (shapely.Polygon(near((0, 0), (20, 0), (40, 0))), "no area left after repair"),
        (shapely.Polygon(near((0, 0), (0.5, 0), (0.5, 0.5))), "smaller than 0.5 m2"),
        (shapely.box(10, 0, 10.05, 0.001), "wider than 5 km"),
    ],
)
def test_what_can_not_be_built_on_says_why(
    shape: shapely.Geometry | None, reason: str
) -> None:
    found = repair(shapes(shape, shapely.Polygon(SQUARE)))
    assert found.reason.tolist() == [reason, ""]
    assert found.polygon[0] is None
    assert found.polygon[1] is not None


def test_a_footprint_of_too_many_corners_is_simplified_by_little() -> None:
    angle = np.linspace(0, 2 * np.pi, 20_000, endpoint=False)
    circle = shapely.Polygon(
        near(*zip(500 * np.cos(angle), 500 * np.sin(angle), strict=True))
    )
    found = repair(shapes(circle))
    assert found.was_repaired[0]
    assert shapely.get_num_coordinates(found.polygon[0]) <= MAX_VERTICES
    assert shapely.hausdorff_distance(found.polygon[0], circle) * DEGREE_M < 1


def test_a_footprint_of_thousands_of_parts_ends_as_its_hull() -> None:
    at = np.arange(1500) * 2.0
    parts = [shapely.Polygon(near((x, 0), (x + 1, 0), (x + 1, 1), (x, 1))) for x in at]
    found = repair(shapes(shapely.MultiPolygon(parts)))
    assert found.was_repaired[0]
    assert shapely.get_num_coordinates(found.polygon[0]) <= MAX_VERTICES
    assert found.polygon[0].covers(parts[700])


corner = st.tuples(st.integers(0, 12), st.integers(0, 12))


@given(st.lists(corner, min_size=3, max_size=12), st.lists(corner, min_size=3, max_size=5))
def test_whatever_the_rings_the_result_is_valid_and_turns_left(
    shell: list[tuple[int, int]], hole: list[tuple[int, int]]
) -> None:
    polygon = shapely.Polygon(near(*shell), [near(*hole)])
    found = repair(shapes(polygon))
    if found.reason[0]:
        assert found.polygon[0] is None
        return
    result = found.polygon[0]
    assert result.is_valid
    assert area_m2(found.polygon)[0] <= 144.0 * 1.01
    for part in shapely.get_parts(result):
        assert part.exterior.is_ccw
        assert not any(ring.is_ccw for ring in part.interiors)
        assert shapely.get_num_coordinates(part) > 3


def test_lengths_and_areas_agree_with_pyproj() -> None:
    geod = pyproj.Geod(ellps="WGS84")
    lat = np.array([-80.0, -33.9, 0.0, 37.76, 70.0])
    box = np.asarray(shapely.box(20, lat, 20.001, lat + 0.001), object)
    width, length = size_m(box)
    for k, each in enumerate(lat + 0.0005):
        east = geod.inv(20, each, 20.001, each)[2]
        north = geod.inv(20, lat[k], 20, lat[k] + 0.001)[2]
        assert width[k] == pytest.approx(east, rel=1e-6)
        assert length[k] == pytest.approx(north, rel=1e-6)
        true_area = geod.geometry_area_perimeter(shapely.segmentize(box[k], 1e-4))[0]
        assert area_m2(box)[k] == pytest.approx(true_area, rel=1e-4)
    assert metres_per_degree(np.array([90.0]))[0] == pytest.approx(0, abs=1e-6)

# SPDX-License-Identifier: Apache-2.0
import numpy as np
import shapely

from ingest.outlines import outlines_of


def shapes() -> np.ndarray:
    """Boxes, some with holes, some in several parts, in no order."""
    rng = np.random.default_rng(4)
    box = shapely.box(*rng.uniform(0, 9, (2, 40)), *rng.uniform(10, 19, (2, 40)))
    box[::5] = shapely.difference(box[::5], shapely.box(9.2, 9.2, 9.8, 9.8))
    for k in (3, 10, 27):
        box[k] = shapely.MultiPolygon([box[k], shapely.box(30 + k, 0, 31 + k, 1)])
    return box


def test_outlines_are_those_that_shapely_finds_part_by_part() -> None:
    polygon = shapes()
    found = outlines_of(polygon)
    parts, owner = shapely.get_parts(polygon, return_index=True)
    _, xy, (ring_start, part_ring) = shapely.to_ragged_array(parts)
    assert (shapely.get_num_interior_rings(parts) > 0).any()
    assert len(parts) > len(polygon)
    pairs = zip(found, (xy, ring_start, part_ring, owner), strict=True)
    assert all(np.array_equal(*pair) for pair in pairs)


def test_there_may_be_no_polygon_at_all() -> None:
    found = outlines_of(np.zeros(0, object))
    assert [len(one) for one in found] == [0, 1, 1, 0]

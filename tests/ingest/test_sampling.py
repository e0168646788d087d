# SPDX-License-Identifier: Apache-2.0
"""Values between posts: linear in two triangles, never invented beyond them."""

import numpy as np

from ingest.sampling import triangulated


def test_posts_come_back_exactly(rng: np.random.Generator) -> None:
    window = rng.normal(size=(5, 7)).astype(np.float32)
    y, x = np.mgrid[:5, :7].astype(float)
    found = triangulated(window, x.ravel(), y.ravel())
    np.testing.assert_array_equal(found, window.ravel())


def test_the_diagonal_runs_to_larger_row_and_column() -> None:
    window = np.array([[0, 8], [4, 0]], np.float32)
    at = np.array([(0.5, 0.5), (0.75, 0.25), (0.25, 0.75), (0.5, 0.0), (0.0, 0.5)]).T
    assert triangulated(window, *np.ascontiguousarray(at)).tolist() == [0, 4, 2, 4, 2]


def test_a_plane_is_kept_everywhere(rng: np.random.Generator) -> None:
    y, x = np.mgrid[:9, :9]
    plane = (3 * x - 2 * y + 1).astype(np.float32)
    px, py = rng.uniform(0, 8, 500), rng.uniform(0, 8, 500)
    np.testing.assert_allclose(triangulated(plane, px, py), 3 * px - 2 * py + 1, atol=1e-5)


def test_nothing_is_invented_outside_or_beside_no_data() -> None:
    window = np.array([[1, 2, 3], [4, np.nan, 6], [7, 8, 9]], np.float32)
    x = np.array([-1e-5, 2.00001, 1.0, 0.5, 0.0, 2.0, 1.0])
    y = np.array([0.0, 0.0, 1.0, 0.6, 2.0, 2.0, 0.0])
    found = triangulated(window, x, y)
    assert np.isnan(found[:4]).all()
    assert found[4:].tolist() == [7, 9, 2]


def test_an_edge_of_the_raster_does_not_need_the_posts_beyond_it() -> None:
    one_row = np.array([[1, 3]], np.float32)
    assert triangulated(one_row, np.array([0.25]), np.array([0.0])).tolist() == [1.5]


def test_no_posts_have_no_height() -> None:
    for shape in ((3, 0), (0, 3)):
        none = np.zeros(shape, np.float32)
        found = triangulated(none, np.array([-1.0, 0.0]), np.array([1.0, -1.0]))
        assert np.isnan(found).all()

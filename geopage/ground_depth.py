# SPDX-License-Identifier: Apache-2.0
"""How near the ground can be in a picture: its least depth, in closed form.

The ground up to a height lies in an ellipsoid. Stretched along the earth's axis that is a
sphere, and a depth, being linear, is stretched with it. In pixels and 1 / depth, lines stay
lines and a convex body stays one. So the least deep of the sphere's points in a picture is
the least deep of all, or that of a plane through an edge of the picture, or in a corner.
"""

import math

import numpy as np
from numpy.typing import NDArray

from tiles.frames import WGS84_A_M, WGS84_B_M
from tiles.kernels import inlined, kernel

STRETCH = WGS84_A_M / WGS84_B_M
EDGES = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))
"""Ways inwards, right and up: from the left, the bottom, the right and the top"""
Xyz = tuple[float, float, float]


@kernel
def least_depth_m(
    eye: NDArray[np.float64],
    rotation: NDArray[np.float64],
    half: tuple[float, float],
    height_m: float,
) -> float:
    """Return the least depth of ground up to a height that a picture may show.

    Parameters
    ----------
    eye, rotation : of a `ViewState`
    half : of the picture's width and height, by its focal length
    height_m : above the ellipsoid

    Returns
    -------
    m; 0 where there is no such ground in the picture, or the eye is not above it
    """
    radius_m = WGS84_A_M + max(height_m * STRETCH, height_m)
    at = eye[0], eye[1], eye[2] * STRETCH
    ahead = -rotation[2, 0], -rotation[2, 1], -rotation[2, 2] / STRETCH
    size = math.sqrt(_dot(ahead, ahead))
    depth_m = -radius_m * size - _dot(ahead, at)
    nearest = _added(_times(ahead, -radius_m / size), _times(at, -1.0))
    if depth_m > 0.0 and _is_within(rotation, half, nearest, -1):
        return depth_m
    least_m, above = np.inf, _dot(at, at) - radius_m * radius_m
    for edge in range(4):
        least_m = min(least_m, _on_edge_m(at, ahead, rotation, half, edge, radius_m))
        (x, y), (next_x, next_y) = EDGES[edge], EDGES[(edge + 1) % 4]
        ray = _mixed(rotation, -(x + next_x) * half[0], -(y + next_y) * half[1], -1.0)
        ray = ray[0], ray[1], ray[2] * STRETCH
        length, towards = _dot(ray, ray), _dot(ray, at)
        inside = towards * towards - length * above
        if towards < 0.0 and inside >= 0.0:
            least_m = min(least_m, above / (math.sqrt(inside) - towards))
    return least_m if above > 0.0 and least_m < np.inf else 0.0


@inlined
def _on_edge_m(
    at: Xyz,
    ahead: Xyz,
    rotation: NDArray[np.float64],
    half: tuple[float, float],
    edge: int,
    radius_m: float,
) -> float:
    """Return the least depth in the plane of an edge, if it is on the edge; else inf."""
    normal = _normal(rotation, half, edge)
    square = _dot(normal, normal)
    off = _dot(normal, at) / square
    rest = radius_m * radius_m - off * off * square
    if rest <= 0.0:
        return np.inf
    along = _added(ahead, _times(normal, -_dot(ahead, normal) / square))
    near = _times(along, -math.sqrt(rest / _dot(along, along)))
    near = _added(_added(near, _times(normal, off)), _times(at, -1.0))
    depth_m = _dot(ahead, near)
    return depth_m if depth_m > 0.0 and _is_within(rotation, half, near, edge) else np.inf


@inlined
def _is_within(
    rotation: NDArray[np.float64], half: tuple[float, float], way: Xyz, but: int
) -> bool:
    """Say whether a way from the eye is inside of the edges, one and its opposite apart."""
    within = True
    for edge in range(4):
        if but < 0 or (edge - but) % 2 == 1:
            within = within and _dot(_normal(rotation, half, edge), way) >= 0.0
    return within


@inlined
def _normal(rotation: NDArray[np.float64], half: tuple[float, float], edge: int) -> Xyz:
    """Return the inward normal of the plane through the eye and an edge, stretched."""
    x, y = EDGES[edge]
    normal = _mixed(rotation, x, y, -(half[0] * abs(x) + half[1] * abs(y)))
    return normal[0], normal[1], normal[2] / STRETCH


@inlined
def _mixed(rotation: NDArray[np.float64], x: float, y: float, z: float) -> Xyz:
    return (
        x * rotation[0, 0] + y * rotation[1, 0] + z * rotation[2, 0],
        x * rotation[0, 1] + y * rotation[1, 1] + z * rotation[2, 1],
        x * rotation[0, 2] + y * rotation[1, 2] + z * rotation[2, 2],
    )


@inlined
def _dot(a: Xyz, b: Xyz) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def _times(a: Xyz, factor: float) -> Xyz:
    return a[0] * factor, a[1] * factor, a[2] * factor


@inlined
def _added(a: Xyz, b: Xyz) -> Xyz:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]

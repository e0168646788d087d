# SPDX-License-Identifier: Apache-2.0
"""The projected sizes of `geopage.screen_error` in numpy, by brute force: an oracle."""

import math

import numpy as np
from numpy.typing import NDArray

from geopage.cell_error import SMALL, error_px_per_m
from geopage.ground_depth import least_depth_m
from geopage.screen_error import HIDDEN, NEAR_M, OUTSIDE, Lens
from geopage.tree import Tree
from tiles.frames import Floats
from tiles.kernels import kernel

ANGLES = np.linspace(0.0, 1.0, 2001)


def px_per_m_of(
    lens: Lens, centre: NDArray[np.float64], radius_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """`px_per_m` of (n, 3) centres and (n,) radii, trying 2,001 rays through each."""
    offset = centre - lens.eye
    away = np.maximum(np.linalg.norm(offset, axis=1), NEAR_M)
    near = np.maximum(away - radius_m, NEAR_M)
    cosine = np.minimum(offset @ lens.forward / away, 1.0)
    size = np.minimum(radius_m / away, 1.0)
    wide = np.minimum(np.arcsin(size), math.acos(lens.corner_cos) - np.arccos(cosine))
    beside = ANGLES[:, None] * np.maximum(wide, 0.0)
    begins = np.cos(beside) - np.sqrt(np.maximum(size**2 - np.sin(beside) ** 2, 0.0))
    least = (away * begins * np.cos(np.arccos(cosine) + beside) ** 2).min(axis=0)
    inside = (cosine > lens.corner_cos) & (near > NEAR_M)
    least = np.where(inside, least, near * lens.corner_cos**2)
    return np.asarray(lens.focal_px / least * _weights(lens, offset, radius_m))


@kernel
def scales_of(lens: Lens, tree: Tree) -> Floats:
    """`error_px_per_m` of all cells of terrain."""
    found = np.empty(len(tree.parent))
    for row in range(len(found)):
        boxes = tree.box_m[row], tree.box_rad[row]
        found[row] = error_px_per_m(lens, tree.centre[row], tree.radius_m[row], *boxes)
    return found


def error_px_per_m_of(
    lens: Lens,
    centre: NDArray[np.float64],
    radius_m: NDArray[np.float64],
    box_m: NDArray[np.float32],
) -> NDArray[np.float64]:
    """`error_px_per_m` of n cells that are one piece; test_ground_depth.py has ground."""
    offset = centre - lens.eye
    up = centre / np.linalg.norm(centre, axis=1, keepdims=True)
    east = np.cross((0.0, 0.0, 1.0), centre)
    east /= np.linalg.norm(east, axis=1, keepdims=True)
    axes = np.stack((east, np.cross(up, east), up), axis=1)
    beside = np.maximum(np.abs(np.einsum("nij,nj->ni", axes, offset)) - box_m[:, :3], 0.0)
    near = np.linalg.norm(beside, axis=1)
    near = np.maximum(near, np.linalg.norm(offset, axis=1) - radius_m)
    reach = (np.abs(axes @ lens.forward) * box_m[:, :3]).sum(axis=1)
    depth = offset @ lens.forward - np.minimum(reach, radius_m)
    depth = np.maximum(depth, np.maximum(near, NEAR_M) * lens.corner_cos)
    half = lens.width_px / 2 / lens.focal_px, lens.height_px / 2 / lens.focal_px
    view = lens.eye, lens.rotation, half
    ground = np.array([least_depth_m(*view, float(high)) for high in box_m[:, 4]])
    weights = _weights(lens, offset, radius_m)
    looked_at = (weights == 1.0) & (radius_m > SMALL * depth)
    depth = np.where(looked_at, np.maximum(depth, ground), depth)
    return np.asarray(lens.focal_px / depth * weights)


def _weights(
    lens: Lens, offset: NDArray[np.float64], radius_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    along = offset @ lens.forward
    aside = np.sqrt(np.maximum((offset**2).sum(axis=1) - along**2, 0.0))
    outside = aside * lens.cone_cos - along * lens.cone_sin > radius_m
    return np.where(
        _hidden(lens, offset, radius_m), HIDDEN, np.where(outside, OUTSIDE, 1.0)
    )


def _hidden(
    lens: Lens, offset: NDArray[np.float64], radius_m: NDArray[np.float64]
) -> NDArray[np.bool_]:
    up = float(np.linalg.norm(lens.eye))
    if up <= lens.occluder_m:
        return np.zeros(len(offset), np.bool_)
    along = offset @ (-lens.eye / up)
    sine = lens.occluder_m / up
    aside = np.sqrt(np.maximum((offset**2).sum(axis=1) - along**2, 0.0))
    beyond = along - radius_m > up * (1.0 - sine**2)
    return np.asarray(beyond & (along * sine - aside * math.sqrt(1.0 - sine**2) > radius_m))

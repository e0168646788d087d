# SPDX-License-Identifier: Apache-2.0
"""From a pose in people's terms to a view, and from a view to the GPU's numbers.

Camera space is right, up, backward; all of it is relative to the eye, so no large
number is ever rounded to float32. Depth is reversed: 1 at the near plane, 0 at
infinity, which gives a 32-bit float the same relative precision at every distance.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from geopage.view import ViewState
from tiles import geodesy
from tiles.frames import Ecef, Floats

NEAR_M = 0.25
"""What is nearer to the eye need not be drawn."""
FOV_RAD = math.radians(60.0)


@dataclass(frozen=True, slots=True)
class Pose:
    """Where the eye is and how it looks.

    `heading_rad` is clockwise from north, `pitch_rad` is 0 level, -pi/2 straight down;
    straight down, the heading is where the top of the picture points.
    """

    lon_rad: float
    lat_rad: float
    height_m: float
    """Above the ellipsoid."""
    heading_rad: float
    pitch_rad: float


def rotation(pose: Pose) -> Floats:
    """Return the rows right, up, backward of a pose in ECEF axes, (3, 3) float64."""
    sin_h, cos_h = math.sin(pose.heading_rad), math.cos(pose.heading_rad)
    sin_p, cos_p = math.sin(pose.pitch_rad), math.cos(pose.pitch_rad)
    camera_of_enu = np.array(
        (
            (cos_h, -sin_h, 0.0),
            (-sin_p * sin_h, -sin_p * cos_h, cos_p),
            (-cos_p * sin_h, -cos_p * cos_h, -sin_p),
        )
    )
    return np.asarray(camera_of_enu @ geodesy.enu_axes(pose.lon_rad, pose.lat_rad))


def pose_of(view: ViewState) -> Pose:
    """Return the pose of a view without roll: `view_state` the other way round."""
    lon, lat, height_m = (float(x) for x in geodesy.to_geodetic(view.eye))
    camera_of_enu = view.rotation @ geodesy.enu_axes(lon, lat).T
    heading = math.atan2(-camera_of_enu[0, 1], camera_of_enu[0, 0]) % (2 * math.pi)
    pitch = math.atan2(-camera_of_enu[2, 2], camera_of_enu[1, 2])
    return Pose(lon, lat, height_m, heading, pitch)


def focal_px(height_px: int, fov_rad: float) -> float:
    """Return pixels per unit of slope for a vertical field of view."""
    return height_px / (2.0 * math.tan(fov_rad / 2.0))


def view_state(
    pose: Pose, size_px: tuple[int, int], fov_rad: float = FOV_RAD, t_s: float = 0.0
) -> ViewState:
    """Return the view of a pose in a picture of (width, height) pixels."""
    eye = Ecef(geodesy.to_ecef(pose.lon_rad, pose.lat_rad, pose.height_m))
    width, height = size_px
    return ViewState(t_s, eye, rotation(pose), focal_px(height, fov_rad), width, height)


def pixel_rays(view: ViewState) -> Floats:
    """Return the unit directions of all pixel centres, ECEF axes.

    Returns
    -------
    rays : (height, width, 3) float64, row 0 at the top of the picture
    """
    x = (np.arange(view.width_px) + 0.5 - view.width_px / 2) / view.focal_px
    y = (view.height_px / 2 - np.arange(view.height_px) - 0.5) / view.focal_px
    grid_x, grid_y = np.meshgrid(x, y)
    camera = np.stack((grid_x, grid_y, -np.ones_like(grid_x)), -1)
    camera /= np.linalg.norm(camera, axis=-1, keepdims=True)
    return np.asarray(camera @ view.rotation)


def project(view: ViewState, points: NDArray[np.float64]) -> Floats:
    """Return where ECEF points appear, float64.

    Parameters
    ----------
    points : (..., 3) float64 ECEF m

    Returns
    -------
    pixels : (..., 3) x to the right and y down from the top left corner in pixels, and
        depth along the view axis in m (negative behind the eye)
    """
    camera = (points - view.eye) @ view.rotation.T
    depth = -camera[..., 2]
    x = view.width_px / 2 + view.focal_px * camera[..., 0] / depth
    y = view.height_px / 2 - view.focal_px * camera[..., 1] / depth
    return np.stack((x, y, depth), -1)


def near_m(view: ViewState) -> float:
    """Return the depth of the near plane: in a corner, too, it is nearer than NEAR_M."""
    x, y = view.width_px / 2 / view.focal_px, view.height_px / 2 / view.focal_px
    return NEAR_M / math.sqrt(1.0 + x * x + y * y)


def unproject(view: ViewState, x: float, y: float, depth: float) -> Ecef:
    """Return the point at a position in the picture that has a depth, as GL keeps it.

    Parameters
    ----------
    x, y : pixels to the right and down from the top left corner
    depth : 1 at the near plane, towards 0 at infinity
    """
    right = (x - view.width_px / 2) / view.focal_px
    above = (view.height_px / 2 - y) / view.focal_px
    ray = np.array((right, above, -1.0)) @ view.rotation
    return Ecef(view.eye + ray * (near_m(view) / depth))

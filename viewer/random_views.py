# SPDX-License-Identifier: Apache-2.0
"""Seeded random poses over a store: every height, every pitch, where the sources are."""

import math
from typing import Any

import numpy as np

from tiles.frames import WGS84_A_M
from tiles.surface import Surface
from viewer.camera import Pose

LOWEST_M, HIGHEST_M = 10.0, 1e7
STRAIGHT_DOWN, AT_HORIZON = 0.15, 0.25
"""Shares of poses that look straight down and at the horizon; the rest anywhere between."""
ABOVE_HORIZON_RAD = math.radians(15.0)
Box = tuple[float, float, float, float]
GLOBE: Box = (-180.0, -90.0, 180.0, 90.0)


def boxes_of(sources: list[dict[str, Any]]) -> list[Box]:
    """Return where to look from: every source's box, and the globe where one goes round."""
    boxes: list[Box] = [tuple(source["bounds_deg"]) for source in sources]
    return [GLOBE, *boxes] if any(source["wraps"] for source in sources) else boxes


def random_poses(surface: Surface, boxes: list[Box], count: int, seed: int) -> list[Pose]:
    """Return poses; their heights above ground are 10 m to 10,000 km, log-uniform.

    Parameters
    ----------
    boxes : west, south, east, north in degrees; each is as likely as the next, and a place
        in it as likely as any other on the ellipsoid (nearly: on a sphere)
    """
    rng = np.random.default_rng(seed)
    return [_pose(surface, boxes[rng.integers(len(boxes))], rng) for _ in range(count)]


def _pose(surface: Surface, box: Box, rng: np.random.Generator) -> Pose:
    west, south, east, north = np.radians(np.clip(box, GLOBE[0] * 4, GLOBE[2] * 4))
    lon = float(rng.uniform(west, east))
    lon -= 2 * math.pi * round(lon / (2 * math.pi))
    low, high = np.sin(np.clip([south, north], -math.pi / 2, math.pi / 2))
    lat = math.asin(float(rng.uniform(low, high)))
    above_m = math.exp(rng.uniform(math.log(LOWEST_M), math.log(HIGHEST_M)))
    height_m = max(surface.height_at(lon, lat), -500.0) + above_m
    heading = float(rng.uniform(0.0, 2 * math.pi))
    horizon = -math.acos(WGS84_A_M / (WGS84_A_M + max(height_m, 0.0)))
    kind = rng.uniform()
    pitch = -math.pi / 2
    if kind < STRAIGHT_DOWN + AT_HORIZON:
        pitch = pitch if kind < STRAIGHT_DOWN else horizon
    else:
        pitch = float(rng.uniform(pitch, horizon + ABOVE_HORIZON_RAD))
    return Pose(lon, lat, height_m, heading, pitch)

# SPDX-License-Identifier: Apache-2.0
"""Other ways to select what is drawn, over the same forests."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from geopage.draw_list import DrawList
from geopage.selection import ideal
from geopage.view import ViewState
from tiles import cells
from tiles.forest import Forest
from tiles.frames import WGS84_A_M, Floats, Ints
from tiles.index_tree import RUNG_FIELDS
from tiles.lanes import Lane
from tiles.mesh import VERTEX
from tiles.terrain import TEXTURE_BYTES

FACE = 8.0
"""Thresholds that a face may span"""
HOUSE_M = 20.0
INDICES_PER_VERTEX = 6
"""Of a triangulated surface, nearly"""
NO_PX = 1e-6
Forests = Mapping[Lane, Forest]


def without_proxies(forests: Forests, view: ViewState, threshold_px: float) -> DrawList:
    """Select in a forest in which no object tile has a proxy to draw."""
    objects = forests[Lane.OBJECTS]
    records = objects.records.copy()
    records["proxies"], records["proxy_dimension_m"] = 0, 0.0
    bare = {**forests, Lane.OBJECTS: replace(objects, records=records)}
    return ideal(bare, view, threshold_px, threshold_px)


def by_faces(forests: Forests, view: ViewState, threshold_px: float) -> DrawList:
    """Select ground by the size of its triangles on the screen, not by their error."""
    ground = forests[Lane.TERRAIN]
    records = ground.records.copy()
    mesh_bytes = np.maximum(records["memory_bytes"].astype(np.float64) - TEXTURE_BYTES, 1.0)
    triangles = mesh_bytes / (VERTEX.itemsize + 2 * INDICES_PER_VERTEX) * 2
    records["error_m"] = edges_m(records["cell"]) / np.sqrt(triangles / 2) / FACE
    records["texel_m"] = 0.0
    for name in RUNG_FIELDS:
        records[name] = 0.0
    faces = {**forests, Lane.TERRAIN: replace(ground, records=records)}
    chosen = ideal(faces, view, threshold_px, threshold_px)
    return replace(chosen, skirt_m=ideal_skirts(ground, chosen))


def ideal_skirts(ground: Forest, chosen: DrawList) -> np.ndarray:
    """Return skirts that hide any crack: twice the largest error of the list, (n,) m."""
    worst_m = float(ground.records["error_m"][chosen.terrain].max(initial=0.0))
    return np.full(len(chosen.terrain), 2 * worst_m, np.float32)


def edges_m(cell: Ints) -> Floats:
    """Return the root of each cell's area."""
    west, south, east, north = cells.bounds_rad(cell)
    area = (east - west) * np.abs(np.sin(north) - np.sin(south))
    return np.asarray(WGS84_A_M * np.sqrt(area))


def by_range(forests: Forests, view: ViewState, threshold_px: float) -> DrawList:
    """Take all that is finest up to a distance."""
    reach_m = HOUSE_M * view.focal_px / threshold_px
    none = ideal(forests, view, threshold_px, threshold_px)
    ground, things = forests[Lane.TERRAIN], forests[Lane.OBJECTS]
    leaves = ground.records["children"] == 0
    terrain = within(ground, view, reach_m, leaves)
    objects = within(things, view, reach_m, things.records["row"] > 0)
    return replace(
        none,
        terrain=terrain,
        skirt_m=2 * ground.records["error_m"][terrain],
        stand_in=np.zeros(len(terrain), np.bool_),
        rung=None,
        objects=objects,
        own=np.ones(len(objects), np.bool_),
        proxies=np.zeros(len(objects), np.uint8),
        object_threshold_px=NO_PX,
    )


def within(
    forest: Forest, view: ViewState, reach_m: float, among: np.ndarray
) -> np.ndarray:
    """Return the rows whose spheres come so near to the eye, (n,) int32."""
    away_m = np.linalg.norm(forest.centre - view.eye, axis=1) - forest.radius_m
    return np.flatnonzero(among & (away_m < reach_m)).astype(np.int32)

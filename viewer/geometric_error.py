# SPDX-License-Identifier: Apache-2.0
"""The geometric pixel error of one frame: drawn against the sources' own posts.

For each drawn terrain pixel it is the shortest distance from the drawn point to the
finest source surface, and for each pixel of a reference ray cast against that surface
(float64, from nothing but the posts) the shortest distance to the drawn triangles; each
times focal length / depth along the view axis, in pixels. The larger counts. Distances
whose upper bound is already below KEEP_PX are not searched further: they err high.

Not judged: pixels on places where no source has posts, and those around a finer source
where it bends the coarser one (its `reach_m`), because nobody measured the surface there.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tiles.frames import Ecef, Floats, Ints
from tiles.post_distance import distances
from tiles.post_rays import ends_below
from tiles.post_search import drop_bent, first_hits, owners
from tiles.post_tree import LOW, PostTree
from viewer.drawn_surface import DrawnSurface, distances_to, holders
from viewer.silhouette import Silhouette, silhouette

Hits = tuple[Floats, Ints]
KEEP_PX = 0.02
NEAREST_M = 0.25
DEEP_M = 2000.0
"""A ray this far below the lowest post meets no source any more."""


@dataclass(frozen=True, slots=True)
class Seen:
    """What a frame shows, at the fineness at which it is judged."""

    eye: Ecef
    forward: Floats
    """(3,) unit vector along the view axis"""
    focal_px: float
    """Of the picture in whose pixels the error counts"""
    rays: Floats
    """(h, w, 3) unit vectors through the pixels, ECEF axes"""
    points: Floats
    """(h, w, 3) ECEF m of what was drawn, NaN where sky"""
    tile: Ints
    """(h, w) entry of the draw list's terrain, -1 where something else was drawn"""


@dataclass(frozen=True, slots=True)
class FrameError:
    """One frame, pixel by pixel; all arrays (h, w)."""

    error_px: Floats
    """NaN where not judged"""
    leaf_px: Floats
    """Error that the leaf states there, in pixels; 0 where a finer tile exists"""
    limit_px: Floats
    """max(threshold, what the leaf states), of the direction that comes nearer to it"""
    excess: Floats
    """That direction's error / limit_px: 1 or less keeps the promise; 0 where not judged"""
    earth: NDArray[np.bool_]
    """Terrain is drawn or the reference meets a source; the rest is sky or a building"""
    silhouette: Silhouette


@dataclass(frozen=True, slots=True)
class _Found:
    """Distances of points to a surface, in pixels, with what the leaf there states."""

    error_px: Floats
    leaf_px: Floats


def geometric_error(
    tree: PostTree,
    surface: DrawnSurface,
    leaf_error_m: Floats,
    seen: Seen,
    threshold_px: float,
    *,
    hits: Hits | None = None,
    silhouettes: bool = True,
) -> FrameError:
    """Measure a frame.

    Parameters
    ----------
    surface, leaf_error_m : of the draw list's terrain, in its order
    hits : what `reference` returns, where it is known already
    silhouettes : False: they are not compared, which saves time
    """
    shape = seen.tile.shape
    tile = seen.tile.ravel()
    points = seen.points.reshape(-1, 3)
    hit_m, owner = hits or reference(tree, seen)
    met = seen.eye + seen.rays.reshape(-1, 3) * np.where(owner >= 0, hit_m, np.nan)[:, None]
    drawn = _drawn_to_posts(tree, leaf_error_m, seen, points, tile)
    back = _posts_to_drawn(tree, (surface, leaf_error_m), seen, (met, owner), points, tile)
    ways = np.stack([drawn.error_px, back.error_px])
    limits = np.maximum(threshold_px, np.stack([drawn.leaf_px, back.leaf_px]))
    excess = np.nan_to_num(ways / limits)
    allowed_px = np.take_along_axis(limits, excess.argmax(axis=0)[None], axis=0)[0]
    depths = [np.where(tile >= 0, (points - seen.eye) @ seen.forward, np.inf)]
    depths.append(np.where(owner >= 0, (met - seen.eye) @ seen.forward, np.inf))
    blind = (owner == BLIND) | ((tile < 0) & np.isfinite(points[:, 0]))
    blind |= (tile >= 0) & np.isnan(drawn.error_px)
    blind |= (owner >= 0) & np.isnan(back.error_px)
    return FrameError(
        np.fmax(drawn.error_px, back.error_px).reshape(shape),
        np.fmax(drawn.leaf_px, back.leaf_px).reshape(shape),
        allowed_px.reshape(shape),
        excess.max(axis=0).reshape(shape),
        ((tile >= 0) | (owner >= 0)).reshape(shape),
        silhouette(
            *(one.reshape(shape) for one in (*depths, blind, limits.max(axis=0))),
        )
        if silhouettes
        else NOT_COMPARED,
    )


BLIND = -3
"""Owner of a ray that goes into the earth where no source has posts."""
NOT_COMPARED = Silhouette(0, np.zeros(0), np.zeros(0))


def reference(tree: PostTree, seen: Seen) -> Hits:
    """Cast the rays of a frame against the finest source surface.

    Returns
    -------
    distance_m : (n,) inf where nothing is met
    owner : (n,) source that is met, NOWHERE for sky, BLIND where no source has posts
    """
    rays = np.ascontiguousarray(seen.rays.reshape(-1, 3))
    eye = (float(seen.eye[0]), float(seen.eye[1]), float(seen.eye[2]))
    lowest_m = float(tree.node[:, LOW].min(initial=0.0)) - DEEP_M
    ends = ends_below(eye, rays, lowest_m)
    distance_m, owner = np.empty(len(rays)), np.empty(len(rays), np.int64)
    first_hits(tree, eye, rays, ends, owner, distance_m)
    owner[(owner < 0) & np.isfinite(ends)] = BLIND
    return distance_m, owner


def _drawn_to_posts(
    tree: PostTree, leaf_error_m: Floats, seen: Seen, points: Floats, tile: Ints
) -> _Found:
    """Return how far drawn points are from the sources' surface."""
    error_px, leaf_px = np.full(len(tile), np.nan), np.zeros(len(tile))
    at = np.flatnonzero(tile >= 0)
    drawn = np.ascontiguousarray(points[at])
    owner, above_m = np.empty(len(at), np.int64), np.empty(len(at))
    owners(tree, drawn, owner, above_m)
    px_m = _pixels_per_m(seen, drawn)
    leaf_px[at] = leaf_error_m[tile[at]] * px_m
    known = np.flatnonzero(owner >= 0)
    away_m = distances(
        tree,
        drawn[known],
        owner[known],
        np.abs(above_m[known]) + 1e-9,
        KEEP_PX / px_m[known],
    )
    error_px[at[known]] = away_m * px_m[known]
    return _Found(error_px, leaf_px)


def _posts_to_drawn(
    tree: PostTree,
    drawn: tuple[DrawnSurface, Floats],
    seen: Seen,
    met: tuple[Floats, Ints],
    points: Floats,
    tile: Ints,
) -> _Found:
    """Return how far the reference's points are from the drawn triangles."""
    surface, leaf_error_m = drawn
    error_px, leaf_px = np.full(len(tile), np.nan), np.zeros(len(tile))
    at = np.flatnonzero(met[1] >= 0)
    hits = np.ascontiguousarray(met[0][at])
    owner = met[1][at]
    drop_bent(tree, hits, owner)
    known = at[owner >= 0]
    hits = hits[owner >= 0]
    px_m = _pixels_per_m(seen, hits)
    same_pixel_m = np.linalg.norm(points[known] - hits, axis=1)
    limit_m = np.where(tile[known] >= 0, same_pixel_m, np.inf)
    away_m = distances_to(surface, hits, tile[known], limit_m, KEEP_PX / px_m)
    error_px[known] = away_m * px_m
    # The tile that stands for the place answers for it, not the one that is nearest.
    holder = holders(surface, hits)
    leaf_px[known] = np.where(holder >= 0, leaf_error_m[holder], 0.0) * px_m
    return _Found(error_px, leaf_px)


def _pixels_per_m(seen: Seen, points: Floats) -> Floats:
    """Return focal length / depth along the view axis, (n,)."""
    depth_m = (points - seen.eye) @ seen.forward
    return np.asarray(seen.focal_px / np.maximum(depth_m, NEAREST_M))

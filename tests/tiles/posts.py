# SPDX-License-Identifier: Apache-2.0
"""Stores that hold nothing but posts, and their surface by brute force."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
from numpy.typing import NDArray

from tiles.codec import zstd
from tiles.post_tree import PostTree, build_tree
from tiles.source_posts import read_rasters
from tiles.store import Store
from tiles.writer import Writer

Floats = NDArray[np.float64]
LON_DEG, LAT_DEG, STEP_DEG = 10.0, 45.0, 0.005
GEO, UTM = "EPSG:4326", "EPSG:32632"


def source(
    heights: NDArray[Any],
    transform: tuple[float, ...] = (STEP_DEG, 0.0, LON_DEG, 0.0, -STEP_DEG, LAT_DEG),
    crs: str = GEO,
    spacing_m: float = 500.0,
    **more: Any,
) -> dict[str, Any]:
    """Describe a raster of posts as the store does; `posts` holds them."""
    height, width = heights.shape
    transform = tuple(float(x) for x in transform)
    wraps = crs == GEO and abs(abs(transform[0]) * width - 360) < 1e-9
    box = [LON_DEG, LAT_DEG - 1, LON_DEG + 1, LAT_DEG]
    about = {"crs": crs, "transform": transform, "spacing_m": spacing_m, "wraps": wraps}
    about |= {"width": width, "height": height, "bounds_deg": box, "reach_m": 0.0}
    return {**about, **more, "posts": heights.astype(np.float32)}


def write_sources(writer: Writer, sources: list[dict[str, Any]]) -> None:
    """Write rasters into a store, as FORMAT.md says."""
    for rank, one in enumerate(sources):
        details = {**one, "blocks": f"s{rank}"}
        posts = details.pop("posts")
        row = (f"s{rank}", "terrain", rank, json.dumps(details))
        writer.connection.execute("INSERT INTO source VALUES(?,?,?,?)", row)
        for top in range(0, posts.shape[0], 256):
            for left in range(0, posts.shape[1], 256):
                block = np.ascontiguousarray(posts[top : top + 256, left : left + 256])
                key = (f"s{rank}", 0, top // 256, left // 256)
                body = zstd.compress(block.tobytes())
                ask = "INSERT INTO raster_block VALUES(?,?,?,?,?)"
                writer.connection.execute(ask, (*key, body))


def tree_of(folder: Path, *sources: dict[str, Any]) -> PostTree:
    """Return the tree of sources, through a store."""
    folder.mkdir(exist_ok=True)
    writer = Writer(folder / "posts.geopage")
    write_sources(writer, list(sources))
    writer.close()
    with Store(folder / "posts.geopage") as store:
        return build_tree(read_rasters(store))


def ecef_posts(one: dict[str, Any]) -> Floats:
    """Return all posts in ECEF by pyproj, (h, w, 3) m."""
    a, b, c, d, e, f = one["transform"]
    col, row = np.meshgrid(np.arange(one["width"]) + 0.5, np.arange(one["height"]) + 0.5)
    x, y = a * col + b * row + c, d * col + e * row + f
    lon, lat = pyproj.Transformer.from_crs(one["crs"], 4326, always_xy=True).transform(x, y)
    place = pyproj.Transformer.from_crs(4979, 4978, always_xy=True)
    return np.stack(place.transform(lon, lat, one["posts"].astype(np.float64)), axis=-1)


def triangles_of(one: dict[str, Any]) -> Floats:
    """Return all triangles with data, (t, 3, 3) ECEF m."""
    p = ecef_posts(one)
    if one["wraps"]:
        p = np.concatenate([p, p[:, :1]], axis=1)
    a, b, c, d = p[:-1, :-1], p[:-1, 1:], p[1:, :-1], p[1:, 1:]
    both = [np.stack([a, k, d], axis=2).reshape(-1, 3, 3) for k in (b, c)]
    every = np.concatenate(both)
    return every[np.isfinite(every).all(axis=(1, 2))]


def hills(height: int, width: int, seed: int = 3, rough_m: float = 300.0) -> Floats:
    """Return rough heights with some long waves."""
    rng = np.random.default_rng(seed)
    row, col = np.mgrid[:height, :width]
    waves = 800 * np.sin(row / 7.0) * np.cos(col / 9.0)
    return waves + rng.uniform(0, rough_m, (height, width))


def first_hit(triangles: Floats, eye: Floats, way: Floats) -> float:
    """Cast one ray against all triangles (Moeller and Trumbore)."""
    a, ab, ac = (
        triangles[:, 0],
        triangles[:, 1] - triangles[:, 0],
        triangles[:, 2] - triangles[:, 0],
    )
    p = np.cross(way, ac)
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = 1.0 / (ab * p).sum(1)
        to = eye - a
        u = (to * p).sum(1) * scale
        q = np.cross(to, ab)
        v, t = (q @ way) * scale, (ac * q).sum(1) * scale
    hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
    return float(t[hit].min(initial=np.inf))


def shortest(triangles: Floats, point: Floats) -> float:
    """Return the distance to the nearest of all triangles: its plane, or its edges."""
    a, b, c = (triangles[:, k] - point for k in range(3))
    normal = np.cross(b - a, c - a)
    square = (normal**2).sum(1)
    foot = normal * ((a * normal).sum(1) / square)[:, None]
    inside = np.ones(len(a), bool)
    best = np.full(len(a), np.inf)
    for p, q in ((a, b), (b, c), (c, a)):
        inside &= (np.cross(q - p, foot - p) * normal).sum(1) >= 0
        edge = q - p
        share = np.clip(-(p * edge).sum(1) / (edge**2).sum(1), 0, 1)
        best = np.minimum(best, np.linalg.norm(p + share[:, None] * edge, axis=1))
    return float(np.where(inside, np.linalg.norm(foot, axis=1), best).min())

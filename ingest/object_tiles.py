# SPDX-License-Identifier: Apache-2.0
"""From meshes of buildings and proxies to the tile of one cell."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ingest.extrude import Prisms
from ingest.object_index import Drawn, drawn_of
from tiles.frames import Ecef, Floats, Ints
from tiles.kernels import kernel
from tiles.mesh import STEPS, Mesh
from tiles.objects import OBJECT, PROXY, PROXY_ORDINAL, ObjectTile


@dataclass(frozen=True, slots=True)
class Meshes:
    """Meshes of n things, buildings or proxies, one after the other."""

    prisms: Prisms
    ecef: Ecef
    """(v, 3) vertex positions"""
    vertex_start: Ints
    triangle_start: Ints
    """(n + 1,) where each thing's vertices and triangles begin"""
    drawn: Drawn
    """what bounds each thing, and the cell that holds it"""


@dataclass(frozen=True, slots=True)
class OwnObjects:
    """What a tile says about its buildings, sorted by cell, largest first."""

    meshes: Meshes
    id: Ints
    dimension_m: Floats


@dataclass(frozen=True, slots=True)
class Proxies:
    """p proxies, sorted by the cell that holds them, then by child."""

    meshes: Meshes
    child: Ints
    """(p,) which child of its cell each stands for, 0 to 3"""
    dimension_m: Floats
    error_m: Floats
    count: Ints
    """(p,) buildings that it stands for"""


def meshes_of(prisms: Prisms, thing_start: Ints, cell: Ints) -> Meshes:
    """Group prisms to things.

    Parameters
    ----------
    prisms : meshes of m prisms
    thing_start : (n + 1,) where each thing's prisms begin
    cell : (n,) the cell that holds each thing
    """
    ecef = prisms.ecef
    vertex_start = prisms.vertex_start[thing_start]
    drawn = drawn_of(prisms, ecef, vertex_start, cell)
    return Meshes(prisms, ecef, vertex_start, prisms.triangle_start[thing_start], drawn)


def make_tile(
    cell: int, own: OwnObjects, proxies: Proxies, own_range: slice, proxy_range: slice
) -> ObjectTile:
    """Return the tile of a cell: its own objects, then its proxies.

    Parameters
    ----------
    own_range, proxy_range : which of the buildings and of the proxies it holds
    """
    parts = ((own.meshes, own_range), (proxies.meshes, proxy_range))
    spans = [
        (m, m.vertex_start[s.start : s.stop + 1], m.triangle_start[s.start : s.stop + 1])
        for m, s in parts
    ]
    centre, scale_m, steps = _quantised(*(m.ecef[v[0] : v[-1]] for m, v, _ in spans))
    vertices = np.concatenate([m.prisms.vertices[v[0] : v[-1]] for m, v, _ in spans])
    vertices["position"] = steps
    own_vertices = np.diff(spans[0][1])
    vertices["detail"][:, 1] = PROXY_ORDINAL
    ordinal = np.repeat(np.arange(len(own_vertices)), own_vertices)
    vertices["detail"][: len(ordinal), 1] = np.minimum(ordinal, PROXY_ORDINAL - 1)
    shift = (0, len(ordinal))
    triangles = [
        m.prisms.triangles[t[0] : t[-1]] - (v[0] - k)
        for (m, v, t), k in zip(spans, shift, strict=True)
    ]
    indices = np.concatenate(triangles).ravel().astype(np.uint16)
    mesh = Mesh(Ecef(centre), scale_m, vertices, indices)
    ends = [3 * (t[1:] - t[0]) for _, _, t in spans]
    first_proxy = 3 * int(spans[0][2][-1] - spans[0][2][0])
    objects = _object_table(own, own_range, mesh, ends[0])
    return ObjectTile(
        cell, mesh, objects, _proxy_table(proxies, proxy_range, first_proxy, ends[1])
    )


@kernel
def _quantised(own: Floats, proxies: Floats) -> tuple[Floats, float, NDArray[np.int16]]:
    """Round positions to 16-bit steps around their middle, as `mesh.quantise` does."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for some in (own, proxies):
        for place in some:
            for k in range(3):
                low[k], high[k] = min(low[k], place[k]), max(high[k], place[k])
    centre = (low + high) / 2
    reach_m = max((high - centre).max(), (centre - low).max())
    scale_m = max(reach_m, 1e-3) / STEPS
    steps, count = np.empty((len(own) + len(proxies), 3), np.int16), 0
    for some in (own, proxies):
        for place in some:
            for k in range(3):
                steps[count, k] = np.rint((place[k] - centre[k]) / scale_m)
            count += 1
    return centre, scale_m, steps


def _object_table(
    own: OwnObjects, which: slice, mesh: Mesh, ends: Ints
) -> np.ndarray[tuple[int], np.dtype[np.void]]:
    table = np.zeros(len(ends), OBJECT)
    drawn = own.meshes.drawn
    table["id"] = own.id[which]
    table["centre"] = drawn.centre[which] - mesh.centre
    table["radius_m"] = drawn.radius_m[which] * (1 + 1e-6) + mesh.scale_m
    table["dimension_m"] = own.dimension_m[which]
    table["index_end"] = ends
    return table


def _proxy_table(
    proxies: Proxies, which: slice, first: int, ends: Ints
) -> np.ndarray[tuple[int], np.dtype[np.void]]:
    table = np.zeros(len(ends), PROXY)
    table["child"] = proxies.child[which]
    table["dimension_m"] = proxies.dimension_m[which]
    table["error_m"] = proxies.error_m[which]
    table["index_start"] = first + np.concatenate(([0], ends))[:-1]
    table["index_end"] = first + ends
    table["count"] = proxies.count[which]
    return table

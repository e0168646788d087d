# SPDX-License-Identifier: Apache-2.0
"""Small city models with known volumes, as CityJSON and as CityGML."""

import json
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

RD = (85_000.0, 447_000.0, 3.0)
"""A place in Delft in EPSG:7415."""
Ring = list[int]


@dataclass(frozen=True)
class Body:
    """Faces of one solid, each a list of rings of vertex numbers."""

    vertices: np.ndarray
    faces: list[list[Ring]]
    kinds: list[str]

    def moved(self, *by: float) -> "Body":
        return replace(self, vertices=self.vertices + by)

    def scaled(self, by: float) -> "Body":
        return replace(self, vertices=self.vertices * by)

    def inside_out(self) -> "Body":
        return replace(self, faces=[[r[::-1] for r in face] for face in self.faces])


def box(width: float, depth: float, height: float) -> Body:
    x, y, z = width, depth, height
    low = [(0, 0, 0), (x, 0, 0), (x, y, 0), (0, y, 0)]
    vertices = np.array(low + [(a, b, z) for a, b, _ in low], float)
    walls = [[[k, (k + 1) % 4, (k + 1) % 4 + 4, k + 4]] for k in range(4)]
    kinds = ["GroundSurface", *["WallSurface"] * 4, "RoofSurface"]
    return Body(vertices, [[[3, 2, 1, 0]], *walls, [[4, 5, 6, 7]]], kinds)


def gable() -> Body:
    """Return 10 x 8 m, eaves at 6 m, ridge at 9 m: 600 m3."""
    walls = box(10, 8, 6)
    vertices = np.vstack((walls.vertices, [(0, 4, 9), (10, 4, 9)]))
    faces = [
        [[3, 2, 1, 0]],
        [[0, 1, 5, 4]],
        [[1, 2, 6, 9, 5]],
        [[2, 3, 7, 6]],
        [[3, 0, 4, 8, 7]],
        [[4, 5, 9, 8]],
        [[6, 7, 8, 9]],
    ]
    kinds = ["GroundSurface", *["WallSurface"] * 4, "RoofSurface", "RoofSurface"]
    return Body(vertices, faces, kinds)


def court(height: float = 5.0) -> Body:
    """Return 20 x 20 m with a court of 6 x 6 m in the middle: 364 m2."""
    outer, inner = box(20, 20, height), box(6, 6, height).moved(7, 7, 0)
    walls = [[[v + 8 for v in face[0][::-1]]] for face in inner.faces[1:5]]
    faces = [
        [[3, 2, 1, 0], [8, 9, 10, 11]],
        *outer.faces[1:5],
        *walls,
        [[4, 5, 6, 7], [15, 14, 13, 12]],
    ]
    kinds = ["GroundSurface", *["WallSurface"] * 8, "RoofSurface"]
    return Body(np.vstack((outer.vertices, inner.vertices)), faces, kinds)


def geometry(body: Body, first: int, kind: str = "Solid", lod: str = "2") -> dict[str, Any]:
    """Return a CityJSON geometry whose vertices begin at number `first`."""
    shell = [[[v + first for v in ring] for ring in face] for face in body.faces]
    surfaces = sorted(set(body.kinds))
    values = [surfaces.index(kind) for kind in body.kinds]
    solid = kind == "Solid"
    return {
        "type": kind,
        "lod": lod,
        "boundaries": [shell] if solid else shell,
        "semantics": {
            "surfaces": [{"type": one} for one in surfaces],
            "values": [values] if solid else values,
        },
    }


def document(
    *bodies: Body, crs: str | None = "EPSG:7415", at: Iterable[float] = RD
) -> dict[str, Any]:
    """Return a CityJSON document of one Building a body, called b0, b1 ..."""
    first = np.cumsum([0] + [len(body.vertices) for body in bodies]).tolist()
    place = np.array(list(at))
    vertices = np.vstack([body.vertices for body in bodies])
    return {
        "type": "CityJSON",
        "version": "2.0",
        "metadata": {"referenceSystem": crs} if crs else {},
        "transform": {"scale": [0.001] * 3, "translate": place.tolist()},
        "CityObjects": {
            f"b{k}": {
                "type": "Building",
                "attributes": {"storeys": k + 1, "use": ["home", k]},
                "geometry": [geometry(body, first[k])],
            }
            for k, body in enumerate(bodies)
        },
        "vertices": np.rint(vertices * 1000).astype(int).tolist(),
    }


def write(path: Path, value: dict[str, Any] | list[dict[str, Any]]) -> Path:
    """Write a document, or a sequence of documents a line each."""
    lines = value if isinstance(value, list) else [value]
    path.write_text("\n".join(json.dumps(line) for line in lines), "utf-8")
    return path


def ring_text(points: np.ndarray) -> str:
    closed = np.vstack((points, points[:1]))
    return " ".join(f"{value:.12g}" for value in closed.ravel())


def polygon(body: Body, face: list[Ring], ident: str) -> str:
    bounds = ("exterior", *["interior"] * (len(face) - 1))
    rings = "".join(
        f"<gml:{bound}><gml:LinearRing><gml:posList>{ring_text(body.vertices[ring])}"
        f"</gml:posList></gml:LinearRing></gml:{bound}>"
        for bound, ring in zip(bounds, face, strict=True)
    )
    return f'<gml:Polygon gml:id="{ident}">{rings}</gml:Polygon>'


def linked_solid(body: Body, name: str) -> str:
    """Return surfaces with their polygons, and a solid that only links to them."""
    surfaces, links = "", ""
    for k, (face, kind) in enumerate(zip(body.faces, body.kinds, strict=True)):
        surfaces += (
            f"<bldg:boundedBy><bldg:{kind}><bldg:lod2MultiSurface><gml:MultiSurface>"
            f"<gml:surfaceMember>{polygon(body, face, f'{name}_{k}')}</gml:surfaceMember>"
            f"</gml:MultiSurface></bldg:lod2MultiSurface></bldg:{kind}></bldg:boundedBy>"
        )
        links += f'<gml:surfaceMember xlink:href="#{name}_{k}"/>'
    return (
        "<bldg:lod2Solid><gml:Solid><gml:exterior><gml:CompositeSurface>"
        f"{links}</gml:CompositeSurface></gml:exterior></gml:Solid></bldg:lod2Solid>"
        f"{surfaces}"
    )


def plain_solid(body: Body, lod: int = 1) -> str:
    faces = "".join(
        f"<gml:surfaceMember>{polygon(body, face, f'p{k}')}</gml:surfaceMember>"
        for k, face in enumerate(body.faces)
    )
    return (
        f"<bldg:lod{lod}Solid><gml:Solid><gml:exterior><gml:CompositeSurface>{faces}"
        f"</gml:CompositeSurface></gml:exterior></gml:Solid></bldg:lod{lod}Solid>"
    )


def building(inside: str, ident: str = "b0", kind: str = "bldg:Building") -> str:
    return f'<{kind} gml:id="{ident}">{inside}</{kind}>'


def city_gml(*objects: str, srs: str = "EPSG:7415", version: str = "2.0") -> str:
    """Return a CityGML document of city objects."""
    base = "http://www.opengis.net/citygml"
    bound = f'<gml:boundedBy><gml:Envelope srsName="{srs}"/></gml:boundedBy>' if srs else ""
    members = "".join(f"<cityObjectMember>{one}</cityObjectMember>" for one in objects)
    return (
        f'<?xml version="1.0" encoding="UTF-8"?><CityModel xmlns="{base}/{version}" '
        f'xmlns:bldg="{base}/building/{version}" xmlns:gen="{base}/generics/{version}" '
        f'xmlns:tran="{base}/transportation/{version}" '
        'xmlns:gml="http://www.opengis.net/gml" '
        f'xmlns:xlink="http://www.w3.org/1999/xlink">{bound}{members}</CityModel>'
    )

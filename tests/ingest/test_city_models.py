# SPDX-License-Identifier: Apache-2.0
"""City models as they are stored: volumes, ground plans, heights, places, attributes."""

import gzip
import json
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyproj
import pytest
import shapely
import trimesh

from ingest.city_models import is_city_model, read_city_model
from ingest.features import features_of, packed
from ingest.footprints import Footprints
from ingest.heights import HeightRules
from ingest.repair import area_m2, repair
from ingest.solids import Solid, decode_solid, solid_prisms, widths_m
from tests.ingest.city_samples import (
    RD,
    Body,
    box,
    building,
    city_gml,
    court,
    document,
    gable,
    geometry,
    linked_solid,
    plain_solid,
    polygon,
    write,
)
from tiles.errors import InputError
from tiles.mesh import ROOF, WALL

AT = (RD[0], RD[1], 0.0)


def only(parts: Iterator[Footprints]) -> Footprints:
    (part,) = parts
    return part


def mesh_of(solid: Solid) -> trimesh.Trimesh:
    return trimesh.Trimesh(solid.place.astype(float), solid.triangles, process=False)


def open_edges(mesh: trimesh.Trimesh) -> np.ndarray:
    """Places of the corners of edges that have one face only."""
    whole = mesh.copy()
    whole.merge_vertices(digits_vertex=3)
    single = trimesh.grouping.group_rows(whole.edges_sorted, require_count=1)
    return whole.vertices[whole.edges_sorted[single]]


def gml(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "city.gml"
    path.write_text(text, "utf-8")
    return path


@pytest.fixture(params=["cityjson", "sequence", "citygml"])
def town(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """Return a gabled house and a higher one with a court, in one of the formats."""
    bodies = (gable(), court(7.0).moved(40, 0, 2))
    whole = document(*bodies)
    if request.param == "cityjson":
        return write(tmp_path / "city.json", whole)
    if request.param == "citygml":
        placed = (body.moved(*RD) for body in bodies)
        objects = [
            building(linked_solid(b, f"s{k}"), f"b{k}") for k, b in enumerate(placed)
        ]
        return gml(tmp_path, city_gml(*objects))
    lines = [{**whole, "CityObjects": {}, "vertices": []}]
    for name, one in whole["CityObjects"].items():
        feature = {"type": "CityJSONFeature", "id": name, "CityObjects": {name: one}}
        lines.append({**feature, "vertices": whole["vertices"]})
    return write(tmp_path / "city.city.jsonl", lines)


def test_every_format_gives_the_same_buildings(town: Path) -> None:
    found = only(read_city_model(town))
    assert found.crs == "EPSG:28992"
    assert found.columns["id"].tolist() == ["b0", "b1"]
    assert found.height_m == pytest.approx([9.0, 7.0], abs=1e-6)
    assert area_m2(found.geometry) == pytest.approx([80.0, 364.0], rel=3e-4)
    assert len(shapely.get_rings(found.geometry[1])) == 2
    assert found.unreadable == ()
    mesh = mesh_of(decode_solid(found.solid[0]))
    assert mesh.volume == pytest.approx(600.0, rel=3e-4)
    assert np.abs(open_edges(mesh)[..., 2]).max() == 0
    # The second one is its ground plan raised, so that it needs no mesh.
    assert found.solid[1] is None


def test_roofs_look_up_and_walls_sideways(town: Path) -> None:
    solid = decode_solid(only(read_city_model(town)).solid[0])
    mesh = mesh_of(solid)
    is_roof = solid.kind[solid.triangles[:, 0]] == ROOF
    assert (solid.kind[solid.triangles] == np.where(is_roof, ROOF, WALL)[:, None]).all()
    slope = np.cos(np.arctan2(3, 4))
    assert mesh.face_normals[is_roof, 2] == pytest.approx(slope, abs=1e-3)
    assert mesh.face_normals[~is_roof, 2] == pytest.approx(0, abs=1e-3)
    assert mesh.area_faces[is_roof].sum() == pytest.approx(100.0, rel=3e-4)
    assert solid.roof_m == pytest.approx(7.5, abs=1e-3)


def test_a_flat_surface_shares_its_vertices_and_an_edge_does_not(tmp_path: Path) -> None:
    found = only(read_city_model(write(tmp_path / "a.json", document(gable()))))
    solid = decode_solid(found.solid[0])
    # Two walls and two roofs of four corners, two gable walls of five; no floor.
    assert len(solid.place) == 4 * 4 + 2 * 5
    assert len(solid.triangles) == 4 * 2 + 2 * 3


@pytest.mark.parametrize("kind", ["Solid", "MultiSurface"])
@pytest.mark.parametrize("turn", [False, True])
@pytest.mark.parametrize("said", [False, True])
def test_what_is_inside_out_is_turned(
    tmp_path: Path, kind: str, *, turn: bool, said: bool
) -> None:
    body = gable().inside_out() if turn else gable()
    whole = document(body)
    shape = geometry(body, 0, kind)
    if not said:
        del shape["semantics"]
    whole["CityObjects"]["b0"]["geometry"] = [shape]
    found = only(read_city_model(write(tmp_path / "a.json", whole)))
    assert mesh_of(decode_solid(found.solid[0])).volume == pytest.approx(600, rel=3e-4)
    assert area_m2(found.geometry) == pytest.approx([80.0], rel=3e-4)


def test_of_contradicting_faces_both_sides_are_drawn(tmp_path: Path) -> None:
    body = gable()
    body.faces[1][0].reverse()
    found = only(read_city_model(write(tmp_path / "a.json", document(body))))
    mesh = mesh_of(decode_solid(found.solid[0]))
    assert mesh.volume == pytest.approx(0, abs=1e-3)
    assert mesh.area == pytest.approx(2 * (100 + 2 * 60 + 2 * (48 + 12)), rel=3e-4)


def test_a_building_has_the_geometry_of_its_parts(tmp_path: Path) -> None:
    whole = document(box(30, 30, 20), gable(), court().moved(10, 0, 0))
    house, *parts = whole["CityObjects"].values()
    house["geometry"][0]["lod"] = "1"
    house["children"] = ["b1", "b2"]
    for part in parts:
        part |= {"type": "BuildingPart", "parents": ["b0"]}
    found = only(read_city_model(write(tmp_path / "a.json", whole)))
    assert found.columns["parts"].tolist() == [2]
    assert found.columns["storeys"].tolist() == [1]
    assert area_m2(found.geometry) == pytest.approx([444.0], rel=3e-4)
    volume = mesh_of(decode_solid(found.solid[0])).volume
    assert volume == pytest.approx(600 + 5 * 364, rel=3e-4)
    assert found.height_m == pytest.approx([9.0])


def test_parts_of_citygml_are_one_building_too(tmp_path: Path) -> None:
    part = building(linked_solid(gable().moved(*RD), "p"), "p0", "bldg:BuildingPart")
    inside = (
        f"{plain_solid(box(30, 30, 20).moved(*RD))}"
        f"<bldg:consistsOfBuildingPart>{part}</bldg:consistsOfBuildingPart>"
    )
    found = only(read_city_model(gml(tmp_path, city_gml(building(inside)))))
    assert found.columns["parts"].tolist() == [1]
    mesh = mesh_of(decode_solid(found.solid[0]))
    assert mesh.volume == pytest.approx(600, rel=3e-4)


def test_the_finest_usual_level_of_detail_is_taken(tmp_path: Path) -> None:
    whole = document(gable())
    house = whole["CityObjects"]["b0"]
    coarse = geometry(box(10, 8, 7), len(whole["vertices"]), lod="1.2")
    whole["vertices"] += np.rint(box(10, 8, 7).vertices * 1000).astype(int).tolist()
    for lod, height_m in [("2.2", 9.0), ("3.0", 7.0), ("0", 7.0)]:
        house["geometry"] = [geometry(gable(), 0, lod=lod), coarse]
        found = only(read_city_model(write(tmp_path / "a.json", whole)))
        assert found.height_m == pytest.approx([height_m])


def test_surfaces_that_say_what_they_are_win_over_a_solid_that_does_not(
    tmp_path: Path,
) -> None:
    whole = document(gable())
    house = whole["CityObjects"]["b0"]
    told = geometry(gable(), 0, "MultiSurface")
    told["semantics"]["surfaces"] = [{"type": "WallSurface"}] * 3
    silent = geometry(gable(), 0)
    del silent["semantics"]
    house["geometry"] = [silent, told]
    found = only(read_city_model(write(tmp_path / "a.json", whole)))
    assert not decode_solid(found.solid[0]).kind.any()


def test_lod1_of_citygml_is_a_prism(tmp_path: Path) -> None:
    body = court(8.8).moved(*RD)
    text = city_gml(building(plain_solid(body)), version="1.0")
    found = only(read_city_model(gml(tmp_path, text)))
    assert found.solid[0] is None
    assert found.height_m == pytest.approx([8.8])
    assert area_m2(found.geometry) == pytest.approx([364.0], rel=3e-4)


def as_pos(text: str) -> str:
    """Return GML with a `pos` for each point."""

    def spelt(found: re.Match[str]) -> str:
        values = found[1].split()
        points = [" ".join(values[k : k + 3]) for k in range(0, len(values), 3)]
        return "".join(f"<gml:pos>{point}</gml:pos>" for point in points)

    return re.sub("<gml:posList>(.*?)</gml:posList>", spelt, text)


def as_coordinates(text: str) -> str:
    """Return GML 2, with commas."""

    def spelt(found: re.Match[str]) -> str:
        values = found[1].split()
        points = [",".join(values[k : k + 3]) for k in range(0, len(values), 3)]
        return f"<gml:coordinates>{' '.join(points)}</gml:coordinates>"

    return re.sub("<gml:posList>(.*?)</gml:posList>", spelt, text)


def as_version_3(text: str) -> str:
    """Return CityGML 3.0, where surfaces are at a `boundary`."""
    return text.replace("bldg:boundedBy", "boundary").replace("/2.0", "/3.0")


def with_one_turned(text: str) -> str:
    """Return the solid with one of its faces turned over twice."""
    face = gable().faces[1]
    turned = polygon(gable().moved(*RD), [face[0][::-1]], "t")
    surface = (
        f'<gml:OrientableSurface orientation="-"><gml:baseSurface>{turned}'
        "</gml:baseSurface></gml:OrientableSurface>"
    )
    return text.replace(polygon(gable().moved(*RD), face, "s_1"), surface)


@pytest.mark.parametrize("spelt", [as_pos, as_coordinates, as_version_3, with_one_turned])
def test_every_spelling_of_citygml_is_the_same_building(
    tmp_path: Path, spelt: Callable[[str], str]
) -> None:
    text = city_gml(building(linked_solid(gable().moved(*RD), "s")))
    assert spelt(text) != text
    plain = only(read_city_model(gml(tmp_path, text)))
    found = only(read_city_model(gml(tmp_path, spelt(text))))
    ours, known = (mesh_of(decode_solid(one.solid[0])) for one in (found, plain))
    assert ours.volume == pytest.approx(600, rel=3e-4)
    assert ours.area == pytest.approx(known.area)
    assert area_m2(found.geometry) == pytest.approx(area_m2(plain.geometry))


def test_links_out_of_a_building_are_counted(tmp_path: Path) -> None:
    body = gable().moved(*RD)
    first, second = linked_solid(body, "s"), linked_solid(body, "s")
    second = second.replace("#s_1", "#elsewhere").replace("#s_2", "other.gml#s_2")
    text = city_gml(building(first), building(second, "b1"))
    found = only(read_city_model(gml(tmp_path, text)))
    assert found.warnings == ("city.gml: 2 links to surfaces of other objects lost",)
    assert len(found.feature) == 2


def test_buildings_of_several_crs_come_in_parts_of_one(tmp_path: Path) -> None:
    bodies = [gable().moved(*RD), gable().moved(367_180.0, 5_808_060.0, 40.0)]
    envelopes = [
        f'<gml:boundedBy><gml:Envelope srsName="{srs}"/></gml:boundedBy>'
        for srs in ("EPSG:7415", "EPSG:25833")
    ]
    objects = [
        building(envelope + linked_solid(body, f"s{k}"), f"b{k}")
        for k, (envelope, body) in enumerate(zip(envelopes, bodies, strict=True))
    ]
    parts = list(read_city_model(gml(tmp_path, city_gml(*objects, srs=""))))
    assert [part.crs for part in parts] == ["EPSG:28992", "EPSG:25833"]
    assert [part.feature.tolist() for part in parts] == [[0], [1]]


def test_corners_are_within_5_mm_of_pyproj(tmp_path: Path) -> None:
    body = gable().scaled(20.0)
    for code, x, y in [(25833, 500_000.0, 7_200_000.0), (2056, 2_680_000.0, 1_245_000.0)]:
        whole = document(body, crs=f"EPSG:{code}", at=(x, y, 0.0))
        found = only(read_city_model(write(tmp_path / "a.json", whole)))
        west, south, east, north = shapely.bounds(found.geometry).T
        middle = (west + east) / 2, (south + north) / 2
        drawn = solid_prisms([found.solid[0]], *middle, np.zeros(1), np.zeros(1)).ecef
        turn = pyproj.Transformer.from_crs(code, 4326, always_xy=True)
        lon, lat = turn.transform(*(body.vertices[:, :2] + (x, y)).T)
        globe = pyproj.Transformer.from_crs(4979, 4978, always_xy=True)
        known = np.column_stack(globe.transform(lon, lat, body.vertices[:, 2]))
        apart = np.linalg.norm(drawn[:, None] - known, axis=2)
        assert apart.min(axis=1).max() < 0.005
        assert apart.min(axis=0).max() < 0.005


def test_the_footprint_is_repaired_already_so_that_its_middle_stays(
    tmp_path: Path,
) -> None:
    found = only(read_city_model(write(tmp_path / "a.json", document(gable(), court()))))
    again = repair(found.geometry)
    assert not again.was_repaired.any()
    assert shapely.equals_identical(again.polygon, found.geometry).all()


def test_feet_become_metres(tmp_path: Path) -> None:
    feet = gable().scaled(1 / 0.3048006096012192)
    for crs in ("EPSG:2263+6360", "EPSG:2263"):
        whole = document(feet, crs=crs, at=(990_000.0, 200_000.0, 30.0))
        found = only(read_city_model(write(tmp_path / "a.json", whole)))
        assert found.height_m == pytest.approx([9.0], abs=1e-3)
        assert area_m2(found.geometry) == pytest.approx([80.0], rel=1e-3)
        assert len(found.warnings) == (crs == "EPSG:2263")


def test_overhanging_roofs_are_within_the_stated_width(tmp_path: Path) -> None:
    body = gable()
    roof = box(14, 8, 1).moved(-2, 0, 6)
    both = document(body, roof)
    part = both["CityObjects"].pop("b1")["geometry"][0]
    del part["semantics"]
    both["CityObjects"]["b0"]["geometry"].append(part)
    found = only(read_city_model(write(tmp_path / "a.json", both)))
    assert widths_m(found.solid.tolist()) >= 14 * 0.999


def test_other_objects_are_named_and_counted(tmp_path: Path) -> None:
    whole = document(gable(), court(), box(1, 1, 1))
    whole["CityObjects"]["b1"]["type"] = "TINRelief"
    whole["CityObjects"]["b2"]["geometry"] = []
    found = only(read_city_model(write(tmp_path / "a.json", whole)))
    assert found.feature.tolist() == [0]
    assert found.unreadable == ((1, "TINRelief: not a building"), (2, "no geometry"))


def test_parts_are_at_most_so_large_and_number_on(tmp_path: Path) -> None:
    bodies = [gable().moved(20 * k, 0, 0) for k in range(5)]
    path = write(tmp_path / "a.json", document(*bodies))
    parts = list(read_city_model(path, at_most=2))
    assert [part.feature.tolist() for part in parts] == [[0, 1], [2, 3], [4]]


def test_gzip_is_read_as_well(town: Path) -> None:
    packed = town.with_name(town.name + ".gz")
    packed.write_bytes(gzip.compress(town.read_bytes()))
    plain, unpacked = only(read_city_model(town)), only(read_city_model(packed))
    assert plain.solid.tolist() == unpacked.solid.tolist()
    assert is_city_model(town.read_bytes()[:65536], packed.name)


def test_attributes_are_flat_and_complete(tmp_path: Path) -> None:
    found = only(read_city_model(write(tmp_path / "a.json", document(gable()))))
    assert found.columns["storeys"].tolist() == [1]
    assert json.loads(found.columns["use"][0]) == ["home", 0]
    generic = (
        "<gen:stringAttribute name='street'><gen:value>Spui</gen:value>"
        "</gen:stringAttribute><gen:doubleAttribute name='rent'><gen:value>7.5"
        "</gen:value></gen:doubleAttribute><bldg:measuredHeight uom='m'>9.5"
        "</bldg:measuredHeight><bldg:function>1000</bldg:function>"
        "<bldg:function>1010</bldg:function>"
    )
    text = city_gml(building(generic + plain_solid(gable().moved(*RD), 2)))
    columns = only(read_city_model(gml(tmp_path, text))).columns
    assert {name: values[0] for name, values in columns.items()} == {
        "street": "Spui",
        "rent": 7.5,
        "measuredHeight": 9.5,
        "function": '["1000", "1010"]',
        "id": "b0",
    }


def test_rare_attributes_share_a_column(tmp_path: Path) -> None:
    whole = document(gable())
    names = {f"a{k}": k for k in range(600)}
    whole["CityObjects"]["b0"]["attributes"] = names
    columns = only(read_city_model(write(tmp_path / "a.json", whole))).columns
    rest = json.loads(columns.pop("other_attributes")[0])
    kept = {name: values[0] for name, values in columns.items()}
    assert len(columns) == 500
    assert {**kept, **rest} == {**names, "id": "b0"}


@pytest.mark.parametrize(
    ("head", "name", "expected"),
    [
        (b'{"type": "CityJSON", "version"', "a.json", True),
        (b' {"CityObjects" : {', "a.json", True),
        (b'\xef\xbb\xbf<?xml ?><c xmlns="http://www.opengis.net/citygml/2.0">', "a", True),
        (b'{"vertices": [[1, 2, 3]', "a.city.json", True),
        (b'{"type": "FeatureCollection", "features": []', "a.city.json", False),
        (b'{"type": "CityJSONExtension"', "a.json", False),
        (b"<gml:FeatureCollection>", "a.gml", False),
        (b"SQLite format 3\0", "a.gpkg", False),
        (b"", "a.city.json", False),
    ],
)  # fmt: skip
def test_a_city_model_is_known_by_its_first_bytes(
    head: bytes, name: str, *, expected: bool
) -> None:
    assert is_city_model(head, name) is expected


def test_a_city_model_has_no_layers(town: Path) -> None:
    with pytest.raises(InputError, match="no layers"):
        next(read_city_model(town, layer="buildings"))


def test_a_bridge_without_a_floor_is_seen_from_above(tmp_path: Path) -> None:
    deck = Body(
        np.array([(0, 0, 1), (30, 0, 1.2), (30, 6, 1.2), (0, 6, 1), (0, 0, 4), (30, 0, 4)]),
        [[[3, 2, 1, 0]], [[0, 1, 5, 4]]],
        ["RoadSurface", "WallSurface"],
    )
    whole = document(deck)
    whole["CityObjects"]["b0"] |= {
        "type": "Bridge",
        "geometry": [geometry(deck, 0, "MultiSurface")],
    }
    found = only(read_city_model(write(tmp_path / "a.json", whole)))
    mesh = mesh_of(decode_solid(found.solid[0]))
    assert mesh.face_normals[:, 2].max() == pytest.approx(1.0, abs=1e-3)
    assert area_m2(found.geometry) == pytest.approx([180.0], rel=1e-3)


def test_a_house_across_the_antimeridian_is_one_and_stays_home(tmp_path: Path) -> None:
    utm = pyproj.Transformer.from_crs(4326, 32760, always_xy=True)
    x, y = utm.transform(180.0, -16.5)
    for by in (-2.0, -5.0, -8.0):
        whole = document(gable(), crs="EPSG:32760", at=(x + by, y, 30.0))
        path = write(tmp_path / "a.json", whole)
        found = only(read_city_model(path))
        assert not found.unreadable
        assert area_m2(found.geometry) == pytest.approx([80.0], rel=5e-3)
        assert widths_m(found.solid.tolist()) == pytest.approx([10.0], abs=0.5)
        rows = features_of((packed(found), HeightRules())).rows
        assert -180 <= rows.lon_deg[0] < 180
        middle = (rows.lon_deg[0] - 180) % 360
        assert min(middle, 360 - middle) < 1e-4
        assert rows.height_m == pytest.approx([9.0])


def down_and_west(found: Footprints) -> tuple[float, float]:
    """Return how much of a solid looks down and how much to the west, m2."""
    solid = decode_solid(found.solid[0])
    corner = solid.place.astype(float)[solid.triangles]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]) / 2
    west_m2, _, down_m2 = -np.minimum(normal, 0).sum(axis=0)
    return down_m2, west_m2


def test_where_a_wall_is_missing_the_others_are_seen_from_inside(tmp_path: Path) -> None:
    whole = gable()
    west = 4
    gap = replace(
        whole,
        faces=[face for k, face in enumerate(whole.faces) if k != west],
        kinds=[kind for k, kind in enumerate(whole.kinds) if k != west],
    )
    for body, roofs_m2 in [(whole, 0.0), (gap, 80.0)]:
        model = document(body)
        surface = geometry(body, 0, "MultiSurface")
        model["CityObjects"]["b0"]["geometry"] = [surface]
        found = only(read_city_model(write(tmp_path / "a.json", model)))
        down_m2, west_m2 = down_and_west(found)
        assert down_m2 == pytest.approx(roofs_m2, abs=0.1)
        # The gable is as large as the one that is not there; the grid is a bit askew.
        assert west_m2 == pytest.approx(60, abs=4)


def test_a_floor_on_a_slope_is_drawn(tmp_path: Path) -> None:
    slab = box(10, 8, 3)
    steep = replace(slab, vertices=slab.vertices + slab.vertices[:, :1] * (0, 0, 0.2))
    found = only(read_city_model(write(tmp_path / "a.json", document(steep))))
    assert down_and_west(found)[0] == pytest.approx(80, abs=0.1)
    level = only(read_city_model(write(tmp_path / "b.json", document(gable()))))
    assert down_and_west(level)[0] == pytest.approx(0, abs=0.1)

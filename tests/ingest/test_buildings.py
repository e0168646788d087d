# SPDX-License-Identifier: Apache-2.0
"""`ingest buildings` end to end: numbers add up, a crash changes nothing."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio.raw
import pytest
import shapely

from ingest.buildings import (
    BuildingOptions,
    ingest_buildings,
    rebuild_objects,
    remove_buildings,
)
from tiles import cells, geodesy
from tiles.check import faults_of
from tiles.errors import InputError
from tiles.lanes import Lane
from tiles.objects import PROXY_ORDINAL, decode
from tiles.store import Store
from tiles.writer import Writer

SAMPLE = Path(__file__).parents[2] / "data_samples" / "sanfrancisco_buildings.gpkg"
DEGREE_M = 111_194.0


def ring(x: float, y: float, width: float = 15.0) -> list[list[float]]:
    """A square in metres from longitude 9, latitude 0."""
    corners = [(0, 0), (width, 0), (width, width), (0, width), (0, 0)]
    return [[9 + (x + a) / DEGREE_M, (y + b) / DEGREE_M] for a, b in corners]


def feature(
    coordinates: list[Any], kind: str = "Polygon", **properties: object
) -> dict[str, Any]:
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def write(path: Path, *features: dict[str, Any]) -> Path:
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return path


@pytest.fixture
def village(tmp_path: Path) -> Path:
    """40 houses, a doubled one, a bow tie, one tiny, a point and one without geometry."""
    houses = [feature([ring(20 * k, 0)], height=5 + k, name=f"é{k}") for k in range(40)]
    bow = [[[9, 1e-3], [9.0002, 1.2e-3], [9.0002, 1e-3], [9, 1.2e-3], [9, 1e-3]]]
    odd = [
        feature([ring(0, 0)[::-1]], height=3),
        feature(bow, est_height="high"),
        feature([ring(0, 300, 0.1)]),
        feature([9, 0], "Point"),
        {"type": "Feature", "properties": {}, "geometry": None},
    ]
    return write(tmp_path / "village.geojson", *houses, *odd)


def ids_in_tiles(store: Store) -> list[int]:
    found: list[int] = []
    for record in store.index(Lane.OBJECTS):
        if record["row"]:
            body = store.checked_body(
                Lane.OBJECTS, int(record["cell"]), int(record["row"]), int(record["check"])
            )
            found += decode(body).objects["id"].tolist()
    return sorted(found)


def rows(store: Store, columns: str, order: str = "id") -> list[Any]:
    query = f"SELECT {columns} FROM object ORDER BY {order}"
    return store.connection.execute(query).fetchall()


def test_the_numbers_add_up_and_every_stored_building_is_in_a_tile(
    tmp_path: Path, village: Path
) -> None:
    report = ingest_buildings(tmp_path / "w.geopage", [village], BuildingOptions())
    assert (report["read"], report["stored"]) == (45, 41)
    assert (report["merged"], report["skipped"], report["repaired"]) == (1, 3, 1)
    assert report["skipped_by_reason"] == {
        "smaller than 0.5 m2": 1,
        "not a polygon": 1,
        "no geometry": 1,
    }
    heights = report["heights"]
    assert (heights["from_attribute"], heights["default"]) == (40, 1)
    assert heights["unreadable_value"] == 1
    assert report["floating"] == report["sunk"] == 0
    assert "no terrain" in report["warnings"][0]
    with Store(tmp_path / "w.geopage") as store:
        assert ids_in_tiles(store) == [row[0] for row in rows(store, "id")]
        source = store.sources("buildings")[0]
        assert source["name"] == "village"
        assert ["village.geojson", 42, "smaller than 0.5 m2"] in source["not_stored"]


def test_attributes_places_and_heights_are_those_of_the_source(
    tmp_path: Path, village: Path
) -> None:
    ingest_buildings(tmp_path / "w.geopage", [village], BuildingOptions())
    with Store(tmp_path / "w.geopage") as store:
        found = rows(store, "cell, lon_deg, lat_deg, height_m, footprint, attributes")
    kept = [json.loads(row[5]) for row in found]
    assert kept[:40] == [{"height": 5 + k, "name": f"é{k}"} for k in range(40)]
    assert kept[40] == {"est_height": "high"}
    for k, (cell, lon, lat, height, wkb, _) in enumerate(found[:40]):
        assert shapely.from_wkb(wkb).equals(shapely.Polygon(ring(20 * k, 0)))
        assert height == 5 + k
        assert cells.cell_at(np.radians(lon), np.radians(lat), cells.level(cell)) == cell


def test_the_same_source_again_replaces_itself_and_others_stay(
    tmp_path: Path, village: Path
) -> None:
    store = tmp_path / "w.geopage"
    other = write(tmp_path / "other.geojson", feature([ring(0, 500)], height=9))
    ingest_buildings(store, [village], BuildingOptions())
    ingest_buildings(store, [other], BuildingOptions())
    ingest_buildings(store, [village], BuildingOptions())
    with Store(store) as read:
        names = [row[0] for row in rows(read, "source")]
        assert (names.count("village"), names.count("other")) == (41, 1)
        assert ids_in_tiles(read) == [row[0] for row in rows(read, "id")]
    write(village, feature([ring(0, 0)], height=9))
    ingest_buildings(store, [village], BuildingOptions())
    with Store(store) as read:
        assert len(ids_in_tiles(read)) == 2


def test_a_removed_source_is_gone(tmp_path: Path, village: Path) -> None:
    store = tmp_path / "w.geopage"
    other = write(tmp_path / "other.geojson", feature([ring(0, 500)], height=9))
    ingest_buildings(store, [village, other], BuildingOptions())
    assert remove_buildings(store, "village")["objects"] == 1
    with Store(store) as read:
        assert [source["name"] for source in read.sources()] == ["other"]
        assert len(ids_in_tiles(read)) == 1


def test_without_its_last_source_the_lane_is_empty(tmp_path: Path, village: Path) -> None:
    ingest_buildings(tmp_path / "w.geopage", [village], BuildingOptions())
    assert remove_buildings(tmp_path / "w.geopage", "village")["objects"] == 0
    with Store(tmp_path / "w.geopage") as read:
        assert len(read.index(Lane.OBJECTS)) == 0


def test_files_under_one_name_are_one_source_without_repeats(
    tmp_path: Path, village: Path
) -> None:
    more = write(
        tmp_path / "more.geojson",
        feature([ring(0, 0)], height=50, roof="flat"),
        feature([ring(0, 600)], height=2),
    )
    report = ingest_buildings(
        tmp_path / "w.geopage", [village, more], BuildingOptions(name="all")
    )
    assert (report["read"], report["stored"], report["merged"]) == (47, 42, 2)
    with Store(tmp_path / "w.geopage") as store:
        found = rows(store, "source, attributes")
    assert {row[0] for row in found} == {"all"}
    assert [json.loads(row[1]).get("roof") for row in found].count("flat") == 1


def plane(lon_rad: np.ndarray, lat_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ground at 200 m, rising 1 in 10 to the east, known to 0.3 m."""
    del lat_rad
    return 200 + (np.degrees(lon_rad) - 9) * DEGREE_M / 10, np.full(len(lon_rad), 0.3)


def test_buildings_stand_on_the_ground_and_walls_reach_below_it(
    tmp_path: Path, village: Path
) -> None:
    store = tmp_path / "w.geopage"
    report = ingest_buildings(store, [village], BuildingOptions(), ground=plane)
    assert report["floating"] == 0
    assert report["plinth_max_m"] == pytest.approx(1.0)
    assert not report["warnings"]
    with Store(store) as read:
        base = np.array([row[0] for row in rows(read, "base_m")])
        assert base[:40] == pytest.approx(200 + 2 * np.arange(40))
        lowest, highest = np.inf, -np.inf
        for record in read.index(Lane.OBJECTS):
            if record["row"]:
                tile = decode(read.body(int(record["row"])))
                own = tile.mesh.vertices["detail"][:, 1] != PROXY_ORDINAL
                ecef = (tile.mesh.local + tile.mesh.centre)[own]
                height = geodesy.to_geodetic(ecef)[2]
                if not len(height):
                    continue
                lowest, highest = min(lowest, height.min()), max(highest, height.max())
    assert lowest == pytest.approx(200 - 1.0, abs=0.2)
    assert highest == pytest.approx(200 + 2 * 39 + 44, abs=0.2)


def test_new_ground_moves_buildings_and_raised_parts_keep_their_height(
    tmp_path: Path,
) -> None:
    bridge = feature([ring(0, 0)], height=12, min_height=8, name="bridge")
    path = write(tmp_path / "a.geojson", bridge, feature([ring(50, 0)], height=4))
    store = tmp_path / "w.geopage"
    ingest_buildings(store, [path], BuildingOptions())
    with Store(store) as read:
        assert rows(read, "base_m, height_m") == [(8.0, 4.0), (0.0, 4.0)]
    with Writer(store) as writer:
        rebuild_objects(writer, plane)
        rebuild_objects(writer, plane)
    with Store(store) as read:
        found = rows(read, "base_m, height_m")
        assert found[0] == pytest.approx((208, 4))
        assert found[1] == pytest.approx((205, 4))


def test_a_failure_leaves_the_store_as_it_was(
    tmp_path: Path, village: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = tmp_path / "w.geopage"
    ingest_buildings(store, [village], BuildingOptions())
    with Store(store) as read:
        before = list(read.connection.iterdump())

    def crash(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Writer, "put_source", crash)
    write(village, feature([ring(0, 0)], height=9))
    with pytest.raises(KeyboardInterrupt):
        ingest_buildings(store, [village], BuildingOptions())
    with Store(store) as read:
        assert list(read.connection.iterdump()) == before
    with pytest.raises(KeyboardInterrupt):
        ingest_buildings(tmp_path / "new.geopage", [village], BuildingOptions())
    with Store(tmp_path / "new.geopage") as read:
        assert not read.object_count()
        assert not list(faults_of(read))


def test_one_bad_file_among_several_writes_nothing(tmp_path: Path, village: Path) -> None:
    bad = tmp_path / "bad.geojson"
    bad.write_text('{"type": "Feature"')
    with pytest.raises(InputError, match=r"bad\.geojson"):
        ingest_buildings(tmp_path / "w.geopage", [village, bad], BuildingOptions())
    assert not (tmp_path / "w.geopage").exists()


def test_a_name_that_terrain_has_is_refused(tmp_path: Path, village: Path) -> None:
    store = tmp_path / "w.geopage"
    with Writer(store) as writer:
        writer.put_source("village", "terrain", {})
    with pytest.raises(InputError, match=r"village: terrain source.*--name"):
        ingest_buildings(store, [village], BuildingOptions())


def test_the_report_file_holds_what_was_not_stored_as_it_came(
    tmp_path: Path, village: Path
) -> None:
    def pit(lon_rad: np.ndarray, lat_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        x = (np.degrees(lon_rad) - 9) * DEGREE_M
        edge = (np.abs(x - 27.5) < 1) & (np.abs(np.degrees(lat_rad)) * DEGREE_M < 1)
        return np.where(edge, -9.0, 0.0), 0 * lat_rad

    out = tmp_path / "look.gpkg"
    options = BuildingOptions(report=out)
    report = ingest_buildings(tmp_path / "w.geopage", [village], options, ground=pit)
    ingest_buildings(tmp_path / "w.geopage", [village], options, ground=pit)
    assert report["lifted"] == 1
    meta, _, wkb, columns = pyogrio.raw.read(out)
    found = dict(zip(meta["fields"], columns, strict=True))
    remarks = dict(zip(found["remark"], found["feature"], strict=True))
    assert remarks["lifted"] == 1
    assert remarks["repaired"] == 41
    assert remarks["not a polygon"] == 43
    assert len(wkb) == 4 + 1 + 1
    with pytest.raises(InputError, match=r"look\.txt: can't be written"):
        ingest_buildings(
            tmp_path / "x.geopage", [village], BuildingOptions(report=tmp_path / "look.txt")
        )


def test_progress_counts_up_to_the_end(tmp_path: Path, village: Path) -> None:
    heard: list[tuple[int, int, str]] = []
    ingest_buildings(
        tmp_path / "w.geopage",
        [village],
        BuildingOptions(),
        lambda done, total, what: heard.append((done, total, what)),
    )
    assert heard
    assert all(0 < done <= total for done, total, _ in heard)
    assert heard[-1][0] == heard[-1][1]


def test_the_same_footprint_in_another_part_of_a_file_is_merged_the_tallest_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ingest.buildings.PART_FEATURES", 3)
    heights = [3, 9, 4, 9, 2, 5, 1, 7]
    houses = [
        feature([ring(40 * (k % 2), 0)], height=h, k=k) for k, h in enumerate(heights)
    ]
    path = write(tmp_path / "a.geojson", *houses)
    report = ingest_buildings(tmp_path / "w.geopage", [path], BuildingOptions())
    assert (report["read"], report["stored"], report["merged"]) == (8, 2, 6)
    assert report["heights"]["from_attribute"] == 2
    with Store(tmp_path / "w.geopage") as store:
        found = [json.loads(row[0])["k"] for row in rows(store, "attributes")]
        assert found == [1, 2]
        listed = store.sources("buildings")[0]["not_stored"]
    assert sorted(one[1] for one in listed) == [0, 3, 4, 5, 6, 7]


def test_ids_are_not_used_again_while_readers_may_hold_old_tiles(
    tmp_path: Path, village: Path
) -> None:
    ingest_buildings(tmp_path / "w.geopage", [village], BuildingOptions())
    with Store(tmp_path / "w.geopage") as store:
        before = {row[0] for row in rows(store, "id")}
    ingest_buildings(tmp_path / "w.geopage", [village], BuildingOptions())
    with Store(tmp_path / "w.geopage") as store:
        assert not before & {row[0] for row in rows(store, "id")}


def test_houses_across_the_antimeridian_share_cells_with_their_neighbours(
    tmp_path: Path,
) -> None:
    def at(lon: float) -> list[list[float]]:
        east = [lon, lon + 2e-4, lon + 2e-4, lon, lon]
        return [[x, y] for x, y in zip(east, [5, 5, 5.0002, 5.0002, 5], strict=True)]

    lons = [180.0003, -179.9993, 179.99995, 179.9995]
    path = write(tmp_path / "fiji.geojson", *(feature([at(x)], height=6) for x in lons))
    report = ingest_buildings(tmp_path / "w.geopage", [path], BuildingOptions())
    assert report["read"] == report["stored"] + report["skipped"]
    with Store(tmp_path / "w.geopage") as store:
        found = rows(store, "lon_deg, footprint, cell")
        for lon, wkb, cell in found:
            west, _, east, _ = shapely.from_wkb(wkb).bounds
            assert -180 <= lon < 180
            assert west < lon < east
            assert east - west < 1e-3
            at_rad = np.radians((lon, 5.0001))
            assert cells.cell_at(*at_rad, cells.level(cell)) == cell
        for record in store.index(Lane.OBJECTS):
            if record["row"]:
                tile = decode(store.body(int(record["row"])))
                assert np.abs(tile.mesh.local).max() < 2000
        assert not list(faults_of(store))


def everything(path: Path) -> tuple[list[Any], dict[int, bytes]]:
    """The object table, and the tiles that the index names."""
    with Store(path) as store:
        index = store.index(Lane.OBJECTS)
        bodies = {int(r["cell"]): store.body(int(r["row"])) for r in index if r["row"]}
        return rows(store, "*"), bodies


@pytest.mark.slow
def test_tiles_are_the_same_for_any_number_of_processes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ingest.buildings.PART_FEATURES", 500)
    monkeypatch.setattr("ingest.object_build.BRANCH_OBJECTS", 300)
    monkeypatch.setattr("ingest.object_build.FEW_OBJECTS", 0)
    monkeypatch.setattr("ingest.buildings.FEW_OBJECTS", 0)
    houses = [feature([ring(25 * (k % 40), 30 * (k // 40))], height=4) for k in range(1200)]
    path = write(tmp_path / "town.geojson", *houses)
    for workers in (1, 2):
        options = BuildingOptions(workers=workers)
        report = ingest_buildings(tmp_path / f"{workers}.geopage", [path], options)
        assert report["stored"] == report["objects"] == 1200
    assert everything(tmp_path / "1.geopage") == everything(tmp_path / "2.geopage")


@pytest.mark.slow
def test_the_sample_city_is_stored_whole(tmp_path: Path) -> None:
    report = ingest_buildings(tmp_path / "sf.geopage", [SAMPLE], BuildingOptions())
    assert report["read"] == report["stored"] + report["merged"] + report["skipped"]
    assert report["read"] > 10_000
    assert report["skipped"] < 20
    assert report["heights"]["from_attribute"] > 10_000
    assert (
        16 <= report["objects_per_cell"]["mean"] <= report["objects_per_cell"]["max"] <= 64
    )
    with Store(tmp_path / "sf.geopage") as store:
        assert len(ids_in_tiles(store)) == report["stored"]

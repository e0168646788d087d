# SPDX-License-Identifier: Apache-2.0
"""Reports on how buildings stand, against shapely and a search level by level."""

import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from ingest.buildings import BuildingOptions, ingest_buildings
from ingest.cli import reground
from ingest.grounding import THRESHOLD_RATIO, ground_objects
from ingest.grounding_report import Levels, Standing, described, lines, look
from ingest.terrain import ingest_rasters, silent
from tests.viewer.hill_city import (
    ELLIPSOID,
    SIDE,
    add_ground,
    add_houses,
    write_houses,
)
from tiles.store import Store
from tiles.surface import Surface


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a store with rough ground, and of houses; not to be changed."""
    folder = tmp_path_factory.mktemp("hills")
    add_ground(folder, folder / "ground.geopage")
    shutil.copy(folder / "ground.geopage", folder / "city.geopage")
    add_houses(folder, folder / "city.geopage")
    return folder


def standing_in(store: Store) -> Standing:
    rows = store.connection.execute(
        "SELECT id, footprint, raised_m, height_m FROM object ORDER BY cell"
    ).fetchall()
    number, wkb, raised, height = zip(*rows, strict=True)
    polygon = np.asarray(shapely.from_wkb(np.array(wkb, object)), object)
    return Standing(np.array(number), polygon, np.array(raised), np.array(height))


def level_report(store: Store, chunks: Iterable[Standing]) -> dict[str, Any]:
    """Report on buildings given in chunks, with the ids that float or are sunk."""
    surface, found = Surface(store), Levels()
    for chunk in chunks:
        found = found + look(surface, chunk)
    noted = {"floating": found.floating, "sunk": found.sunk}
    return {**described(store, found), "noted": noted}


def part(standing: Standing, which: slice) -> Standing:
    fields = standing.id, standing.polygon, standing.raised_m, standing.height_m
    return Standing(*(one[which] for one in fields))


def test_each_level_counts_what_floats_and_is_sunk_on_its_own_terrain(
    folder: Path,
) -> None:
    with Store(folder / "city.geopage") as store:
        surface, houses = Surface(store), standing_in(store)
        found = level_report(store, [houses])
        place = ground_objects(
            houses.polygon, surface.heights, houses.height_m, surface.lowest
        )
        roof_m, foot_m = place.low_m + houses.height_m, place.foot_m(houses.raised_m)
        deepest = max(one["level"] for one in found["levels"])
        for one in found["levels"][:4]:
            sunk, floating, count = 0, 0, 0
            for k, polygon in enumerate(houses.polygon):
                edge = shapely.get_coordinates(polygon.boundary.segmentize(4e-5))
                lon, lat = np.radians(edge).T
                rows = surface.up_to(surface.rows(lon, lat), one["level"])
                metres = shapely.bounds(polygon) * 111_000
                wide = max((metres[2] - metres[0]) * 0.707, metres[3] - metres[1])
                within = THRESHOLD_RATIO * max(wide, houses.height_m[k])
                coarse = one["level"] < deepest
                if coarse and surface.selected_m[rows].max() > within:
                    continue
                height_m = surface.heights_in(rows, lon, lat)
                count += 1
                floating += foot_m[k] - height_m.min() > 0.5
                sunk += height_m.max() - roof_m[k] > 0.5
            assert abs(count - one["buildings"]) <= 2  # rough metres above
            assert one["floating"]["count"] == floating == 0
            assert abs(sunk - one["sunk"]["count"]) <= 2
    assert found["looked_at"] == SIDE * SIDE
    assert len(found["noted"]["floating"]) == len(found["noted"]["sunk"]) == 0
    assert sum(one["sunk"]["count"] for one in found["levels"]) > 5


def test_no_level_is_off_by_more_than_the_threshold_on_the_screen(folder: Path) -> None:
    with Store(folder / "city.geopage") as store:
        found = level_report(store, [standing_in(store)])
    for one in found["levels"]:
        for fault in ("floating", "sunk", "hidden"):
            for worst in one[fault]["worst"]:
                assert worst["m"] > 0.5
                assert worst["px_per_threshold_px"] < 1.2  # m upwards, not of distance
                assert worst["name"].startswith("house ")
    text = lines(found)
    assert any("are sunk by > 0.5 m" in line for line in text)
    assert not any(" float " in line for line in text)


def test_chunks_add_up_to_the_whole(folder: Path) -> None:
    with Store(folder / "city.geopage") as store:
        houses = standing_in(store)
        pieces = [part(houses, slice(k, k + 50)) for k in range(0, SIDE * SIDE, 50)]
        chunked = level_report(store, [*pieces, part(houses, slice(0, 0))])
        whole = level_report(store, [houses])
    for one in (chunked, whole):
        one["noted"] = {remark: ids.tolist() for remark, ids in one["noted"].items()}
    assert chunked == whole


def test_buildings_on_another_ground_are_reported_as_floating_or_sunk(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Store(folder / "city.geopage") as store:
        surface, houses = Surface(store), standing_in(store)
        for wrong_m, fault in ((10.0, "floating"), (-40.0, "sunk")):

            def elsewhere(*asked: object, by_m: float = wrong_m) -> object:
                polygon, _, top_m, _ = asked
                return ground_objects(
                    polygon, lambda x, y: (surface.heights(x, y)[0] + by_m, None), top_m
                )

            monkeypatch.setattr("ingest.grounding_report.ground_objects", elsewhere)
            found = look(surface, houses)
            deepest = max(found.level)
            assert len(getattr(found, fault)) == SIDE * SIDE
            faults = getattr(found.level[deepest], fault)
            assert faults.count == SIDE * SIDE
            assert len(faults.worst) == 5
            assert np.isnan([share for _, share, _ in faults.worst]).all()
    assert Levels().looked_at == 0


def base_m(path: Path) -> dict[str, float]:
    with Store(path) as store:
        name = "json_extract(attributes, '$.name')"
        asked = f"SELECT {name}, base_m FROM object ORDER BY cell"
        return dict(store.connection.execute(asked).fetchall())


def test_terrain_that_arrives_later_grounds_the_houses_again(
    folder: Path, tmp_path: Path
) -> None:
    store, houses = tmp_path / "later.geopage", write_houses(tmp_path / "houses.geojson")
    ingest_buildings(store, [houses], BuildingOptions())
    assert set(base_m(store).values()) == {0.0}
    found = []
    for name in ("around", "city"):
        ingest_rasters(store, [(folder / f"{name}.tif", ELLIPSOID)], workers=1)
        assert reground(store, silent)["grounded"] == SIDE * SIDE
        found.append(base_m(store))
        with Store(store) as opened:
            houses_now = standing_in(opened)
            place = ground_objects(
                houses_now.polygon, Surface(opened).heights, houses_now.height_m
            )
            assert list(found[-1].values()) == pytest.approx(place.low_m)
            assert all(
                one["floating"]["count"] == 0
                for one in level_report(opened, [houses_now])["levels"]
            )
    moved_m = [abs(found[1][name] - found[0][name]) for name in found[0]]
    assert np.median(moved_m) > 0.5

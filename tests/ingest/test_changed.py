# SPDX-License-Identifier: Apache-2.0
"""What comes, goes or is replaced changes the tiles around it, and no others."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from ingest import terrain_build, terrain_pyramid
from ingest.mosaic import Mosaic
from ingest.source_group import groups_of
from ingest.terrain import ingest_rasters, remove_raster
from ingest.terrain_tile import inner_bound_m
from ingest.truth import Truth, truth_of
from tests.ingest.rasters import EGM96, UTM, hills, north_up, write
from tiles.check import faults_of
from tiles.lanes import Lane
from tiles.store import Store

FILES = ("wide", "near", "beside", "inner")
INNER = north_up(660_000.0, 5_125_000.0, 50.0)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A coarse source, two finer ones that share an edge in it, and one in the first."""
    folder = tmp_path_factory.mktemp("files")
    utm = {"near": (656_000.0, 300), "beside": (656_000.0 + 39 * 300, 300)}
    found = {
        "wide": write(
            folder / "wide.tif",
            hills((110, 110), 1.0, 400.0),
            north_up(10.2, 47.1, 0.02),
            "EPSG:4326",
        )
    }
    for name, (east, step) in utm.items():
        posts = hills((40, 40), 0.6, 250.0) + np.float32(300)
        found[name] = write(
            folder / f"{name}.tif", posts, north_up(east, 5_130_000.0, step), UTM
        )
    posts = hills((24, 24), 0.2, 90.0)
    found["inner"] = write(folder / "inner.tif", posts, INNER, UTM)
    return found


def ingest(store: Path, *paths: Path) -> dict[str, Any]:
    return ingest_rasters(store, [(path, EGM96) for path in paths], workers=1)


@pytest.fixture(scope="module")
def at_once(files: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("once") / "world.geopage"
    ingest(path, *(files[name] for name in FILES))
    return path


def copy_of(path: Path, folder: Path) -> Path:
    world = folder / "world.geopage"
    world.write_bytes(path.read_bytes())
    return world


def leaves(path: Path) -> tuple[NDArray[np.void], NDArray[np.void]]:
    """Return index records of leaves and of cells above them, in order."""
    with Store(path) as store:
        records = store.index(Lane.TERRAIN)
        assert list(faults_of(store)) == []
    records = records[np.argsort(records["cell"])]
    is_leaf = records["children"] == 0
    return records[is_leaf], records[~is_leaf]


def assert_same_world(one: Path, other: Path) -> None:
    """Leaves are the same to the byte; cells above are as close as they have to be."""
    (a, above_a), (b, above_b) = leaves(one), leaves(other)
    np.testing.assert_array_equal(a["cell"], b["cell"])
    np.testing.assert_array_equal(a["check"], b["check"])
    np.testing.assert_array_equal(above_a["cell"], above_b["cell"])
    for record in above_b:
        assert record["error_m"] <= inner_bound_m(int(record["cell"])) * (1 + 1e-6)


@pytest.mark.slow
def test_one_by_one_makes_the_same_leaves_as_all_at_once(
    files: dict[str, Path], at_once: Path, tmp_path: Path
) -> None:
    """The innermost comes before what lies around it, and neighbours one by one."""
    world = tmp_path / "world.geopage"
    for names in (("wide", "inner"), ("near",), ("beside",)):
        ingest(world, *(files[name] for name in names))
    assert_same_world(at_once, world)


@pytest.mark.slow
def test_what_was_removed_and_comes_again_leaves_no_trace(
    files: dict[str, Path], at_once: Path, tmp_path: Path
) -> None:
    world = copy_of(at_once, tmp_path)
    remove_raster(world, "wide", workers=1)
    ingest(world, files["wide"])
    assert_same_world(at_once, world)


@pytest.mark.slow
def test_an_inset_leaves_the_tiles_of_what_it_stands_in(
    files: dict[str, Path], at_once: Path, tmp_path: Path
) -> None:
    world = copy_of(at_once, tmp_path)
    removed = remove_raster(world, "inner", workers=1)
    assert 0 < removed["tiles_made"] < removed["tiles"] / 4
    other = write(tmp_path / "inner.tif", hills((20, 20), 0.4, 70.0), INNER, UTM)
    for file in (other, files["inner"]):
        report = ingest(world, file)
        more = report["tiles"] - removed["tiles"]
        assert more < report["tiles_made"] < more + report["tiles"] / 4
    assert_same_world(at_once, world)


@pytest.mark.slow
def test_posts_of_unchanged_parts_are_not_held_against_what_their_tiles_are(
    files: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Cells above many parts: their errors still hold, and few leaves are measured."""
    monkeypatch.setattr(terrain_build, "PART_LEAVES", 4)
    measured: list[int] = []

    def counted(mosaic: Mosaic, cell: int, *how: int) -> Truth:
        measured.append(cell)
        return truth_of(mosaic, cell, *how)

    monkeypatch.setattr(terrain_pyramid, "truth_of", counted)
    whole, world = tmp_path / "whole.geopage", tmp_path / "world.geopage"
    ingest(whole, files["wide"], files["inner"])
    at_once = len(measured)
    ingest(world, files["wide"])
    measured.clear()
    ingest(world, files["inner"])
    assert 0 < len(measured) < at_once / 2
    assert_same_world(whole, world)
    above, again = leaves(whole)[1], leaves(world)[1]
    assert len(above) > 10
    assert (again["error_m"] >= above["error_m"] * (1 - 1e-6)).all()


def test_sources_far_apart_are_no_group() -> None:
    alps, beside, andes = (6, 45, 7, 46), (7, 45, 8, 46), (-70, -30, -69, -29)
    coarse = 18_000.0, (-180.0, -90.0, 180.0, 90.0)
    placed = [(90.0, alps), (90.0, andes), coarse, (91.0, beside)]
    assert groups_of(placed) == [[2], [3, 0], [1]]

# SPDX-License-Identifier: Apache-2.0
"""An ingest that is interrupted or killed, at whatever moment, goes on where it was."""

import json
import os
import signal
import sys
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geopage.cli import guarded, main
from ingest import terrain_build
from ingest.boxes import touches
from ingest.cli import ingest
from ingest.journal import made_by
from ingest.mosaic import Mosaic
from ingest.terrain import ingest_rasters, remove_raster
from ingest.terrain_pyramid import Made, Part, ZoneBuilder
from tests.ingest.rasters import EGM96, coarse, hills, north_up, write
from tiles import cells
from tiles.check import faults_of
from tiles.codec import checksum
from tiles.errors import InputError
from tiles.index_tree import INDEX
from tiles.lanes import Lane
from tiles.raster_blocks import Blocks
from tiles.store import Store
from tiles.writer import Writer

FILES = ("coarse.tif", "inset.tif")


class Quick:
    """Makes tiles of one height each, four parts in a zone with data: no time is lost."""

    def __init__(self, mosaic: Mosaic, *_: object) -> None:
        self._mosaic = mosaic
        self._boxes = [layer.bounds_deg for layer in mosaic.layers]

    def cut(self, root: int, most: int) -> list[int]:
        assert most > 1
        small = touches(root, self._boxes)
        return [int(one) for one in cells.children(root)] if small else [root]

    def build_part(self, cell: int, *_: object) -> tuple[list[Made], Part]:
        above = [
            int(cells.ancestor(cell, level)) for level in range(int(cells.level(cell)))
        ]
        part = Part(cell, 1.0, 0.0, 1.0, dict.fromkeys(above, 2.0))
        return [self._made(cell, 1.0, 0)], part

    def build(self, root: int, parts: Iterable[Part], *_: object) -> list[Made]:
        return [self._made(root, max(part.above[root] for part in parts), 15)]

    def _made(self, cell: int, error_m: float, children: int) -> Made:
        west, south, east, north = cells.bounds_rad(cell)
        lon, lat = np.array([(west + east) / 2]), np.array([(south + north) / 2])
        body = f"{cell} {self._mosaic.heights(lon, lat, 0.0)[0]:.3f}".encode()
        record = np.zeros(1, INDEX)
        record["cell"], record["error_m"], record["children"] = cell, error_m, children
        record["check"] = checksum(Lane.TERRAIN, cell, body)
        return Made(record, body)


class Stop(BaseException):
    """Ends an ingest like Ctrl-C."""


def run(folder: Path, store: Path, stop: int = -1) -> dict[str, Any]:
    """Ingest both files; stop after so many steps."""
    steps, meshes = 0, False

    def told(_: int, __: int, what: str) -> None:
        nonlocal steps, meshes
        if what == "meshing terrain" and not meshes:
            meshes = True  # it says what there is to do before the first step
            return
        steps += 1
        if steps == stop:
            raise Stop

    files = [(folder / name, EGM96) for name in FILES]
    report = ingest_rasters(store, files, told, workers=1)
    return {**report, "steps": steps}


def seen(path: Path) -> tuple[bytes, list[dict[str, Any]]]:
    """What readers see, but for the names of rows and copies."""
    with Store(path) as store:
        index, sources = store.index(Lane.TERRAIN), store.sources()
        for one in index:
            key = int(one["cell"]), int(one["row"]), int(one["check"])
            assert store.checked_body(Lane.TERRAIN, *key)
        assert store.connection.execute("PRAGMA quick_check").fetchone() == ("ok",)
    index["row"] = 0
    return index.tobytes(), [{**source, "blocks": ""} for source in sources]


def leftovers(path: Path) -> tuple[int, ...]:
    """Count tiles that no index names, copies that no source names, and notes."""
    with Store(path) as store:
        rows = {int(row) for lane in Lane for row in store.index(lane)["row"]}
        ask = store.connection.execute
        old = {row for (row,) in ask("SELECT row FROM retired")}
        held = {row for (row,) in ask("SELECT row FROM tile")} - old
        keys = {source.get("blocks") for source in store.sources()}
        copies = {key for (key,) in ask("SELECT DISTINCT source FROM raster_block")}
        notes = ask("SELECT COUNT(*) FROM unfinished").fetchone()[0]
    return len(held - rows), len(copies - keys), int(notes)


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make tiles quickly; and nobody edits the code between two runs of a test."""
    monkeypatch.setattr(terrain_build, "ZoneBuilder", Quick)
    monkeypatch.setattr(terrain_build, "made_by", lambda *folders: "this")


@pytest.fixture
def whole(nested_folder: Path, tmp_path: Path) -> Any:
    """What an ingest without interruption sees and says."""
    path = tmp_path / "whole.geopage"
    report = run(nested_folder, path)
    return seen(path), report


@pytest.mark.parametrize("share", [0.02, 0.3, 0.6, 0.98])
def test_what_was_done_is_not_done_again(
    share: float, nested_folder: Path, tmp_path: Path, whole: Any
) -> None:
    store = tmp_path / "world.geopage"
    stop = max(1, int(share * whole[1]["steps"]))
    with pytest.raises(Stop):
        run(nested_folder, store, stop)
    assert seen(store) == (b"", [])
    report = run(nested_folder, store)
    assert report["steps"] == whole[1]["steps"] - stop
    assert seen(store) == whole[0]
    assert leftovers(store) == (0, 0, 0)
    made = report["tiles_made"], report["tiles_taken_over"]
    assert sum(made) == whole[1]["tiles_made"]
    assert made[1] > 0 or share < 0.5
    same = ("read", "stored", "skipped", "skipped_by_reason", "sources", "tiles")
    assert [report[key] for key in same] == [whole[1][key] for key in same]


def forked(work: Callable[[], int], number: int, after_s: float) -> int:
    """Run in a process of its own that gets a signal after some time; its exit status."""
    begun, begin = os.pipe()
    child = os.fork()
    if not child:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        os.write(begin, b"!")
        try:
            os._exit(work())
        finally:
            os._exit(99)
    os.read(begun, 1)
    time.sleep(after_s)
    os.kill(child, number)
    os.close(begun)
    os.close(begin)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


forks = pytest.mark.skipif(sys.platform != "linux", reason="forks")


@forks
@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_killed_again_and_again_it_arrives_at_the_same(
    number: int,
    nested_folder: Path,
    tmp_path: Path,
    whole: Any,
    monkeypatch: pytest.MonkeyPatch,
    rng: np.random.Generator,
) -> None:
    """At random moments, in a new store, through the command."""
    monkeypatch.setattr("os.cpu_count", lambda: 1)
    store = tmp_path / "world.geopage"
    files = [str(nested_folder / name) for name in FILES]
    words = ["terrain", str(store), *files, "--datum", "egm96", "--bare"]
    longest_s = whole[1]["seconds"]
    ends = []
    for _ in range(4):
        after_s = rng.uniform(0.0, 0.2 * longest_s)
        ends.append(forked(lambda: guarded(ingest, words), number, after_s))
        if store.exists():
            seen(store)
        if ends[-1] == 0:
            break
    assert set(ends) <= {0, -number if number == signal.SIGKILL else 130}
    assert len(ends) > 1
    if 0 not in ends:
        assert (
            forked(lambda: guarded(ingest, words), signal.SIGURG, 0.0) == 0
        )  # a signal of no effect
    assert seen(store) == whole[0]
    assert leftovers(store)[:2] == (0, 0)


@forks
def test_an_interruption_is_one_line_and_the_new_store_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Also the sample earth is taken up again when the first ingest goes on."""
    given: list[int] = []

    def begin(store: Path, files: list[Any], _: object) -> dict[str, Any]:
        given.append(len(files))
        Writer(store).close()
        raise KeyboardInterrupt

    monkeypatch.setattr("ingest.cli.ingest_rasters", begin)
    store = tmp_path / "world.geopage"
    words = ["ingest", "terrain", str(store), str(coarse(tmp_path / "a.tif"))]
    for _ in range(2):
        assert main([*words, "--datum", "egm96"]) == 130
        assert store.exists()
        out, err = capsys.readouterr()
        assert out == ""
        assert err == "geopage: interrupted: run the same command again to go on\n"
    assert given == [3, 3]


def test_another_ingest_takes_away_what_was_left(
    nested_folder: Path, tmp_path: Path, whole: Any
) -> None:
    store = tmp_path / "world.geopage"
    with pytest.raises(Stop):
        run(nested_folder, store, int(0.9 * whole[1]["steps"]))
    lost = leftovers(store)
    assert min(lost) > 0
    ingest_rasters(store, [(nested_folder / "coarse.tif", EGM96)], workers=1)
    assert leftovers(store) == (0, 0, 0)
    with pytest.raises(Stop):
        run(nested_folder, store, 3)
    remove_raster(store, "coarse", workers=1)
    assert leftovers(store) == (0, 0, 0)
    with Store(store) as opened:
        assert opened.sources() == []
    seen(store)


def test_a_file_that_has_changed_is_read_again(tmp_path: Path) -> None:
    store, file = tmp_path / "world.geopage", tmp_path / "a.tif"
    posts = hills((20, 20), 1.0, 100.0)
    write(file, posts, north_up(11.0, 46.5, 0.01), "EPSG:4326")

    def stop(_: int, __: int, what: str) -> None:
        if what.startswith("meshing"):
            raise Stop

    with pytest.raises(Stop):
        ingest_rasters(store, [(file, EGM96)], stop, workers=1)
    write(file, posts + 1000, north_up(11.0, 46.5, 0.01), "EPSG:4326")
    os.utime(file, ns=(1, 1))
    report = ingest_rasters(store, [(file, EGM96)], workers=1)
    assert report["tiles_taken_over"] == 0
    with Store(store) as opened:
        (source,) = opened.sources()
        blocks = Blocks(opened.connection, source["blocks"], (20, 20))
        assert blocks.window(0, 0, 20, 0, 20).min() > 900
    assert leftovers(store) == (0, 0, 0)


def test_with_other_code_parts_are_made_again(
    nested_folder: Path, tmp_path: Path, whole: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = tmp_path / "world.geopage"
    with pytest.raises(Stop):
        run(nested_folder, store, int(0.9 * whole[1]["steps"]))
    monkeypatch.setattr(terrain_build, "made_by", lambda *folders: "another")
    report = run(nested_folder, store)
    assert report["tiles_taken_over"] == 0
    assert seen(store) == whole[0]
    assert leftovers(store) == (0, 0, 0)


def test_what_an_ingest_was_about_to_use_is_not_swapped_away_unnoticed(
    nested_folder: Path, tmp_path: Path
) -> None:
    """Another command finishes while this one meshes."""
    store = tmp_path / "world.geopage"
    run(nested_folder, store)

    def other(_: int, __: int, what: str) -> None:
        if what.startswith("meshing"):
            remove_raster(store, "inset", workers=1)

    with pytest.raises(InputError, match="another command changed it"):
        ingest_rasters(store, [(nested_folder / "coarse.tif", EGM96)], other, workers=1)
    with Store(store) as opened:
        assert [one["name"] for one in opened.sources()] == ["coarse"]
    seen(store)


@pytest.mark.slow
def test_real_tiles_are_the_same_after_an_interruption(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(terrain_build, "ZoneBuilder", ZoneBuilder)
    for name in FILES:
        write(
            tmp_path / name, hills((20, 20), 1.0, 90.0), north_up(11, 46, 0.01), "EPSG:4326"
        )
    stores = tmp_path / "a.geopage", tmp_path / "b.geopage"
    steps = run(tmp_path, stores[0])["steps"]
    with pytest.raises(Stop):
        run(tmp_path, stores[1], steps - 4)
    report = run(tmp_path, stores[1])
    assert 0 < report["tiles_made"] < report["tiles"]
    assert seen(stores[0]) == seen(stores[1])
    with Store(stores[1]) as opened:
        assert list(faults_of(opened)) == []


@pytest.mark.slow
def test_when_only_the_buildings_are_left_the_terrain_is_not_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("os.cpu_count", lambda: 1)
    monkeypatch.setattr(terrain_build, "ZoneBuilder", ZoneBuilder)
    store, town = tmp_path / "town.geopage", tmp_path / "town.geojson"
    ring = [[11, 46], [11.001, 46], [11.001, 46.001], [11, 46.001], [11, 46]]
    shape = {"type": "Polygon", "coordinates": [ring]}
    feature = {"type": "Feature", "properties": {"h": 3}, "geometry": shape}
    town.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    words = ["ingest", "buildings", str(store), str(town), "--height", "h", "--bare"]
    assert main(words) == 0
    file = str(coarse(tmp_path / "a.tif"))
    words = ["ingest", "terrain", str(store), file, "--datum", "egm96", "--json"]

    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr("ingest.cli.rebuild_objects", interrupt)
        assert main(words) == 130
    generation = meta(store)
    capsys.readouterr()
    assert main(words) == 0
    report = json.loads(capsys.readouterr().out)
    assert meta(store) == generation + 1  # the buildings alone
    assert report["grounded"] == 1
    assert report["tiles"] > 0
    assert main(words) == 0
    assert meta(store) == generation + 3
    capsys.readouterr()


def meta(path: Path) -> int:
    with Store(path) as store:
        return int(store.meta("generation"))


def test_code_is_known_by_what_it_says(tmp_path: Path) -> None:
    (tmp_path / "a.py").write_text("one")
    before = made_by(tmp_path)
    assert made_by(tmp_path) == before
    (tmp_path / "a.py").write_text("two")
    assert made_by(tmp_path) != before

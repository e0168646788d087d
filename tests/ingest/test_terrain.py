# SPDX-License-Identifier: Apache-2.0
"""Ingest of rasters into one store: replaced, removed, refused, killed, never half done."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from numpy.typing import NDArray
from rasterio.windows import Window

from ingest import terrain as ingest_terrain
from ingest.terrain import RasterOptions, ingest_rasters, remove_raster
from ingest.terrain_tile import inner_bound_m
from tests.ingest.rasters import (
    EGM96,
    NORTH,
    SIDE,
    STEP,
    WEST,
    coarse,
    inset,
    north_up,
    write,
)
from tests.tiles.places import uv_in_cell
from tiles import cells, terrain
from tiles.check import faults_of
from tiles.errors import InputError
from tiles.lanes import Lane
from tiles.samples import SAMPLES
from tiles.store import Store
from tiles.surface import Surface

IMAGERY = RasterOptions("imagery")


def ingest(store: Path, *files: Path, options: RasterOptions = EGM96) -> dict[str, object]:
    return ingest_rasters(store, [(file, options) for file in files], workers=1)


def heights(path: Path, rng: np.random.Generator) -> NDArray[np.float64]:
    lon = np.radians(rng.uniform(WEST, WEST + SIDE * STEP, 500))
    lat = np.radians(rng.uniform(NORTH - SIDE * STEP, NORTH, 500))
    with Store(path) as store:
        return Surface(store).heights(lon, lat)[0]


def state(path: Path) -> tuple[bytes, list[dict[str, object]]]:
    """What readers see."""
    with Store(path) as store:
        return store.index(Lane.TERRAIN).tobytes(), store.sources()


@pytest.fixture
def world(nested_folder: Path, tmp_path: Path) -> Path:
    """A copy of the nested world."""
    path = tmp_path / "world.geopage"
    path.write_bytes((nested_folder / "world.geopage").read_bytes())
    return path


def test_the_same_source_again_replaces_itself(world: Path, nested_folder: Path) -> None:
    with Store(world) as store:
        before = store.index(Lane.TERRAIN)
        count = store.connection.execute("SELECT COUNT(*) FROM raster_block").fetchone()
    ingest(world, nested_folder / "inset.tif")
    with Store(world) as store:
        after = store.index(Lane.TERRAIN)
        assert [source["name"] for source in store.sources()] == ["coarse", "inset"]
        again = store.connection.execute("SELECT COUNT(*) FROM raster_block").fetchone()
    # A cell above tiles that stay is meshed from all of their vertices.
    leaf = before["children"] == 0
    np.testing.assert_array_equal(before["cell"], after["cell"])
    for field in ("error_m", "check", "radius_m"):
        np.testing.assert_array_equal(before[field][leaf], after[field][leaf])
    np.testing.assert_allclose(before["error_m"], after["error_m"], rtol=0.05)
    assert count == again


def test_a_finer_source_leaves_far_tiles_alone_and_removing_it_restores_the_rest(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    world = tmp_path / "world.geopage"
    ingest(world, coarse(tmp_path / "coarse.tif"))
    before, seed = heights(world, np.random.default_rng(1)), rng.integers(99)
    with Store(world) as store:
        old = {int(r["cell"]): int(r["row"]) for r in store.index(Lane.TERRAIN)}
    ingest(world, inset(tmp_path / "inset.tif"))
    with Store(world) as store:
        new = {int(r["cell"]): int(r["row"]) for r in store.index(Lane.TERRAIN)}
        assert list(faults_of(store)) == []
    kept = [cell for cell in old if new.get(cell) == old[cell]]
    made = {cell for cell in new if new[cell] not in old.values()}
    near = int(cells.cell_at(np.radians(11.15), np.radians(46.1), 0))
    assert len(kept) > 40
    assert all(cells.ancestor(cell, 0) == near for cell in made)
    assert np.abs(heights(world, np.random.default_rng(1)) - before).max() > 50
    remove_raster(world, "inset", workers=1)
    np.testing.assert_allclose(
        heights(world, np.random.default_rng(1)), before, atol=1e-6, err_msg=str(seed)
    )
    with Store(world) as store:
        assert [source["name"] for source in store.sources()] == ["coarse"]
        assert list(faults_of(store)) == []


def test_errors_stay_honest_when_only_a_part_is_made_again(
    nested_folder: Path, tmp_path: Path
) -> None:
    """Kept leaves count in the errors of the ancestors that are made again."""
    fresh = tmp_path / "fresh.geopage"
    ingest(fresh, nested_folder / "coarse.tif", nested_folder / "inset.tif")
    grown = tmp_path / "grown.geopage"
    ingest(grown, nested_folder / "coarse.tif")
    ingest(grown, nested_folder / "inset.tif")
    with Store(fresh) as one, Store(grown) as other:
        a, b = one.index(Lane.TERRAIN), other.index(Lane.TERRAIN)
    np.testing.assert_array_equal(a["cell"], b["cell"])
    np.testing.assert_allclose(a["error_m"], b["error_m"], rtol=1e-5)


def test_inner_tiles_keep_their_bound_at_a_pole(tmp_path: Path) -> None:
    west, north, columns, rows = -135.0, -76.0, 270, 84
    with rasterio.open(SAMPLES / "earth.tif") as earth:
        row, col = earth.index(west + 0.01, north - 0.01)
        posts = earth.read(1, window=Window(col, row, columns, rows))
        assert row + rows == earth.height
    file = tmp_path / "cap.tif"
    write(file, posts, north_up(west, north, 1 / 6), "EPSG:4326")
    ingest(tmp_path / "cap.geopage", file, options=RasterOptions(datum="ellipsoid"))
    with Store(tmp_path / "cap.geopage") as store:
        records = store.index(Lane.TERRAIN)
    inner = records[records["children"] > 0]
    assert len(inner) > 5
    assert all(one["error_m"] <= inner_bound_m(int(one["cell"])) for one in inner)


def test_removing_the_last_source_leaves_the_sea(tmp_path: Path) -> None:
    world = tmp_path / "world.geopage"
    ingest(world, coarse(tmp_path / "coarse.tif"))
    remove_raster(world, "coarse", workers=1)
    with Store(world) as store:
        assert store.sources() == []
        assert len(store.index(Lane.TERRAIN)) == 32
        height, error = Surface(store).heights(np.radians([11.0]), np.radians([10.0]))
    assert abs(height[0] - 18) < error[0] < 4000


def picture(path: Path, colour: tuple[int, int, int], west: float, step: float) -> Path:
    posts = np.empty((3, 40, 40), np.uint8)
    posts[:] = np.array(colour, np.uint8)[:, None, None]
    return write(path, posts, north_up(west, 46.5, step), "EPSG:4326")


def test_a_tile_shows_the_picture_and_the_finer_picture_wins(tmp_path: Path) -> None:
    world = tmp_path / "world.geopage"
    flat = np.full((40, 40), 200, np.int16)
    ground = write(tmp_path / "ground.tif", flat, north_up(10.5, 46.8, 0.05), "EPSG:4326")
    ingest(world, ground)
    wide = picture(tmp_path / "wide.tif", (40, 60, 220), 10.8, 0.005)
    detail = picture(tmp_path / "detail.tif", (230, 30, 30), 10.85, 0.002)
    ingest(world, wide, detail, options=IMAGERY)
    with Store(world) as store:
        found = {
            place: colour_at(store, np.radians(place[0]), np.radians(place[1]))
            for place in ((10.97, 46.35), (10.89, 46.46))
        }
        assert list(faults_of(store)) == []
    assert np.abs(found[10.97, 46.35] - [40, 60, 220]).max() < 25
    assert np.abs(found[10.89, 46.46] - [230, 30, 30]).max() < 25


def colour_at(store: Store, lon_rad: float, lat_rad: float) -> NDArray[np.float64]:
    """Mean of the two end colours of the BC1 block at a place, finest tile."""
    surface = Surface(store)
    row = surface.rows(np.array([lon_rad]), np.array([lat_rad]))[0]
    tile = terrain.decode(store.body(int(surface.forest.records["row"][row])))
    u, v = (float(w) for w in uv_in_cell(tile.cell, lon_rad, lat_rad))
    block = tile.texture[: terrain.MIP_BYTES[0]].reshape(64, 64, 8)[
        int(v * 64), int(u * 64)
    ]
    ends = block[:4].copy().view("<u2").astype(int)
    rgb = np.stack([ends >> 11 << 3, (ends >> 5 & 63) << 2, (ends & 31) << 3], axis=1)
    return np.asarray(rgb.mean(axis=0), np.float64)


@pytest.mark.parametrize("name", ["fresh", "world"])
def test_a_refused_source_leaves_the_store_as_it_was(
    name: str, world: Path, tmp_path: Path
) -> None:
    fresh = name == "fresh"
    path = tmp_path / "fresh.geopage" if fresh else world
    before = None if fresh else state(world)
    empty = write(
        tmp_path / "empty.tif",
        np.full((9, 9), -1, np.int16),
        north_up(2, 3, 0.1),
        "EPSG:4326",
        -1,
    )
    with pytest.raises(InputError, match=r"empty\.tif: holds no data"):
        ingest(path, coarse(tmp_path / "new.tif"), empty)
    assert not fresh or list(tmp_path.glob("fresh*")) == []
    assert fresh or state(world) == before


def test_a_name_can_not_change_its_kind_nor_be_given_twice(
    world: Path, tmp_path: Path
) -> None:
    colours = picture(tmp_path / "coarse.tif", (1, 2, 3), 0, 1)
    with pytest.raises(InputError, match=r"coarse\.tif: a terrain source called 'coarse'"):
        ingest(world, colours, options=IMAGERY)
    (tmp_path / "other").mkdir()
    with pytest.raises(InputError, match="another file is called 'a' too"):
        ingest(world, coarse(tmp_path / "a.tif"), coarse(tmp_path / "other" / "a.tif"))


@pytest.mark.parametrize("fresh", [False, True])
def test_two_ingests_at_once_do_not_lose_one_of_them(
    request: pytest.FixtureRequest,
    nested_folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    *,
    fresh: bool,
) -> None:
    """The second to finish is refused, the first is not silently undone."""
    world = tmp_path / "new.geopage" if fresh else request.getfixturevalue("world")
    third = coarse(tmp_path / "third.tif")
    real_copy = ingest_terrain.copy

    def copy_and_wait(*given: Any) -> Any:
        monkeypatch.setattr(ingest_terrain, "copy", real_copy)
        copied = real_copy(*given)
        ingest(world, nested_folder / "inset.tif")
        return copied

    monkeypatch.setattr(ingest_terrain, "copy", copy_and_wait)
    with pytest.raises(InputError, match="another command changed it"):
        ingest(world, third)
    with Store(world) as store:
        assert [source["name"] for source in store.sources()][-1] == "inset"


def test_an_ingest_whose_store_is_taken_away_does_not_say_that_all_is_well(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    world, real_copy = tmp_path / "new.geopage", ingest_terrain.copy

    def copy_and_lose(*given: Any) -> Any:
        copied = real_copy(*given)
        world.unlink()
        return copied

    monkeypatch.setattr(ingest_terrain, "copy", copy_and_lose)
    with pytest.raises(InputError, match="taken away meanwhile"):
        ingest(world, coarse(tmp_path / "third.tif"))


def wide(path: Path) -> Path:
    """Write a globe of few posts: every zone is made again."""
    posts = np.full((18, 36), 300, np.int16)
    return write(path, posts, north_up(-180, 90, 10), "EPSG:4326")


CHILD = """
import sys
from pathlib import Path
from ingest.terrain import RasterOptions, ingest_rasters
from geopage.cli import guarded

pause = sys.argv.pop(1) == "pause"

def run(words):
    def told(done, total, what):
        if done:
            print(what, flush=True)
        if done and pause:
            sys.stdin.readline()
    files = [(Path(word), RasterOptions(datum="egm96")) for word in words[1:]]
    ingest_rasters(words[0], files, told, workers=2)
    return 0

if __name__ == "__main__":
    sys.exit(guarded(run, sys.argv[1:]))
"""


def start(folder: Path, how: str, world: Path, file: Path) -> subprocess.Popen[str]:
    """Begin an ingest in a process of its own; `pause`: each step waits for a line."""
    script = folder / "child.py"
    script.write_text(CHILD)
    words = [sys.executable, str(script), how, str(world), str(file)]
    root = str(Path(__file__).parents[2])
    pipe = subprocess.PIPE
    return subprocess.Popen(
        words,
        stdin=pipe,
        stdout=pipe,
        stderr=pipe,
        text=True,
        env={**os.environ, "PYTHONPATH": root},
    )


def workers_of(process: int) -> set[int]:
    """Processes whose parent it is, in any state but dead."""
    found = set()
    for entry in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = entry.read_text().rsplit(")", 1)[1].split()
        except (FileNotFoundError, ProcessLookupError):
            continue
        if int(fields[1]) == process and fields[0] != "Z":
            found.add(int(entry.parent.name))
    return found


def gone(processes: set[int], limit_s: float) -> bool:
    end_s = time.monotonic() + limit_s
    while time.monotonic() < end_s:
        alive = {p for p in processes if Path(f"/proc/{p}/cmdline").exists()}
        if not {
            p for p in alive if "Z" not in Path(f"/proc/{p}/stat").read_text().split()[2]
        }:
            return True
    return False


linux = pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")


@linux
@pytest.mark.slow
@pytest.mark.parametrize("steps", [1, 2, 3, 5])
def test_a_killed_ingest_leaves_the_last_committed_state(
    steps: int, world: Path, tmp_path: Path
) -> None:
    before = state(world)
    child = start(tmp_path, "pause", world, wide(tmp_path / "wide.tif"))
    assert child.stdout is not None
    assert child.stdin is not None
    for step in range(steps):
        if step:
            child.stdin.write("\n")
            child.stdin.flush()
        assert child.stdout.readline()
    workers = workers_of(child.pid)
    child.kill()
    child.communicate()
    assert workers or steps == 1
    assert gone(workers, 5)
    assert state(world) == before
    with Store(world) as store:
        assert list(faults_of(store)) == []


@linux
@pytest.mark.slow
@pytest.mark.parametrize(
    ("how", "number"),
    [("pause", signal.SIGINT), ("run", signal.SIGINT), ("pause", signal.SIGTERM)],
)
def test_an_interrupted_ingest_stops_soon_with_one_line(
    how: str, number: int, world: Path, tmp_path: Path
) -> None:
    before = state(world)
    child = start(tmp_path, how, world, wide(tmp_path / "wide.tif"))
    assert child.stdout is not None
    assert child.stdin is not None
    child.stdout.readline()
    child.stdin.write("\n")
    child.stdin.flush()
    if how == "pause":  # in the middle of storing tiles; else while workers start
        child.stdout.readline()
    while not (workers := workers_of(child.pid)):
        assert child.poll() is None
    begun_s = time.monotonic()
    child.send_signal(number)
    _, errors = child.communicate(timeout=20)
    assert time.monotonic() - begun_s < 3
    assert child.returncode == 130
    assert errors.splitlines() == ["geopage: stopped; what was reported done is kept"]
    assert gone(workers, 2)
    assert state(world) == before


@linux
@pytest.mark.slow
def test_a_new_store_whose_worker_was_killed_keeps_what_was_done(tmp_path: Path) -> None:
    world = tmp_path / "world.geopage"
    child = start(tmp_path, "run", world, wide(tmp_path / "wide.tif"))
    assert child.stdout is not None
    while child.stdout.readline().strip() != "meshing terrain":
        assert child.poll() is None
    workers = [one for one in workers_of(child.pid) if "spawn_main" in command_of(one)]
    os.kill(workers[0], signal.SIGKILL)
    _, errors = child.communicate(timeout=60)
    assert child.returncode == 2
    assert "a worker process died; make more memory free" in errors
    with Store(world) as store:
        count = store.connection.execute("SELECT count(*) FROM unfinished").fetchone()[0]
    assert count > 0


def command_of(process: int) -> str:
    return Path(f"/proc/{process}/cmdline").read_text()


def test_no_worker_outlives_an_ingest(tmp_path: Path) -> None:
    world = tmp_path / "world.geopage"
    file = coarse(tmp_path / "coarse.tif")

    def fail(done: int, _: int, what: str) -> None:
        if done and what == "meshing terrain":
            raise InputError("test", "stop", "stop")

    with pytest.raises(InputError):
        ingest_rasters(world, [(file, EGM96)], fail, workers=2)
    assert multiprocessing.active_children() == []
    assert not world.exists()


def test_how_much_there_is_to_mesh_is_said_at_first_and_stays(tmp_path: Path) -> None:
    told: list[tuple[int, int]] = []

    def note(done: int, total: int, what: str) -> None:
        if what == "meshing terrain":
            told.append((done, total))

    ingest_rasters(tmp_path / "w.geopage", [(wide(tmp_path / "wide.tif"), EGM96)], note)
    totals = {total for _, total in told}
    assert len(totals) == 1
    done = [one for one, _ in told]
    assert (done[0], done[-1]) == (0, totals.pop())
    assert done == sorted(set(done))

# SPDX-License-Identifier: Apache-2.0
"""The bench on a small world: figures that must hold, whatever the machine."""

import csv
import json
import math
from contextlib import redirect_stdout
from io import StringIO
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from geopage.cli import main
from geopage.screen_error import lens_of, px_per_m
from geopage.settings import MIB, PagerSettings
from tests.viewer.small_world import make_store, write_path
from tiles.errors import InputError
from tiles.forest import build_forest
from tiles.index_tree import INDEX
from tiles.lanes import Lane
from viewer.bench import Bench, bench
from viewer.bench_chart import bench_chart
from viewer.bench_methods import METHODS, PACED, SETTLED, that_differ
from viewer.bench_modes import Hurried
from viewer.bench_score import Frame, KeyFrame, Scorer
from viewer.bench_table import COLUMNS, NAMES
from viewer.camera_path import read_path
from viewer.cli_bench import bench as command
from viewer.curve_labels import apart
from viewer.poses import Flight
from viewer.session import Picture, Session

pytestmark = pytest.mark.usefixtures("gl_context")
SIZE_PX = (96, 64)
Json = dict[str, Any]


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_store(tmp_path_factory.mktemp("world"))


@pytest.fixture(scope="module")
def path(store: Path) -> Path:
    return write_path(store.parent / "down.json", 0.25, (20_000.0, 300.0))


@pytest.fixture(scope="module")
def whole(store: Path, path: Path) -> tuple[Json, Path]:
    out = store.parent / "bench"
    words = ["--path", str(path), "--out", str(out), "--thresholds", "16,1", "--quick"]
    size = ["--size", "96x64", "--frames", "2", "--budget", "128", "--json"]
    with redirect_stdout(StringIO()) as printed:
        assert main(["bench", str(store), *words, *size]) == 0
    return json.loads(printed.getvalue()), out


def test_every_method_has_a_row_for_every_mode_and_threshold(
    whole: tuple[Json, Path],
) -> None:
    found = [(r["method"], r["mode"], r["threshold_px"]) for r in whole[0]["rows"]]
    assert found == [
        (method.name, mode, px)
        for method in METHODS
        for mode in method.modes
        for px in (1.0, 16.0)
        if mode == SETTLED or method.name == "geopage" or method.moves
    ]


def test_a_method_that_differs_only_in_motion_is_not_measured_standing_still() -> None:
    modes = {method.name: method.modes for method in METHODS}
    assert modes["geopage"] == (SETTLED, PACED)
    assert modes["by size and speed"] == (PACED,)
    assert modes["level by level"] == (PACED,)
    assert modes["without proxies"] == (SETTLED,)
    assert modes["RTIN"] == (SETTLED,)


def tiny(path: Path, out: Path, threshold_px: float = 8.0) -> Bench:
    px = (threshold_px,)
    return Bench(path, out, px, True, SIZE_PX, 128 * MIB, 2)  # noqa: FBT003


def lines_of(out: Path) -> list[str]:
    return (out / "results.csv").read_text().splitlines()


def rows_in(out: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(line for line in lines_of(out) if line[0] != "#"))


def is_timed(row: Json, name: str) -> bool:
    """Say whether a figure depends on the clock, so that it differs from run to run."""
    return bool(row["mode"] == "paced" or name.endswith("_ms"))


def test_settled_rows_are_the_same_twice_times_aside(
    store: Path, path: Path, tmp_path: Path, whole: tuple[Json, Path]
) -> None:
    still = [method for method in METHODS if SETTLED in method.modes]
    bench(store, tiny(path, tmp_path, 1.0), still)
    again = {(row["method"], row["mode"]): row for row in rows_in(tmp_path)}
    compared = 0
    for one in rows_in(whole[1]):
        if one["mode"] == SETTLED and one["threshold_px"] == "1":
            timeless = {name for name in NAMES if not is_timed(one, name)}
            assert {"error_p95_px", "flip_mean", "bytes"} <= timeless
            assert "frame_p50_ms" not in timeless
            other = again[one["method"], SETTLED]
            assert {n: one[n] for n in timeless} == {n: other[n] for n in timeless}
            compared += 1
    assert compared == len(still)


def test_a_coarser_threshold_costs_less_and_looks_less_like_the_reference(
    whole: tuple[Json, Path],
) -> None:
    fine, coarse = whole[0]["rows"][:2]
    assert fine["triangles"] > coarse["triangles"]
    # On the way down a coarser one reads inner cells that a finer one passes by.
    assert fine["bytes"] > 0.9 * coarse["bytes"]
    assert fine["objects"] >= coarse["objects"]
    assert fine["flip_mean"] < coarse["flip_mean"]
    # JSON has no infinity: null says that not a bit differs.
    assert (fine["psnr_db"] or math.inf) > coarse["psnr_db"]
    assert fine["error_p95_px"] <= coarse["error_p95_px"]


def test_settled_rows_keep_their_threshold_and_have_no_hole(
    whole: tuple[Json, Path],
) -> None:
    for row in whole[0]["rows"]:
        if row["mode"] == SETTLED and row["method"] in {"geopage", "buildings at 10 x"}:
            assert row["share_within_threshold"] == 1.0
            assert row["hole_frames"] == 0


def test_methods_that_differ_in_buildings_alone_have_the_same_terrain_error(
    whole: tuple[Json, Path],
) -> None:
    rows = {(r["method"], r["mode"], r["threshold_px"]): r for r in whole[0]["rows"]}
    for px in (1.0, 16.0):
        errors = {rows[m.name, SETTLED, px]["error_p99_px"] for m in METHODS[:3]}
        assert len(errors) == 1


def test_a_paced_row_has_its_floor_and_its_jank(whole: tuple[Json, Path]) -> None:
    for row in whole[0]["rows"]:
        assert (row["mode"] == PACED) == ("jank_ms" in row) == ("floor_p50_ms" in row)
        if row["mode"] == PACED:
            assert row["frame_p50_ms"] <= row["frame_p99_ms"] <= row["frame_max_ms"]
            assert row["bytes_read"] >= row["bytes"] > 0


def test_the_csv_names_the_machine_and_every_column_is_explained(
    whole: tuple[Json, Path],
) -> None:
    found, out = whole
    head = [line for line in lines_of(out) if line.startswith("#")]
    assert f"# gl renderer: {found['about']['gl_renderer']}" in head
    assert any(line.startswith("# commit: ") for line in head)
    table = rows_in(out)
    assert len(table) == len(found["rows"])
    assert tuple(table[0]) == NAMES
    page = (out / "index.html").read_text()
    assert all(f"<code>{column.name}</code>" in page for column in COLUMNS)
    assert found["about"]["machine"] in page
    assert "<td class=n>16<td" in page


def test_the_page_shows_worst_frames_that_are_there(whole: tuple[Json, Path]) -> None:
    page = (whole[1] / "index.html").read_text()
    pictures = sorted((whole[1] / "frames").iterdir())
    assert len(pictures) >= 3
    for picture in pictures:
        assert f"frames/{picture.name}" in page
        assert size_of(picture) == SIZE_PX


def test_the_chart_names_methods_units_and_machine(whole: tuple[Json, Path]) -> None:
    found, out = whole
    text = (out / "chart.svg").read_text()
    for method in METHODS:
        assert f"<!-- {method.name} -->" in text
    for words in ("time of a frame, ms", "MiB", found["about"]["gl_renderer"]):
        assert words in text
    assert size_of(out / "chart.png")[0] > 1000


def size_of(picture: Path) -> tuple[int, int]:
    with Image.open(picture) as opened:
        return opened.size


def test_a_chart_without_measured_terrain_shows_the_pictures_alone(
    whole: tuple[Json, Path], tmp_path: Path
) -> None:
    found = whole[0]
    rows = [
        {k: v for k, v in row.items() if not k.startswith("error_")}
        for row in found["rows"]
    ]
    bench_chart(rows, found["about"], [tmp_path / "c.svg"])
    text = (tmp_path / "c.svg").read_text()
    assert "FLIP" in text
    assert "error of the drawn ground" not in text


def test_the_reference_does_not_differ_from_itself(store: Path, path: Path) -> None:
    settings = PagerSettings(0.25, budget_bytes=128 * MIB)
    with Session(store, settings, Picture(SIZE_PX)) as session:
        view = Flight(read_path(path), session.surface, SIZE_PX).view(0.2)
        drawn = METHODS[0].draw_list(session.pager.forests, view, 0.25)
        frame = Frame(view, drawn)
        found = Scorer(session, 0.25).score([KeyFrame(frame, frame)], 0.25).figures()
    assert found["flip_mean"] == found["popping_mean"] == 0
    assert math.isinf(found["psnr_db"])


def test_without_proxies_every_tile_with_a_building_above_the_threshold_is_drawn(
    store: Path, path: Path
) -> None:
    with Session(store, PagerSettings(), Picture(SIZE_PX)) as session:
        view = Flight(read_path(path), session.surface, SIZE_PX).view(0.25)
        forests = session.pager.forests
    records, lens = forests[Lane.OBJECTS].records, lens_of(view)
    span_px = [
        record["own_dimension_m"] * px_per_m(lens, *record["centre"], record["radius_m"])
        for record in records
    ]
    bare = METHODS[2].draw_list(forests, view, 2.0)
    wanted = np.flatnonzero((np.array(span_px) > 2.0) & (records["row"] > 0))
    assert len(wanted) > 0
    assert sorted(bare.objects) == wanted.tolist()
    assert bare.own.all()
    assert not bare.proxies.any()
    assert records["proxies"].any()


def test_a_hurried_flight_sees_the_same_in_less_time(store: Path, path: Path) -> None:
    with Session(store, PagerSettings(), Picture(SIZE_PX)) as session:
        own = read_path(path)
        flight = Flight(own, session.surface, SIZE_PX)
        hurried = Hurried(own, session.surface, SIZE_PX, 0.1)
        assert hurried.path.duration_s == 0.1
        assert own.duration_s == 0.25
        for share in (0.0, 0.37, 1.0):
            a, b = flight.view(0.25 * share), hurried.view(0.1 * share)
            assert np.allclose(a.eye, b.eye, atol=1e-6)
            assert b.t_s == 0.1 * share


def test_labels_are_moved_apart_and_stay_in_order() -> None:
    found = apart([0.1, 0.11, 0.12, 0.95, 1.0, 1.0], 0.1)
    assert all(b - a >= 0.1 - 1e-9 for a, b in pairwise(found))
    assert found[-1] == 1.0
    assert apart([0.2, 0.9], 0.1) == [0.2, 0.9]


def test_the_command_is_found_and_refuses_bad_thresholds(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit) as stop:
        command(["s", "--path", "p", "--out", "o", "--thresholds", "1,-2"])
    assert stop.value.code == 2
    assert "expected numbers above 0, got '1,-2'" in capsys.readouterr().err
    assert main(["bench", "--help"]) == 0


def test_methods_about_buildings_are_left_out_where_there_are_none(store: Path) -> None:
    with Session(store, PagerSettings(), Picture(SIZE_PX)) as session:
        city = session.pager.forests
    nothing = build_forest(np.zeros(0, INDEX))
    bare = {**city, Lane.OBJECTS: nothing}
    assert that_differ(METHODS, city) == list(METHODS)
    left = [method.name for method in that_differ(METHODS, bare)]
    assert "geopage" in left
    assert {m.name for m in METHODS} - set(left) == {"buildings at 10 x", "without proxies"}


def test_a_chart_of_one_threshold_has_axes(
    whole: tuple[Json, Path], tmp_path: Path
) -> None:
    found = whole[0]
    bench_chart(found["rows"][:1], found["about"], [tmp_path / "c.png"])
    assert size_of(tmp_path / "c.png")[0] > 500


def test_a_path_that_is_over_at_once_is_refused_in_one_line(
    store: Path, tmp_path: Path
) -> None:
    short = write_path(tmp_path / "short.json", 1e-6, (300.0, 299.0))
    what = tiny(short, tmp_path / "out")
    with pytest.raises(InputError, match="short: is over before two frames"):
        bench(store, what, METHODS[-1:])

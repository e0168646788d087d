# SPDX-License-Identifier: Apache-2.0
"""Every row of the stability table, on a small world: it holds, and it can fail."""

import csv
import json
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geopage.cli import main
from geopage.draw_list import DrawList
from geopage.pressure import MemoryPressure
from geopage.view import ViewState
from tests.viewer.hill_city import make_store
from tiles.errors import InputError
from viewer.stability import depth, flicker, floats, globe, ground, hostile, lanes, lens
from viewer.stability.place import Place
from viewer.stability.row import FAILS, HOLDS, Finding, Row, first_bad
from viewer.stability.run import ROWS, chosen
from viewer.stability.table import Line, as_csv, as_html, as_markdown, short

pytestmark = pytest.mark.usefixtures("gl_context")
Patch = pytest.MonkeyPatch


class Tiny(Place):
    """With as few cases as there can be."""

    def count(self, whole: int, quick: int) -> int:
        return max(1, min(quick // 4, whole))


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_store(tmp_path_factory.mktemp("world"))


@pytest.fixture(scope="module")
def place(store: Path) -> Iterator[Place]:
    opened = Tiny(store, quick=True)
    yield opened
    opened.close()


def named(name: str) -> Row:
    return next(row for row in ROWS if row.name == name)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_a_row_holds(place: Place, row: Row) -> None:
    found = row.find(place)
    assert math.isfinite(found.practical)
    assert math.isfinite(found.ours)
    # Either it was found where it breaks, or it is said how far was looked.
    assert math.isfinite(found.breaks_at) or math.isfinite(found.looked_to)
    assert not found.others < found.ours
    assert row.verdict(found) == HOLDS, found


def no_skirts(patch: Patch) -> None:
    whole = Place.holes

    def bare(self: Place, drawn: DrawList, view: ViewState, skirt: float = 1.0) -> int:
        return whole(self, drawn, view, 0.0 * skirt)

    patch.setattr(Place, "holes", bare)


def no_memory(patch: Patch) -> None:
    whole = flicker.Swings.choose
    patch.setattr(flicker.Swings, "choose", lambda self, h, before: whole(self, h, None))


def no_memory_of_houses(patch: Patch) -> None:
    patch.setattr(flicker, "LOWEST_M", 12e3)  # where blocks turn into districts
    patch.setattr(flicker, "HIGHEST_M", 16e3)
    no_memory(patch)


def slow_line(patch: Patch) -> None:
    patch.setattr(lanes, "LINE_MIB_S", 0.02)
    patch.setattr(lanes, "STARVED_MIB_S", 0.002)


def fixed_threshold(patch: Patch) -> None:
    patch.setattr(MemoryPressure, "update", lambda pressure, needed_bytes, view: False)


def lost_by_prediction(patch: Patch) -> None:
    def page(_: Place, path: lanes.Path, *__: Any) -> lanes.Seen:
        return lanes.Seen(missing=2.0 if path(1.0).t_s else 1.0)

    patch.setattr(lanes, "page", page)


def one_tile(patch: Patch) -> None:
    whole = Place.select

    def first(self: Place, view: ViewState, threshold_px: float) -> DrawList:
        drawn = whole(self, view, threshold_px)
        parts = drawn.terrain[:1], drawn.skirt_m[:1], drawn.stand_in[:1]
        return replace(drawn, terrain=parts[0], skirt_m=parts[1], stand_in=parts[2])

    patch.setattr(Place, "select", first)


def level_alone(patch: Patch) -> None:
    whole = globe.edges_m
    patch.setattr(globe, "edges_m", lambda cell, **_: whole(cell, by_level=True))


def all_hidden(patch: Patch) -> None:
    def everything(_: Place, __: ViewState, rows: np.ndarray) -> Any:
        return np.ones(len(rows), bool), np.ones(len(rows), bool)

    patch.setattr(ground, "left_out", everything)


def sea_level(patch: Patch) -> None:
    whole = ground.lens_of
    patch.setattr(ground, "lens_of", lambda view, **_: whole(view, lowest_m=0.0))


def near_sighted(patch: Patch) -> None:
    def alone(seen: Any, x: float, y: float, z: float, radius_m: float) -> float:
        away_m = float(np.linalg.norm(np.array((x, y, z)) - seen.eye))
        return float(seen.focal_px / (away_m - radius_m))

    patch.setattr(lens, "px_per_m", alone)


def flat_lens(patch: Patch) -> None:
    def alone(seen: Any, centre: np.ndarray, radius_m: float, *_: np.ndarray) -> float:
        away_m = float(np.linalg.norm(centre - seen.eye)) - radius_m
        return float(seen.focal_px / max(away_m, 1e-3))

    patch.setattr(lens, "error_px_per_m", alone)


def held_by_up(patch: Patch) -> None:
    up = np.array((0.0, 0.0, 1.0))
    whole = lens.rotation
    patch.setattr(lens, "rotation", lambda pose: lens.looking_at(-whole(pose)[2], up))


def by_the_centre(patch: Patch) -> None:
    def whole(draw: np.ndarray, offset_m: tuple[float, ...], scale_m: float) -> None:
        draw[:3], draw[3] = offset_m, scale_m

    patch.setattr(floats, "put_place", whole)


BREAK: dict[str, Callable[[Patch], None]] = {
    "float32 jitter at 2 m": lambda p: p.setattr(floats, "JITTER_PX", 0.0),
    "float32 jitter, coarse ground": by_the_centre,
    "int16 quantisation": lambda p: p.setattr(floats, "STEPS_OF_LEAF", 1e9),
    "depth at 100 km": lambda p: p.setattr(depth, "FOCAL_PX", 1e12),
    "odd pictures": one_tile,
    "cracks": no_skirts,
    "poles, holes": no_skirts,
    "antimeridian": no_skirts,
    "zone corners": no_skirts,
    "poles, cost": level_alone,
    "flicker of the ground": no_memory,
    "flicker of buildings": no_memory_of_houses,
    "slow storage": slow_line,
    "starvation": slow_line,
    "thrash": fixed_threshold,
    "overshoot": lost_by_prediction,
    "field of view, ground": flat_lens,
    "field of view, buildings": near_sighted,
    "aspect, buildings": near_sighted,
    "straight down": held_by_up,
    "horizon": all_hidden,
    "below sea level": sea_level,
    "eye near the ground": lambda p: p.setattr(ground, "EYE_M", -5.0),
    "NaN in a camera path": lambda p: p.setattr(hostile, "read_path", lambda file: None),
    "NaN in a view": lambda p: p.setattr(hostile, "poisons", lambda good: [lambda: good]),
}


@pytest.mark.parametrize("name", BREAK)
def test_a_row_can_fail(place: Place, name: str, monkeypatch: Patch) -> None:
    BREAK[name](monkeypatch)
    row = named(name)
    assert row.verdict(row.find(place)) == FAILS


def test_a_margin_is_how_many_times_harder_it_may_get() -> None:
    row = named("float32 jitter at 2 m")
    assert row.margin(Finding(200.0, 0.0, breaks_at=500.0)) == 2.5
    assert row.margin(Finding(200.0, 0.0, looked_to=1000.0)) == 5.0
    easier = replace(row, more_is_harder=False)
    assert easier.margin(Finding(4.0, 0.0, breaks_at=0.5)) == 8.0
    assert row.verdict(Finding(200.0, 0.011, breaks_at=500.0)) == FAILS
    assert row.verdict(Finding(200.0, 0.01, breaks_at=100.0)) == FAILS
    assert row.verdict(Finding(200.0, 0.01, breaks_at=500.0)) == HOLDS


@pytest.mark.parametrize("limit", [1.5, 77.0, 9e5])
def test_where_something_breaks_is_found(limit: float) -> None:
    found = first_bad(lambda x: x < limit, 1.0, 1e6, 40)
    assert found == pytest.approx(limit)
    assert first_bad(lambda x: x > limit, 1e6, 1.0, 40) == pytest.approx(limit)
    assert math.isnan(first_bad(lambda x: x < limit, 1.0, limit / 2))
    assert first_bad(lambda x: x < limit, 2 * limit, 3 * limit) == 2 * limit


def test_numbers_are_short() -> None:
    values = [0.0, 1.0, 0.0357, 1234.5, 21.757, 1e-6, 3.2e9, math.nan]
    expected = ["0", "1", "0.0357", "1,234", "21.8", "1.0e-6", "3.2e9", ""]
    assert [short(value) for value in values] == expected


def test_all_forms_show_every_line() -> None:
    found = Finding(1.0, 0.5, looked_to=2.0, note="a < b | c")
    lines = [Line(row, found) for row in ROWS]
    about = {"machine": "one", "commit": "abc"}
    table = [line for line in as_csv(lines, about).splitlines() if line[0] != "#"]
    rows = list(csv.DictReader(table))
    page, text = "".join(as_html(lines, about)), as_markdown(lines, about)
    assert [row["name"] for row in rows] == [row.name for row in ROWS]
    for row in ROWS:
        assert row.name in page
        assert f"| {row.name} |" in text
    assert "a &lt; b" in page
    assert "machine: one" in text


def test_names_of_rows_differ_and_unknown_ones_are_refused() -> None:
    assert len({row.name for row in ROWS}) == len(ROWS)
    assert [row.name for row in chosen(["depth at 1 km", "zone"])] == [
        "depth at 1 km",
        "zone corners",
    ]
    with pytest.raises(InputError, match="no row is called so"):
        chosen(["nonsense"])


def test_the_command_writes_what_it_found(
    store: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--out", str(tmp_path), "--only", "depth,straight", "--quick", "--json"]
    assert main(["stability", str(store), *words]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [row["verdict"] for row in found["rows"]] == [HOLDS] * 5
    assert (tmp_path / "stability.csv").read_text().startswith("# machine: ")
    assert "depth at 10,000 km" in (tmp_path / "STABILITY.md").read_text()
    assert "<table>" in (tmp_path / "index.html").read_text()


def test_the_command_says_that_something_fails(
    store: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: Patch
) -> None:
    by_the_centre(monkeypatch)
    words = ["--out", str(tmp_path), "--only", "coarse", "--quick"]
    assert main(["stability", str(store), *words]) == 1
    assert "FAILS  float32 jitter, coarse ground" in capsys.readouterr().out


def test_a_store_that_is_not_there_is_said_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    missing = tmp_path / "no.geopage"
    assert main(["stability", str(missing), "--out", str(tmp_path / "out")]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1

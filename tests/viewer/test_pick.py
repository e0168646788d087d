# SPDX-License-Identifier: Apache-2.0
"""Pixels back to buildings and their attributes, and buildings in colours."""

import json
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import geopage
from geopage.cli import main
from geopage.settings import PagerSettings
from geopage.style import parse_style
from geopage.view import ViewState
from tests.viewer.small_world import BLOCK_M, LAT_DEG, LON_DEG, ROWS, write_path
from tiles.errors import InputError
from tiles.geodesy import to_ecef
from viewer.camera import Pose, project, view_state
from viewer.pick import pick, pick_lines
from viewer.session import Picture, Session

pytestmark = pytest.mark.usefixtures("gl_context")
SIZE = 320, 240
MIDDLE = LON_DEG + 0.0025, LAT_DEG + 0.0018
FINE = PagerSettings(object_threshold_px=0.5)


@pytest.fixture(scope="module")
def folder(hill_store: Path) -> Path:
    return hill_store.parent


@pytest.fixture(scope="module")
def session(folder: Path) -> Iterator[Session]:
    with Session(folder / "w.geopage", FINE, Picture(SIZE)) as made:
        yield made


def look_down(session: Session, height_m: float) -> ViewState:
    lon, lat = (math.radians(one) for one in MIDDLE)
    ground_m = session.surface.height_at(lon, lat)
    pose = Pose(lon, lat, ground_m + height_m, 0.0, -math.pi / 2)
    return view_state(pose, session.picture.size_px)


def source(folder: Path) -> dict[str, dict]:
    features = json.loads((folder / "city.geojson").read_text())["features"]
    return {one["properties"]["name"]: one for one in features}


def test_every_building_is_found_with_its_sources_attributes(folder: Path) -> None:
    features = source(folder)
    corners = np.array([one["geometry"]["coordinates"][0] for one in features.values()])
    lon, lat = corners[:, :4].mean(axis=1).T
    with geopage.open(folder / "w.geopage") as world:
        found = world.objects_at(lon, lat)
    assert [len(one) for one in found] == [1] * ROWS * ROWS
    attributes = [one[0]["attributes"] for one in found]
    assert attributes == [one["properties"] for one in features.values()]


def test_the_pixel_of_a_roof_names_its_building(session: Session, folder: Path) -> None:
    view = look_down(session, 400.0)
    drawn, _ = session.settle(view)
    asked = 0
    for name, one in source(folder).items():
        lon, lat = np.radians(np.mean(one["geometry"]["coordinates"][0][:4], axis=0))
        height_m = session.surface.height_at(lon, lat) + one["properties"]["height"]
        x, y, _ = np.floor(project(view, to_ecef(lon, lat, height_m))).astype(int).tolist()
        if not (0 <= x < SIZE[0] and 0 <= y < SIZE[1]):
            continue
        found = pick(session, drawn, (x, y))
        assert found["kind"] == "building"
        assert found["object"]["attributes"]["name"] == name
        assert found["height_m"] == pytest.approx(height_m, abs=3.0)
        off_deg = found["lon_deg"] - math.degrees(lon), found["lat_deg"] - math.degrees(lat)
        assert np.abs(off_deg).max() * 111_000 < BLOCK_M
        assert name in pick_lines(found)[0]
        asked += 1
    assert asked == ROWS * ROWS


def test_the_ground_between_has_its_height(session: Session) -> None:
    view = look_down(session, 400.0)
    drawn, _ = session.settle(view)
    found = pick(session, drawn, (2, 2))
    assert found["kind"] == "ground"
    drawn_m = FINE.threshold_px * 400.0 / view.focal_px
    place = math.radians(found["lon_deg"]), math.radians(found["lat_deg"])
    assert found["height_m"] == pytest.approx(
        session.surface.height_at(*place), abs=drawn_m
    )
    assert pick_lines(found)[0].startswith("ground at ")


def test_the_sky_is_sky(session: Session) -> None:
    lon, lat = (math.radians(one) for one in MIDDLE)
    drawn, _ = session.settle(view_state(Pose(lon, lat, 3000.0, 0.0, 1.0), SIZE))
    assert pick_lines(pick(session, drawn, (5, 5))) == ["sky"]


def test_a_proxy_says_how_many_it_stands_for(folder: Path) -> None:
    coarse = PagerSettings(threshold_px=30.0)
    with Session(folder / "w.geopage", coarse, Picture(SIZE)) as session:
        drawn, _ = session.settle(look_down(session, 500.0))
        ids = session.renderer.read_ids()
        proxies = np.argwhere((ids < 0) & ((-1 - ids) % 65536 == 65535))
        assert len(proxies) > 100
        y, x = proxies[len(proxies) // 2].tolist()
        found = pick(session, drawn, (x, y))
    assert found["kind"] == "proxy"
    assert 1 < found["count"] <= ROWS * ROWS
    assert "none resolved at this distance" in pick_lines(found)[0]
    at = np.array((found["lon_deg"], found["lat_deg"]))
    features = source(folder).values()
    centres = [np.mean(one["geometry"]["coordinates"][0][:4], axis=0) for one in features]
    away_m = np.linalg.norm((np.array(centres) - at) * (111_000 * 0.71, 111_000), axis=1)
    near = found["object"]
    own = np.linalg.norm((at - (near["lon_deg"], near["lat_deg"])) * (78_810, 111_000))
    assert own <= away_m.min() + BLOCK_M


def test_the_command_prints_what_is_there(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    at = f"{MIDDLE[1]},{MIDDLE[0]},300"
    words = ["render", str(folder / "w.geopage"), "--at", at, "--look", "0,-90"]
    words += ["--size", "96x64", "-o", str(tmp_path / "p.png")]
    assert main([*words, "--pick", "48,32", "--json", "--style", "height:magma"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["pick"]["kind"] in {"building", "ground"}
    assert found["style"]["ramp"] == "magma"
    assert main([*words, "--pick", "48,32", "--style", "height"]) == 0
    out, err = capsys.readouterr()
    assert len(out.splitlines()) == 1
    assert err.splitlines()[0] == "height:"


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--pick", "96,0"], "not in the picture of 96x64"),
        (["--pick", "1"], "expected X,Y"),
        (["--style", "nosuch"], "no object has"),
        (["--style", "height:"], "no object has"),
        (["--style", "=#fff"], "is no style"),
    ],
)
def test_what_can_not_be_picked_or_styled_is_one_line(
    words: list[str],
    says: str,
    folder: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    start = ["render", str(folder / "w.geopage"), "--at", "1,2,3", "--size", "96x64"]
    assert main([*start, "-o", str(tmp_path / "p.png"), *words]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert len(err.splitlines()) == 1
    assert says in err


def test_roofs_have_the_colour_of_their_value_and_walls_are_darker(folder: Path) -> None:
    style = parse_style("name=3-4:#ff0000,*:#0000ff")
    with Session(folder / "w.geopage", FINE, Picture(SIZE), style) as session:
        view = look_down(session, 400.0)
        session.settle(view)
        rgb, ids = session.renderer.read_rgb().astype(int), session.renderer.read_ids()
        one = source(folder)["3-4"]
        lon, lat = np.radians(np.mean(one["geometry"]["coordinates"][0][:4], axis=0))
        height_m = session.surface.height_at(lon, lat) + one["properties"]["height"]
        x, y, _ = np.floor(project(view, to_ecef(lon, lat, height_m))).astype(int)
    is_red = rgb[..., 0] > 2 * rgb[..., 2]
    is_blue = rgb[..., 2] > 2 * rgb[..., 0]
    assert is_red[y, x]
    assert (is_red == (ids == ids[y, x])).mean() > 0.99
    assert (is_blue == ((ids < 0) & (ids != ids[y, x]))).mean() > 0.97


def test_a_flight_is_flown_in_colours_and_says_which(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_path(tmp_path / "down.json", 5.0, (2000.0, 300.0))
    words = ["fly", str(folder / "w.geopage"), str(path), "--settled", "--poses", "2"]
    words += ["--size", "96x64", "--out", str(tmp_path / "out"), "--json"]
    assert main([*words, "--style", "height:oranges:10,20"]) == 0
    style = json.loads(capsys.readouterr().out)["style"]
    assert (style["ramp"], style["min"], style["max"]) == ("oranges", 10, 20)


def picture(session: Session, view: ViewState) -> np.ndarray:
    session.settle(view)
    return session.renderer.read_rgb()


def test_a_style_is_put_on_and_taken_off_without_reading_a_tile(folder: Path) -> None:
    path = folder / "w.geopage"
    style, other = parse_style("height:viridis"), parse_style("name")
    with Session(path, FINE, Picture(SIZE), style) as styled:
        near, far = look_down(styled, 300.0), look_down(styled, 6000.0)
        wanted = [picture(styled, view) for view in (near, far)]
    with Session(path, FINE, Picture(SIZE)) as session:
        plain = picture(session, near)
        read = session.pager.counters["bytes_read"]
        for _ in range(2):
            session.set_style(other)
            assert (picture(session, near) != wanted[0]).any()
            session.set_style(style)
            assert session.styling
            assert session.styling.legend["field"] == "height"
            assert (picture(session, near) == wanted[0]).all()
            session.set_style(None)
            assert (picture(session, near) == plain).all()
        assert session.pager.counters["bytes_read"] == read
        session.set_style(style)  # proxies, and what is loaded afterwards
        assert (picture(session, far) == wanted[1]).all()
        assert (wanted[0] != plain).any(-1).mean() > 0.02


def test_a_style_that_does_not_suit_leaves_the_colours(session: Session) -> None:
    view = look_down(session, 300.0)
    before = picture(session, view)
    with pytest.raises(InputError, match="no object has"):
        session.set_style(parse_style("nosuch"))
    assert (picture(session, view) == before).all()
    assert session.styling is None

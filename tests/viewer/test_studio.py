# SPDX-License-Identifier: Apache-2.0
"""The door for scripts and notebooks, where it draws: as its documentation says."""

from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import geopage
from geopage import world as world_module
from geopage.world import World
from tests.viewer.small_world import LAT_DEG, LON_DEG, write_path
from tiles.errors import InputError

pytestmark = pytest.mark.usefixtures("gl_context")
SMALL: dict[str, Any] = {"size_px": (160, 96), "threshold_px": 2.0}
ABOVE = LON_DEG + 0.002, LAT_DEG + 0.002, 400.0


@pytest.fixture(scope="module")
def world(hill_store: Path) -> Iterator[World]:
    with geopage.open(hill_store) as made:
        yield made


def test_an_image_is_pixels_a_png_and_a_file(world: World, tmp_path: Path) -> None:
    image = world.render(*ABOVE, heading_deg=30, pitch_deg=-60, **SMALL)
    pixels = np.asarray(image)
    assert (pixels.shape, pixels.dtype) == ((96, 160, 3), np.uint8)
    assert np.array_equal(np.asarray(Image.open(BytesIO(image._repr_png_()))), pixels)
    image.save(tmp_path / "here.png")
    assert np.array_equal(np.asarray(Image.open(tmp_path / "here.png")), pixels)
    assert image.about["objects"] > 50
    assert repr(image) == "<geopage image, 160 x 96 pixels>"
    with pytest.raises(InputError, match="No such file"):
        image.save(tmp_path / "none" / "here.png")


def test_the_eye_is_where_the_words_say(world: World) -> None:
    ground_m = world.sample(*ABOVE[:2])["height_m"]
    above = world.render(*ABOVE, 0, -90, **SMALL)
    same = world.render(
        *ABOVE[:2], ABOVE[2] + ground_m, 0, -90, above_ground=False, **SMALL
    )
    assert above.about["eye_height_m"] == pytest.approx(ground_m + ABOVE[2], abs=0.5)
    assert np.abs(np.asarray(above).astype(int) - np.asarray(same)).mean() < 1.0
    up = np.asarray(world.render(*ABOVE, 0, 60, **SMALL))
    assert not np.array_equal(up, np.asarray(above))


def test_size_style_and_threshold_may_change_from_picture_to_picture(world: World) -> None:
    plain = np.asarray(world.render(*ABOVE, 0, -90, **SMALL))
    styled = world.render(*ABOVE, 0, -90, style="height:magma", **SMALL)
    assert styled.about["style"]["field"] == "height"
    assert (np.asarray(styled) != plain).any(-1).mean() > 0.02
    wide = world.render(*ABOVE, 0, -90, size_px=(200, 50), threshold_px=9.0)
    assert wide.shape == (50, 200, 3)
    assert wide.about["triangles"] < styled.about["triangles"]
    assert np.array_equal(np.asarray(world.render(*ABOVE, 0, -90, **SMALL)), plain)


def test_a_flight_is_a_report_that_shows_itself(world: World, tmp_path: Path) -> None:
    path = write_path(tmp_path / "down.json", 1.0, (1e5, 300.0))
    report = world.fly(path, tmp_path / "out", fps=5.0, **SMALL)
    assert report.frames.count == report["frames"]["count"] > 2
    assert report.settings.threshold_px == 2.0
    assert report.frame_budget.budget_ms == 200.0
    assert report.chart()._repr_svg_() == (tmp_path / "out" / "flight.svg").read_text()
    report.chart().save(tmp_path / "copy.svg")
    assert (tmp_path / "copy.svg").stat().st_size > 1000
    assert str(report.machine.cpu) in report._repr_html_()
    assert "<svg" in report._repr_html_()
    with pytest.raises(AttributeError, match="no 'fames'"):
        _ = report.fames


def test_a_settled_flight_leaves_no_files_unless_asked(
    world: World, tmp_path: Path
) -> None:
    path = write_path(tmp_path / "down.json", 1.0, (2e4, 300.0))
    before = sorted(tmp_path.rglob("*"))
    report = world.fly(path, settled_poses=3, **SMALL)
    assert report.frames.with_stand_ins == 0
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(
    ("wrong", "said"),
    [({"size_px": (0, 9)}, "size_px"), ({"threshold_px": 0.0}, "threshold_px")],
)
def test_what_can_not_be_drawn_is_refused(
    world: World, wrong: dict[str, Any], said: str
) -> None:
    with pytest.raises(ValueError, match=said):
        world.render(*ABOVE, **(SMALL | wrong))
    with pytest.raises(ValueError, match="expected finite degrees"):
        world.render(0.0, 91.0, 10.0)


def test_without_a_package_that_draws_it_says_so(
    hill_store: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(world_module, "VIEWS", "geopage.none")
    with geopage.open(hill_store) as made, pytest.raises(InputError, match="draws"):
        made.render(*ABOVE)

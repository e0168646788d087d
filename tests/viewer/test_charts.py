# SPDX-License-Identifier: Apache-2.0
"""Charts, pages and what flights measure themselves with."""

import mmap
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tiles.errors import InputError
from viewer import gil
from viewer.camera import Pose, view_state
from viewer.charts import read_report, speed_against_accuracy
from viewer.flight import FrameClock
from viewer.holes import meets_ellipsoid, rays_of
from viewer.memory import Preemption, resident_bytes
from viewer.page import Page, write_page


def report(threshold: float, ms: float, error: float) -> dict[str, Any]:
    return {
        "settings": {
            "path": "<p>",
            "mode": "settled",
            "policy": "benefit",
            "threshold_px": threshold,
            "size_px": [640, 360],
        },
        "machine": {"cpu": "A & B", "cores": 2, "gl_renderer": "soft"},
        "frames": {
            "count": 3,
            "mean_ms": ms,
            "sd_ms": 1.0,
            "p50_ms": ms,
            "p99_ms": 2 * ms,
            "holes": 0,
            "with_stand_ins": 0,
        },
        "floor": {
            "frame_p50_ms": ms / 2,
            "frame_p99_ms": ms,
            "frame_mean_ms": ms / 2,
            "bytes": 1,
        },
        "screen_error_px": {"p50": error, "p95": error},
        "memory": {
            "budget_bytes": 10,
            "peak_bytes": 5,
            "rss_peak_bytes": 7,
            "rss_before_bytes": 3,
        },
        "io": {"bytes_read": 2**20, "tiles_loaded": 1},
        "drawn": {"triangles_mean": 12.0},
        "stages_ms": {"draw": ms},
    }


def test_the_chart_shows_every_threshold_and_the_machine(tmp_path: Path) -> None:
    out = tmp_path / "c.svg"
    speed_against_accuracy([report(1, 30, 0.8), report(4, 12, 3.1)], out)
    text = out.read_text()
    for words in ("1 px", "4 px", "A &amp; B", "floor"):
        assert words in text


def test_the_chart_shows_what_was_measured_beside_what_the_selection_knows(
    tmp_path: Path,
) -> None:
    runs = [report(1, 30, 0.8), report(4, 12, 3.1)]
    speed_against_accuracy(runs, tmp_path / "old.svg")
    assert "measured" not in (tmp_path / "old.svg").read_text()
    for run, error in zip(runs, (0.4, 0.0), strict=True):
        run["geometric_error_px"] = {"p95": error}
    speed_against_accuracy(runs, tmp_path / "new.svg")
    text = (tmp_path / "new.svg").read_text()
    assert "measured, p95" in text
    assert "known to the selection" in text
    speed_against_accuracy([*runs, report(8, 9, 6.0)], tmp_path / "mixed.svg")
    mixed = (tmp_path / "mixed.svg").read_text()
    assert mixed.count("known to the selection") == text.count("known to the selection")


def test_flights_with_detail_by_speed_are_a_curve_of_their_own(tmp_path: Path) -> None:
    plain, by_speed = report(2, 30, 0.8), report(2, 12, 3.1)
    plain["settings"]["detail"] = "size"
    by_speed["settings"]["detail"] = "size-and-speed"
    speed_against_accuracy([report(1, 40, 0.4), plain, by_speed], tmp_path / "c.svg")
    text = (tmp_path / "c.svg").read_text()
    assert text.count("<!-- benefit, settled: known to the selection") == 1
    assert text.count("<!-- benefit, detail by size and speed, settled: known") == 1


def test_the_same_runs_make_the_same_chart(tmp_path: Path) -> None:
    runs = [report(1, 30, 0.8), report(4, 12, 3.1)]
    for name in ("a.svg", "b.svg"):
        speed_against_accuracy(runs, tmp_path / name)
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()


def test_a_report_that_is_none_is_refused(tmp_path: Path) -> None:
    (tmp_path / "report.json").write_text('{"frames": {}}')
    with pytest.raises(InputError, match=r"report\.json: is not a flight's report"):
        read_report(tmp_path)


def test_the_page_shows_figures_and_escapes_names(tmp_path: Path) -> None:
    pictures = [("x.png", "cap")]
    write_page(tmp_path, Page("a <b>", "lead", report(1, 30, 0.8), None, pictures))
    text = (tmp_path / "index.html").read_text()
    assert "<b>" not in text
    assert "a &lt;b&gt;" in text
    assert "ratio 2.00" in text
    assert 'src="x.png"' in text


def test_the_page_shows_what_was_measured_where_it_was(tmp_path: Path) -> None:
    run = report(1, 30, 0.8)
    write_page(tmp_path, Page("a", "b", run))
    assert "geometric error" not in (tmp_path / "index.html").read_text()
    error = {"p50": 0.123, "p95": 0.456, "share_within_threshold": 0.9875}
    judged = {"share_not_judged": 0.25, "frames": [{}] * 7}
    run["geometric_error_px"] = {**error, **judged}
    write_page(tmp_path, Page("a", "b", run))
    text = (tmp_path / "index.html").read_text()
    for words in ("0.12 px", "0.46 px", "98.75 %", "75 % of the earth", "at 7 frames"):
        assert words in text


def test_rays_that_meet_the_ellipsoid_are_those_of_the_disc() -> None:
    view = view_state(Pose(0.0, 0.0, 1e7, 0.0, -np.pi / 2), (200, 200))
    pixels = np.argwhere(np.ones((200, 200), bool))
    hit = meets_ellipsoid(view, rays_of(view, pixels), 0.0).reshape(200, 200)
    away = np.hypot(*(np.indices((200, 200)) + 0.5 - 100))
    radius = view.focal_px * np.tan(np.arcsin(6378137.0 / (6378137.0 + 1e7)))
    assert hit[away < radius * 0.99].all()
    assert not hit[away > radius * 1.01].any()


def test_a_frame_clock_counts_standing_still_and_not_work() -> None:
    clock = FrameClock(preemption := Preemption())
    while clock.frame_ms() < 20:
        pass
    waited, preempted = clock.stood_still_ms()
    assert waited < 10  # busy all the time, but for what the system took
    start = time.perf_counter()
    while time.perf_counter() - start < 0.03:
        time.sleep(0.01)  # the thing that is measured
    assert clock.stood_still_ms()[0] > waited + 20 - preempted
    preemption.close()


def test_the_switch_interval_is_given_back() -> None:
    before = sys.getswitchinterval()
    with gil.interval(gil.KEEP_S), gil.interval(gil.SHARE_S):
        assert sys.getswitchinterval() == pytest.approx(gil.SHARE_S)
    assert sys.getswitchinterval() == pytest.approx(before)


def test_a_frame_keeps_the_gil_but_while_gl_works() -> None:
    told = [gil.is_kept()]
    with gil.interval(gil.KEEP_S):
        told.append(gil.is_kept())
        with gil.interval(gil.SHARE_S):
            told.append(gil.is_kept())
        told.append(gil.is_kept())
    assert [*told, gil.is_kept()] == [False, True, False, True, False]


def test_the_process_grows_by_what_it_allocates() -> None:
    before = resident_bytes()
    # Of the system's own: what the process was given and has freed is resident already.
    with mmap.mmap(-1, 64 << 20) as pages:
        pages.write(bytes(1 << 20) * 64)
        assert resident_bytes() - before > 48 << 20

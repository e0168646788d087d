# SPDX-License-Identifier: Apache-2.0
import json
from pathlib import Path

import numpy as np
import pytest

from geopage.settings import MIB, PagerSettings
from tests.viewer.small_world import write_path
from viewer import pairs
from viewer.flight import FRAME, Recording
from viewer.session import Picture


def test_the_peak_rate_is_that_of_the_busiest_second() -> None:
    frames = np.zeros(240, FRAME)
    frames["t_s"] = np.arange(240) / 60
    # 1 MiB a second, and 5 MiB more within the third one.
    frames["bytes_read"] = frames["t_s"] * MIB
    frames["bytes_read"] += (np.clip(frames["t_s"] - 2.0, 0, 1) * 5 * MIB).astype(int)
    recording = Recording(frames=frames.tolist())
    assert pairs.peak_rate(recording) == pytest.approx(6 * MIB, rel=1e-3)


def made_up(flight: float, floor: float, beside: float) -> pairs.Json:
    parts = {"flight": flight, "floor": floor, "beside": beside}
    found = {name: {"p50_ms": ms, "p99_ms": 2 * ms} for name, ms in parts.items()}
    return {**found, "waits": 2}


def test_ratios_are_formed_within_a_pair() -> None:
    made = [made_up(10, 10, 11), made_up(120, 100, 100), made_up(11, 10, 13)]
    found = pairs.figures(made)
    assert found["ratios"]["p50"] == {
        "median": 1.1,
        "least": 1.0,
        "most": 1.2,
        "limit": pairs.LIMITS["p50"],
    }
    assert found["ratios"]["p99_beside_servers"]["median"] == 1.1
    text = "\n".join(pairs.lines({"pairs": made, **found}))
    assert "flight / floor, p50: median 1.10, 1.00 to 1.20 (limit 1.15)" in text


@pytest.mark.usefixtures("gl_context")
def test_a_pair_flies_and_draws_the_same_frames_beside_idle_and_busy_servers(
    hill_store: Path, tmp_path: Path
) -> None:
    path = write_path(tmp_path / "short.json", 1.5, (3e4, 300.0))
    settings = PagerSettings(1.0, budget_bytes=128 * MIB)
    found = pairs.fly_pairs(hill_store, settings, Picture((96, 64)), path, 1)
    pairs.write(found, tmp_path / "out")
    assert json.loads((tmp_path / "out" / "pairs.json").read_text()) == found
    (pair,) = found["pairs"]
    assert pair["frames"] > 10
    assert pair["servers_bytes_per_s"] > 0
    assert set(found["ratios"]) == set(pairs.LIMITS)

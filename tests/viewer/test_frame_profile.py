# SPDX-License-Identifier: Apache-2.0
import json
from pathlib import Path

import pytest

from geopage.settings import MIB, PagerSettings
from tests.viewer.small_world import write_path
from tiles.errors import InputError
from viewer import frame_profile
from viewer.session import Picture


@pytest.mark.usefixtures("gl_context")
def test_the_parts_of_a_frame_add_up_to_it(
    hill_store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(frame_profile, "FRAMES", 12)
    path = write_path(tmp_path / "path.json", 4.0, (3e4, 300.0))
    settings = PagerSettings(1.0, budget_bytes=128 * MIB)
    found = frame_profile.profile_frame(hill_store, settings, Picture((96, 64)), path, 4.0)
    frame_profile.write(found, tmp_path)
    assert json.loads((tmp_path / "profile.json").read_text()) == found
    for parts in found["ways"].values():
        whole = parts.pop("whole frame")
        assert sum(part["least_ms"] for part in parts.values()) <= whole["least_ms"]
        assert sum(part["p99_ms"] for part in parts.values()) >= whole["p50_ms"]
        assert all(part["least_ms"] >= 0 for part in parts.values())
        assert parts["objects"]["p50_ms"] > 0
    assert len(frame_profile.lines({**found, "ways": {}})) == 3


def test_a_time_at_which_a_path_is_not_flown_is_refused(tmp_path: Path) -> None:
    path = write_path(tmp_path / "path.json", 4.0, (3e4, 300.0))
    settings = PagerSettings(1.0, budget_bytes=128 * MIB)
    with pytest.raises(InputError, match=r"lasts 4 s; take a time within, not 4\.5 s"):
        frame_profile.profile_frame(tmp_path, settings, Picture((96, 64)), path, 4.5)

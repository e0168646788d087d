# SPDX-License-Identifier: Apache-2.0
"""How much of what `benefit` misses is prediction, and how much is order."""

import json
from pathlib import Path

import numpy as np
import pytest

from geopage.outlook import Ahead, outlook
from geopage.policies.benefit import AHEAD_S, Benefit
from geopage.policies.protocol import Situation
from geopage.policies.registry import REGISTRY
from geopage.settings import MIB, PagerSettings, Throttle
from tests.geopage.worlds import deep_globe, object_records, write_store
from tiles.store import Store
from tiles.surface import Surface
from viewer.camera_path import read_path
from viewer.paging import ideal_bytes, page_flight
from viewer.poses import Flight

KEYS = [(0.0, 1e6), (1.0, 2e4), (2.0, 300.0)]
NAMES = ("t_s", "height_m", "lat_deg", "lon_deg", "heading_deg", "pitch_deg")


class Foreseeing(Benefit):
    """The same, with the flight's own views in the place of predicted ones."""

    flight: Flight

    def ahead(self, seen: Situation) -> Ahead:
        still = outlook(seen.view, None, seen.floor_m, AHEAD_S)
        if seen.motion is None:
            return still
        views = [self.flight.view(seen.view.t_s + t_s) for t_s in AHEAD_S.tolist()]
        eye = np.stack([view.eye for view in views])
        return still._replace(eye=eye, rotation=np.stack([v.rotation for v in views]))


def test_prediction_and_order_share_the_gap_to_the_oracle(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = tmp_path / "w.geopage"
    write_store(store, deep_globe(), object_records())
    frames = [
        dict(zip(NAMES, (*key, 37.76, -122.447, 0.0, -60.0), strict=True)) for key in KEYS
    ]
    path = {"name": "down", "duration_s": 2.0, "height_reference": "ellipsoid"}
    path |= {"interpolation": "log_height", "keyframes": frames}
    (tmp_path / "down.json").write_text(json.dumps(path))
    with Store(store) as opened:
        flight = Flight(read_path(tmp_path / "down.json"), Surface(opened), (1280, 720))
    plain = PagerSettings(fade_s=0.0)
    rate = ideal_bytes(store, flight, plain) / flight.path.duration_s / 2 / MIB
    share = {}
    Foreseeing.flight = flight
    for name, policy in (("benefit", Benefit), ("foreseeing", Foreseeing)):
        monkeypatch.setitem(REGISTRY, "benefit", policy)
        settings = PagerSettings(fade_s=0.0, throttle=Throttle(rate))
        found = page_flight(store, flight, settings, lambda t_s: None)
        share[name] = found["share_frames_within"]
    settings = PagerSettings(fade_s=0.0, throttle=Throttle(rate), policy="oracle")
    share["oracle"] = page_flight(store, flight, settings, lambda t_s: None)[
        "share_frames_within"
    ]
    assert share["benefit"] >= share["foreseeing"] - 0.1, share
    assert share["benefit"] >= share["oracle"] - 0.1, share

# SPDX-License-Identifier: Apache-2.0
"""Copies of a city: as many as wanted, of the same size, on land, labelled."""

import json
from pathlib import Path

import numpy as np
import pytest
import shapely

from geopage.cli import main
from ingest import synthetic
from ingest.repair import size_m
from ingest.synthetic import replicated
from tiles.errors import InputError
from tiles.frames import Floats
from tiles.store import Store
from tiles.surface import Surface
from tiles.writer import Writer

DEGREE_M = 111_194.0


@pytest.fixture
def hamlet(tmp_path: Path) -> Path:
    """Nine houses of 10 m around longitude 9, latitude 48."""
    east = np.cos(np.radians(48.0))
    features = []
    for k in range(9):
        west, south = 9 + k % 3 * 5e-4, 48 + k // 3 * 5e-4
        far, north = west + 10 / DEGREE_M / east, south + 10 / DEGREE_M
        ring = [[west, south], [far, south], [far, north], [west, north], [west, south]]
        shape = {"type": "Polygon", "coordinates": [ring]}
        features.append({"type": "Feature", "properties": {"h": k}, "geometry": shape})
    path = tmp_path / "hamlet.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return path


@pytest.fixture
def store(tmp_path: Path) -> Path:
    Writer(tmp_path / "bare.geopage").close()
    return tmp_path / "bare.geopage"


def test_copies_are_as_many_as_wanted_apart_and_of_the_same_size(
    hamlet: Path, store: Path
) -> None:
    parts = list(replicated(hamlet, store, 500, None, None))
    polygon = np.concatenate([part.geometry for part in parts])
    assert len(polygon) == 500
    assert np.concatenate([part.feature for part in parts]).tolist() == list(range(500))
    for side in size_m(polygon):
        assert side == pytest.approx(10, abs=0.05)
    around = [shapely.box(*shapely.total_bounds(part.geometry)) for part in parts]
    assert not shapely.STRtree(around).query(around, "overlaps").size
    assert parts[0].geometry[0].equals_exact(parts[0].geometry[0], 1e-9)
    assert parts[3].columns["synthetic"][0] == "copy 3 of hamlet.geojson"
    assert parts[3].columns["h"].tolist() == list(range(9))


def test_copies_are_put_on_land_only(
    hamlet: Path, store: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def coast(_: Surface, lon: Floats, lat: Floats) -> tuple[Floats, Floats]:
        return np.where(lon < np.radians(9.01), 100.0, 0.0), np.zeros(len(lat))

    monkeypatch.setattr(Surface, "heights", coast)
    monkeypatch.setattr(synthetic, "_sea_m", lambda lon, lat: np.zeros(len(lon)))
    monkeypatch.setattr(synthetic, "_has_terrain", lambda surface: True)
    parts = list(replicated(hamlet, store, 900, None, None))
    assert max(shapely.total_bounds(part.geometry)[2] for part in parts) < 9.01
    monkeypatch.setattr(synthetic, "MAX_RINGS", 2)
    with pytest.raises(InputError, match="find land around it; ask for fewer"):
        list(replicated(hamlet, store, 900, None, None))


def test_the_command_says_what_they_are(
    hamlet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store = str(tmp_path / "w.geopage")
    words = ["ingest", "synthetic", store, "--from", str(hamlet), "--count", "100"]
    assert main([*words, "--height", "h", "--bare", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["read"] == report["stored"] == 100
    with Store(store) as opened:
        source = opened.sources("buildings")[0]
        assert source["name"] == "synthetic_hamlet"
        assert source["synthetic"] == "replicated from hamlet.geojson"
        said = [one["attributes"] for one in opened.objects([1, 100])]
    assert [one["synthetic"] for one in said] == [
        "copy 0 of hamlet.geojson",
        "copy 11 of hamlet.geojson",
    ]
    assert main([*words[:-1], "0"]) == 2
    assert "0 is not above zero" in capsys.readouterr().err

# SPDX-License-Identifier: Apache-2.0
"""A small run of `globe_ingest`."""

import json
from pathlib import Path

import numpy as np
import pytest
import rasterio

from tests.benchmarks import globe_ingest
from tests.ingest.rasters import hills


@pytest.mark.skipif(not Path("/proc/self/smaps_rollup").exists(), reason="needs Linux")
def test_an_ingest_is_counted_and_its_memory_with_all_processes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    heights = np.rint(hills((45, 60), 100.0, 300.0)).astype(np.int16)
    np.savez(tmp_path / "g.npz", heights)
    numbers = tmp_path / "out.json"
    words = [tmp_path / "work", tmp_path / "g.npz", "--numbers", numbers]
    assert globe_ingest.main([str(word) for word in words]) == 0
    with rasterio.open(tmp_path / "work" / "globe.tif") as written:
        assert (written.read(1) == heights).all()
        assert written.bounds[:2] == pytest.approx((0.0, 50.0 - 45 / 120))
    taken = json.loads(numbers.read_text())
    assert taken["posts"] == heights.size
    assert taken["tiles"] > 32
    assert taken["store_bytes"] > 4096
    assert taken["together_bytes"] >= taken["largest_bytes"] > 30e6
    assert f"{heights.size} posts in" in capsys.readouterr().out
    assert not (tmp_path / "work" / "ingest.geopage").exists()

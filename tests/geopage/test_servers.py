# SPDX-License-Identifier: Apache-2.0
from pathlib import Path

import numpy as np
import pytest

from geopage.pager import Pager
from geopage.settings import MIB, PagerSettings, Throttle
from geopage.source import SizeSource
from tests.geopage.worlds import view_at
from tiles.forest import Forest
from tiles.lanes import Lane


def test_a_body_of_no_content_is_as_long_as_the_index_says(
    forests: dict[Lane, Forest],
) -> None:
    record = forests[Lane.TERRAIN].records[7]
    assert SizeSource().read(record) == bytes(int(record["tile_bytes"]))


@pytest.mark.parametrize("latency_ms", [0.0, 30.0])
def test_a_busy_line_carries_its_bytes_a_second_to_the_byte(
    store_path: Path, latency_ms: float
) -> None:
    rate = 4096 / MIB
    settings = PagerSettings(throttle=Throttle(rate, latency_ms))
    with Pager(store_path, settings, dry=True) as pager:
        pager.view(view_at(300.0))
        arrived = []
        for i in range(1200):
            pager.advance(i / 60, (i + 1) / 60)
            arrived.append(pager.counters["bytes_read"])
            for item in pager.take_uploads(2**20):
                pager.uploaded(item.lane, item.row)
            if pager.counters["tiles_loaded"] > 60:
                break
        assert pager.line
        seconds = np.arange(1, len(arrived) + 1) / 60
        largest = max(int(f.records["tile_bytes"].max()) for f in pager.forests.values())
        assert (np.array(arrived) <= 4096 * seconds + 1e-6).all()
        # Each lane has one request on its way: the line is never idle for longer.
        if not latency_ms:
            assert (np.array(arrived) >= 4096 * seconds - 2 * largest).all()
        assert pager.line.carried_bytes >= arrived[-1]


def test_advancing_in_one_step_or_in_many_is_the_same(store_path: Path) -> None:
    counted = []
    for parts in (1, 7):
        settings = PagerSettings(throttle=Throttle(0.01, 3.0))
        with Pager(store_path, settings, dry=True) as pager:
            pager.view(view_at(300.0))
            for t in np.linspace(0.0, 2.0, parts + 1)[:-1].tolist():
                pager.advance(t, t + 2.0 / parts)
            counted.append(pager.counters["bytes_read"])
    assert counted[0] == counted[1]
    assert counted[0] > 0


def test_a_dry_pager_asks_for_the_same_tiles(store_path: Path) -> None:
    counted = []
    for dry in (False, True):
        with Pager(store_path, PagerSettings(), dry=dry) as pager:
            asked: list[tuple[Lane, int]] = []
            for i, height_m in enumerate(np.geomspace(1e6, 100, 60).tolist()):
                view = view_at(height_m, t_s=i / 60)
                pager.view(view)
                pager.advance(i / 60, (i + 1) / 60)
                for item in pager.take_uploads(2**20):
                    asked.append((item.lane, item.row))
                    pager.uploaded(item.lane, item.row)
            counted.append((asked, pager.counters))
    assert counted[0] == counted[1]

# SPDX-License-Identifier: Apache-2.0
from pathlib import Path

import numpy as np
import pytest

from geopage.settings import MIB, Throttle
from geopage.source import Line, StoreSource, ThrottledSource
from tiles.codec import checksum
from tiles.errors import TileFault
from tiles.forest import Forest
from tiles.lanes import Lane
from tiles.store import Store


def test_a_store_gives_the_body_that_the_record_names(store_path: Path) -> None:
    with Store(store_path) as store:
        record = store.index(Lane.TERRAIN)[40]
    source = StoreSource(store_path, Lane.TERRAIN)
    body = source.read(record)
    source.close()
    assert checksum(Lane.TERRAIN, int(record["cell"]), body) == record["check"]


def test_a_wrong_checksum_is_a_fault(store_path: Path) -> None:
    with Store(store_path) as store:
        record = store.index(Lane.TERRAIN)[40].copy()
    record["check"] += 1
    source = StoreSource(store_path, Lane.TERRAIN)
    with pytest.raises(TileFault, match="checksum"):
        source.read(record)
    source.close()


def test_a_line_carries_one_transfer_at_a_time() -> None:
    line = Line(Throttle(2.0, 50.0))
    assert line.arrives_s(MIB, 10.0) == pytest.approx(10.55)
    assert line.arrives_s(MIB, 10.2) == pytest.approx(11.05)
    assert line.arrives_s(MIB, 20.0) == pytest.approx(20.55)


def test_two_throttled_sources_share_their_line(forests: dict[Lane, Forest]) -> None:
    line = Line(Throttle(1000 / MIB))
    record = forests[Lane.TERRAIN].records[0]
    sources = [ThrottledSource(StoreSource(Path(), lane), line) for lane in Lane]
    ready = [source.ready_s(record, 0.0) for source in sources]
    np.testing.assert_allclose(ready, np.cumsum([record["tile_bytes"]] * 2) / 1000)

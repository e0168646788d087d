# SPDX-License-Identifier: Apache-2.0
"""Failures: reads that are slow, that fail, and that bring what was not written."""

import sqlite3
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest

from geopage.settings import Throttle
from tests.geopage.trial import HIGH_M, PLAIN, Trial, approach
from tests.geopage.worlds import SPOT, deep_globe, object_records, write_store
from tiles.lanes import Lane
from viewer.stability.site import Site

SITE, NEAR_M = Site(*SPOT), 300.0
SPOIL = {
    "corrupt": "UPDATE tile SET body = zeroblob(length(body))",
    "cut short": "UPDATE tile SET body = substr(body, 1, length(body) / 2)",
    "gone": "DELETE FROM tile",
}


@pytest.mark.parametrize("how", SPOIL)
def test_tiles_that_cannot_be_had_are_stood_in_for_and_read_once(
    tmp_path: Path, how: str
) -> None:
    path = tmp_path / "spoilt.geopage"
    write_store(path, deep_globe(), object_records())
    with Trial(path, dry=False) as whole:
        rows = whole.pager.forests[Lane.TERRAIN].records["row"][40::3].tolist()
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.executemany(f"{SPOIL[how]} WHERE row = ?", [(row,) for row in rows])
    with Trial(path, dry=False) as trial:
        trial.fly(approach(SITE, NEAR_M))
        trial.settle(SITE.view(NEAR_M))
        trial.check()
        faults = trial.pager.faults
        assert len(faults) == len(set(faults)) > 5
        assert trial.seen.lists[-1].stand_in.any()


def test_a_line_of_seconds_makes_no_frame_wait_and_no_hole(store_path: Path) -> None:
    with Trial(store_path) as trial:
        trial.fly(approach(SITE, NEAR_M))
        needed = trial.pager.counters["tiles_loaded"]
    slow = replace(PLAIN, throttle=Throttle(1.0, 1000.0))
    with Trial(store_path, slow) as trial:
        trial.settle_globe(SITE.view(HIGH_M))
        before = trial.pager.counters["tiles_loaded"]
        trial.fly(approach(SITE, NEAR_M))
        trial.check()
        assert trial.pager.counters["tiles_loaded"] - before < needed / 2
        assert trial.seen.lists[-1].stand_in.any()
        trial.settle(SITE.view(NEAR_M, t_s=trial.now_s))
        trial.check()

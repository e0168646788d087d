# SPDX-License-Identifier: Apache-2.0
"""Failure: upload bursts. Decoded tiles pile up, and one frame uploads them all."""

from pathlib import Path

import pytest

from tests.geopage.trial import HIGH_M, PLAIN, Trial
from tests.geopage.worlds import SPOT, object_records, wide_globe, write_index
from tiles.lanes import Lane
from viewer import settle
from viewer.flight import UPLOAD_BYTES, UPLOAD_S
from viewer.stability.site import Site

BURST_BYTES = 16 << 20
TILE_BYTES = 100_000


@pytest.fixture(scope="module")
def heavy_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store whose tiles take much memory."""
    path = tmp_path_factory.mktemp("heavy") / "heavy.geopage"
    land = wide_globe()
    land["memory_bytes"] = TILE_BYTES
    write_index(path, land, object_records())
    return path


class SlowDriver:
    """A renderer whose uploads take a stated time, on a clock that it is."""

    def __init__(self, upload_s: float) -> None:
        self.now_s, self.upload_s = 0.0, upload_s
        self.uploads: list[tuple[Lane, int]] = []

    def perf_counter(self) -> float:
        return self.now_s

    def upload(self, lane: Lane, row: int, _: object) -> bool:
        self.uploads.append((lane, row))
        self.now_s += self.upload_s
        return True

    def free(self, lane: Lane, row: int) -> None:
        raise AssertionError((lane, row))


@pytest.mark.parametrize("upload_s", [1e-5, 4e-4, 3e-3])
def test_a_burst_of_16_mb_is_spread_over_frames_by_bytes_and_by_time(
    heavy_path: Path, monkeypatch: pytest.MonkeyPatch, upload_s: float
) -> None:
    count, view = BURST_BYTES // TILE_BYTES, Site(*SPOT).view(HIGH_M)
    driver = SlowDriver(upload_s)
    monkeypatch.setattr(settle, "time", driver)
    with Trial(heavy_path, PLAIN.__class__(0.05, fade_s=0.0)) as trial:
        trial.settle_globe(view)
        trial.pile_up(view, count)
        feeder = settle.Feeder(trial.pager, driver)
        frames = 0
        while len(driver.uploads) < count and frames < 2 * count:
            before, start_s = len(driver.uploads), driver.now_s
            moved = feeder.feed(trial.seen.lists[-1].number, UPLOAD_BYTES, UPLOAD_S)
            assert 1 <= moved == len(driver.uploads) - before
            assert moved * TILE_BYTES <= UPLOAD_BYTES
            # The budget says when the last upload begins.
            assert driver.now_s - start_s < UPLOAD_S + upload_s
            frames += 1
    tiles_a_frame = min(UPLOAD_BYTES // TILE_BYTES, UPLOAD_S // upload_s + 1)
    assert frames == -(-count // tiles_a_frame)
    assert len(set(driver.uploads)) == len(driver.uploads)


def test_a_tile_without_room_does_not_hold_up_the_others(heavy_path: Path) -> None:
    class Full(SlowDriver):
        def upload(self, lane: Lane, row: int, tile: object) -> bool:
            return row != first and super().upload(lane, row, tile)

    view = Site(*SPOT).view(HIGH_M)
    with Trial(heavy_path, PLAIN.__class__(0.05, fade_s=0.0)) as trial:
        trial.settle_globe(view)
        trial.pile_up(view, 20)
        (best,) = trial.pager.take_uploads(1)
        trial.pager.put_back([best])
        first, driver = best.row, Full(0.0)
        feeder = settle.Feeder(trial.pager, driver)
        assert [feeder.feed(1, TILE_BYTES) for _ in range(5)] == [1] * 5
        assert first in trial.decoded(best.lane)

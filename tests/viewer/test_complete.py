# SPDX-License-Identifier: Apache-2.0
"""Pictures without a pager: complete, and the same whatever was drawn before."""

import shutil
import sqlite3
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from geopage.selection import Thresholds, ideal
from geopage.settings import MIB, PagerSettings
from tests.viewer.small_world import write_path
from tiles.lanes import Lane
from viewer.camera_path import read_path
from viewer.complete import CompleteFrames
from viewer.poses import Flight
from viewer.session import Picture, Session

pytestmark = pytest.mark.usefixtures("gl_context")
PICTURE = Picture((160, 96))
LIMITS = Thresholds(1.0, 1.0)
TIMES_S = (0.0, 3.0, 6.0, 8.0, 9.0, 10.0)


@pytest.fixture
def session(hill_store: Path) -> Iterator[Session]:
    with Session(hill_store, PagerSettings(budget_bytes=128 * MIB), PICTURE) as made:
        yield made


def flight(session: Session, folder: Path) -> Flight:
    path = write_path(folder / "down.json", 10.0, (1e6, 200.0))
    return Flight(read_path(path), session.surface, PICTURE.size_px)


def test_a_picture_does_not_depend_on_those_before(
    session: Session, tmp_path: Path
) -> None:
    frames, poses = CompleteFrames(session), flight(session, tmp_path)

    def picture(t_s: float) -> bytes:
        frames.draw(poses.view(t_s), LIMITS)
        return session.renderer.read_rgb().tobytes()

    down = [picture(t_s) for t_s in TIMES_S]
    up = [picture(t_s) for t_s in reversed(TIMES_S)]
    assert down == up[::-1]
    assert len(set(down)) == len(TIMES_S)


def test_it_shows_what_a_settled_pager_shows(session: Session, tmp_path: Path) -> None:
    view = flight(session, tmp_path).view(9.0)
    CompleteFrames(session).draw(view, LIMITS)
    complete = session.renderer.read_rgb()
    settings = PagerSettings(1.0, budget_bytes=128 * MIB)
    with Session(session.store.path, settings, PICTURE) as other:
        other.settle(view)
        assert np.array_equal(other.renderer.read_rgb(), complete)


def test_too_small_a_budget_makes_it_coarser(hill_store: Path, tmp_path: Path) -> None:
    with Session(hill_store, PagerSettings(budget_bytes=14 * MIB), PICTURE) as small:
        view = flight(small, tmp_path).view(8.0)
        drawn, stats = CompleteFrames(small).draw(view, Thresholds(0.05, 0.05))
        assert drawn.threshold_px > 0.05
        assert not drawn.stand_in.any()
        assert stats.stand_ins == 0
        assert small.renderer.arena.used_bytes <= 14 * MIB


def test_a_broken_tile_is_reported_and_something_stands_in(
    session: Session, hill_store: Path, tmp_path: Path
) -> None:
    broken = tmp_path / "broken.geopage"
    shutil.copy(hill_store, broken)
    view = flight(session, tmp_path).view(8.0)
    drawn = ideal(session.pager.forests, view, 1.0, 1.0)
    records = session.pager.forests[Lane.TERRAIN].records[drawn.terrain]
    victim = int(records["row"][records["cell"].argmin()])
    with sqlite3.connect(broken) as store:
        (table,) = store.execute(
            "SELECT name FROM sqlite_master WHERE type='table' AND name LIKE '%tile%'"
        ).fetchone()
        store.execute(f"UPDATE {table} SET body = zeroblob(99) WHERE rowid = ?", [victim])
    store.close()
    with Session(broken, PagerSettings(), PICTURE) as other:
        frames = CompleteFrames(other)
        frames.draw(view, LIMITS)
        assert len(frames.faults) == 1
        assert not other.renderer.read_empty()[40:56].any()
        frames.draw(view, LIMITS)
        assert len(frames.faults) == 1

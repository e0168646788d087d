# SPDX-License-Identifier: Apache-2.0
"""Work in several processes: in order, bounded, and nobody is left behind."""

import multiprocessing
import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from ingest.workers import AHEAD, Workers
from tiles.errors import InputError


def square(number: int) -> int:
    return number**2


def refuse(number: int) -> int:
    raise InputError(str(number), "is odd", "choose another")


def first_last(job: tuple[int, Path]) -> int:
    """The first waits for a note."""
    number, note = job
    while number == 0 and not note.exists():
        pass
    return number


class Bench:
    """Counts the jobs that are done on it."""

    def __init__(self) -> None:
        self.done = 0


def on_bench(number: int, bench: Bench) -> tuple[int, int, int]:
    bench.done += 1
    return number, bench.done, os.getpid()


def die(number: int) -> int:
    os._exit(number)


def test_one_process_is_this_one_and_results_come_as_jobs_do() -> None:
    asked: list[int] = []

    def jobs() -> Iterator[int]:
        for number in range(5):
            asked.append(number)
            yield number

    with Workers(1, "x") as workers:
        results = workers.run(square, jobs())
        assert next(results) == 0
        assert asked == [0]
        assert list(results) == [1, 4, 9, 16]
    assert not multiprocessing.active_children()


@pytest.mark.slow
def test_several_processes_keep_the_order_and_do_not_run_ahead() -> None:
    asked: list[int] = []

    def jobs() -> Iterator[int]:
        for number in range(40):
            asked.append(number)
            yield number

    with Workers(2, "x") as workers:
        for k, result in enumerate(workers.run(square, jobs())):
            assert result == k**2
            assert len(asked) <= k + 1 + 2 * AHEAD
        with pytest.raises(InputError, match="7: is odd"):
            list(workers.run(refuse, iter([7])))
    assert not multiprocessing.active_children()


@pytest.mark.slow
def test_a_process_that_dies_is_one_line_and_the_others_are_ended() -> None:
    with (
        pytest.raises(InputError, match=r"w\.geopage: a worker process died"),
        Workers(2, "w.geopage") as workers,
    ):
        list(workers.run(die, iter(range(3))))
    assert not multiprocessing.active_children()


def test_here_the_tools_are_made_with_the_first_job_and_kept() -> None:
    made: list[Bench] = []

    def equip() -> Bench:
        made.append(Bench())
        return made[-1]

    with Workers(1, "x", equip) as workers:
        results = workers.run(on_bench, range(3))
        assert not made
        assert [done for _, done, _ in results] == [1, 2, 3]
        assert list(workers.run(on_bench, [])) == []
    assert len(made) == 1


@pytest.mark.slow
def test_each_process_makes_its_tools_once() -> None:
    with Workers(2, "x", Bench) as workers:
        results = list(workers.run(on_bench, range(12), in_order=False))
    assert sorted(number for number, _, _ in results) == list(range(12))
    for process in {process for _, _, process in results}:
        mine = [done for _, done, one in results if one == process]
        assert sorted(mine) == list(range(1, len(mine) + 1))


@pytest.mark.slow
def test_results_may_come_as_they_are_done(tmp_path: Path) -> None:
    note, found = tmp_path / "note", []
    with Workers(2, "x") as workers:
        jobs = [(k, note) for k in range(3)]
        for number in workers.run(first_last, jobs, in_order=False):
            found.append(number)
            note.touch()  # only now the first may end
        assert sorted(found) == [0, 1, 2]
        assert found[0] != 0
        assert list(workers.run(first_last, jobs)) == [0, 1, 2]

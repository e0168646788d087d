# SPDX-License-Identifier: Apache-2.0
"""Work in several processes: in order, bounded, and nobody is left behind."""

import multiprocessing
import os
from collections.abc import Iterator

import pytest

from ingest.workers import AHEAD, Workers
from tiles.errors import InputError


def square(number: int) -> int:
    return number**2


def refuse(number: int) -> int:
    raise InputError(str(number), "is odd", "choose another")


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

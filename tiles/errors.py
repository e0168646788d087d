# SPDX-License-Identifier: Apache-2.0
"""What goes wrong, in one line each."""

import argparse
import signal
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NoReturn


class InputError(Exception):
    """An input that can't be used: names it, says why and what to do.

    Parameters
    ----------
    subject : path or name of the input
    reason : what is wrong with it, without a full stop
    advice : what the user can do
    """

    def __init__(self, subject: str | Path, reason: str, advice: str) -> None:
        # All three, so that it comes whole out of a worker process.
        super().__init__(subject, reason, advice)

    def __str__(self) -> str:
        return "{}: {}; {}".format(*self.args)


class UnfinishedError(InputError):
    """Something that broke off for want of means; what was done of it is kept."""


class TileFault(Exception):  # noqa: N818 - the word of the documents; an error is the user's
    """A tile whose bytes are not what was written: never drawn, always reported."""

    def __init__(self, lane: str, cell: str, reason: str) -> None:
        super().__init__(f"{lane} tile {cell}: {reason}")


class ReadFault(TileFault):
    """A tile that could not be read this time: what is stored may be as it was written."""


class Parser(argparse.ArgumentParser):
    """A parser whose errors are one line."""

    def error(self, message: str) -> NoReturn:
        """Say what is wrong in one line and exit with 2."""
        self.exit(2, f"{self.prog}: {message}; see {self.prog} --help\n")


def is_interrupt(error: BaseException | None) -> bool:
    """Say whether Ctrl-C is behind an error: compiled code wraps it in SystemErrors."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__
    return error is not None


STOPS = signal.SIGINT, signal.SIGTERM


@contextmanager
def handled(handler: Callable[[int, Any], Any], signals: Iterable[int]) -> Iterator[None]:
    """Have signals handled so for a while; outside the main thread none comes anyway."""
    before = {}
    with suppress(ValueError):
        for number in signals:
            before[number] = signal.signal(number, handler)
    try:
        yield
    finally:
        for number, old in before.items():
            signal.signal(number, old)


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Put off Ctrl-C, and an order to end, until what must not be broken off is done."""
    held: list[int] = []
    with handled(lambda number, _: held.append(number), STOPS):
        yield
    for number in held[:1]:
        signal.raise_signal(number)

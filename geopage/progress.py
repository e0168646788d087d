# SPDX-License-Identifier: Apache-2.0
"""A progress bar that only long work shows."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from tqdm import tqdm

DELAY_S = 2.0


@contextmanager
def bar(
    what: str, total: float, unit: str, done: float = 0
) -> Iterator[Callable[[float], None]]:
    """Show on stderr how much of `total` is done, when it takes longer than two seconds.

    Parameters
    ----------
    done : how much an earlier attempt did, in no time of this one
    """
    form = "{l_bar}{bar}| {n:.0f}/{total:.0f} {unit} [{elapsed}<{remaining}]"
    with tqdm(
        total=total,
        desc=what,
        unit=unit,
        delay=DELAY_S,
        file=sys.stderr,
        bar_format=form,
        initial=done,
    ) as shown:
        yield lambda done: shown.update(done - shown.n) and None

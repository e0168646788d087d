# SPDX-License-Identifier: Apache-2.0
"""How a long stage says how far it is."""

from collections.abc import Callable

Progress = Callable[[int, int, str], None]
"""Called with done, total and what is done"""


def silent(done: int, total: int, what: str) -> None:
    """Report no progress."""

# SPDX-License-Identifier: Apache-2.0
"""Paging: what a view draws, what it wants next, and how that gets into memory.

`geopage.open(path)` opens a store for scripts and notebooks.
"""

from os import PathLike
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from geopage.world import World

__all__ = ["__version__", "open"]
__version__ = "0.1.0"


def open(path: str | PathLike[str]) -> "World":  # noqa: A001 (as in tarfile.open)
    """Open a store: sample places, find objects. Use it in a `with` statement."""
    from geopage.world import World  # noqa: PLC0415 (so that importing geopage is quick)

    return World(path)

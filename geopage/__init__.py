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
    """Open a store for scripts and notebooks. Use it in a `with` statement.

    Returns
    -------
    A world with `sample`, `objects_at`, `find`, `render` and `fly`;
    `help(geopage.world.World)` explains them. Places are longitude, then latitude.

    Raises
    ------
    InputError
        When there is no such store.
    """
    from geopage.world import World  # noqa: PLC0415 (so that importing geopage is quick)

    return World(path)

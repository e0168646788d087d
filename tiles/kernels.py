# SPDX-License-Identifier: Apache-2.0
"""One way to compile a hot loop: machine code, cached on disk, without the GIL."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., object])
UNCOUNTED: dict[str, Any] = {"_nrt": False}
"""An option that the compiler's type stubs do not list"""


def kernel(function: F) -> F:
    """Compile `function` with numba: nopython, `nogil`, cached between runs."""
    return cast("F", numba.njit(nogil=True, cache=True)(function))


def is_compiled(function: Callable[..., object]) -> bool:
    """Say whether a kernel's machine code is on disk, of this version or an older one."""
    found = cast("Any", function)
    name = f"{function.__module__.rpartition('.')[2]}.{function.__qualname__}-*.nbi"
    return any(Path(found.stats.cache_path).glob(name))


def brief(function: F) -> F:
    """Compile a kernel that keeps the GIL: for short calls between two frames.

    Who lets go of the GIL for a tenth of a millisecond may wait longer to get it back.
    """
    return cast("F", numba.njit(cache=True)(function))


def summing(function: F) -> F:
    """Compile a kernel whose sums may be reordered, so that they use vector instructions.

    Its arguments must hold no NaN.
    """
    loose = {"reassoc", "contract", "arcp", "nsz", "nnan"}
    return cast(
        "F",
        numba.njit(nogil=True, cache=True, fastmath=loose, error_model="numpy")(function),
    )


def inlined(function: F) -> F:
    """Compile a small helper that is inlined into the kernels that call it."""
    return cast("F", numba.njit(nogil=True, cache=True, inline="always")(function))


def borrowing(function: F) -> F:
    """Compile a kernel that only borrows the arrays it is given and makes none itself.

    So nobody counts who holds them, which costs a small kernel called from another, with
    tuples of arrays, as much time as its work.
    """
    return cast("F", numba.njit(nogil=True, cache=True, **UNCOUNTED)(function))

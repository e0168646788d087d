# SPDX-License-Identifier: Apache-2.0
"""OpenGL calls that moderngl lacks, and those that would hold the GIL.

moderngl holds the interpreter lock (GIL) in every call, also in a finish of 30 ms. So a
frame is a table of calls, one row each: the address of a GL entry point and its integer
or pointer arguments. One numba kernel runs the table with the GIL released, and rows
can also read the system's monotonic clock. The last clock row tells when GL was done;
what passes between that moment and the next Python statement was spent getting the
GIL back.
"""

import ctypes
import sys
import time
from collections.abc import Callable
from typing import Any

import moderngl
import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from tiles.errors import InputError
from tiles.kernels import kernel

ARGUMENTS = 11  # of glCompressedTextureSubImage3D, the longest
NEEDED = (
    "GL_ARB_clip_control",
    "GL_ARB_multi_draw_indirect",
    "GL_ARB_direct_state_access",
    "GL_ARB_base_instance",
)
CLOCK = "clock_gettime"
HAS_CLOCK = hasattr(time, "clock_gettime")
"""Elsewhere (Windows) the rows read the counter that Python's clock reads too."""

BLEND, CULL_FACE, DEPTH_TEST = 0x0BE2, 0x0B44, 0x0B71
LINES, FRONT_AND_BACK, LINE, FILL = 1, 0x0408, 0x1B01, 0x1B02
SRC_ALPHA, ONE_MINUS_SRC_ALPHA, ZERO, ONE = 0x0302, 0x0303, 0, 1
TRIANGLES, TRIANGLE_STRIP = 4, 5
UNSIGNED_BYTE, UNSIGNED_SHORT, INT, FLOAT = 0x1401, 0x1403, 0x1404, 0x1406
GEQUAL = 0x0206
COLOR, DEPTH, COLOR_BIT = 0x1800, 0x1801, 0x4000
DEPTH_COMPONENT = 0x1902
RGB, RGBA, RED_INTEGER = 0x1907, 0x1908, 0x8D94
RGBA8, RGBA32F, R32I, DEPTH_32F = 0x8058, 0x8814, 0x8235, 0x8CAC
BC1 = 0x83F0  # GL_COMPRESSED_RGB_S3TC_DXT1_EXT
FRAMEBUFFER, COLOR_0, DEPTH_ATTACHMENT = 0x8D40, 0x8CE0, 0x8D00
READ_FRAMEBUFFER, DRAW_FRAMEBUFFER, FRAMEBUFFER_SRGB = 0x8CA8, 0x8CA9, 0x8DB9
FRAMEBUFFER_COMPLETE, RENDERBUFFER = 0x8CD5, 0x8D41
UNIFORM_BUFFER, DRAW_INDIRECT_BUFFER, PACK_ALIGNMENT = 0x8A11, 0x8F3F, 0x0D05
TEXTURE_2D, TEXTURE_2D_ARRAY = 0x0DE1, 0x8C1A
TEXTURE_BUFFER, R8UI = 0x8C2A, 0x8232
RG, RG8 = 0x8227, 0x822B
MIN_FILTER, MAG_FILTER, WRAP_S, WRAP_T = 0x2801, 0x2800, 0x2802, 0x2803
NEAREST, LINEAR = 0x2600, 0x2601
LINEAR_MIPMAP_NEAREST, LINEAR_MIPMAP_LINEAR = 0x2701, 0x2703
REPEAT, CLAMP_TO_EDGE = 0x2901, 0x812F
LOWER_LEFT, ZERO_TO_ONE = 0x8CA1, 0x935F
VERSION, DYNAMIC_DRAW = 0x1F02, 0x88E8


def _call_row(typing_context: Any, row: Any) -> Any:  # noqa: ARG001
    """Call the function whose address and arguments lie at an address."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:  # noqa: ARG001
        word = ir.IntType(64)
        base = builder.inttoptr(values[0], word.as_pointer())
        words = [
            builder.load(builder.gep(base, [word(i)], source_etype=word))
            for i in range(ARGUMENTS + 1)
        ]
        function = ir.FunctionType(word, [word] * ARGUMENTS)
        return builder.call(builder.inttoptr(words[0], function.as_pointer()), words[1:])

    return types.int64(types.int64), generate


_call: Any = intrinsic(_call_row)


@kernel
def run_table(table: int, count: int) -> int:
    """Run `count` rows of 12 int64 at an address; returns what the last call returned."""
    result = 0
    for i in range(count):
        result = _call(table + i * 96)
    return result


def egl_loader() -> Callable[[str], int]:
    """Return the loader of GL entry points of a headless context."""
    if sys.platform != "linux":
        from viewer.window_context import address_of  # noqa: PLC0415  (imports this module)

        return address_of
    get = ctypes.CDLL("libEGL.so.1").eglGetProcAddress
    get.restype, get.argtypes = ctypes.c_void_p, [ctypes.c_char_p]
    return lambda name: int(get(name.encode()) or 0)


def open_headless() -> moderngl.Context:
    """Return a context without a window.

    Raises
    ------
    InputError
        When there is no EGL or no driver, in one line that says what to install.
    """
    if sys.platform != "linux":  # no EGL: a window that is never shown
        from viewer.window import open_hidden  # noqa: PLC0415  (imports this module)

        return open_hidden()
    try:
        settings: dict[str, Any] = {"standalone": True, "backend": "egl"}
        return moderngl.create_context(**settings)
    except Exception as error:  # moderngl and glcontext raise the bare class
        advice = "install libegl1 and libgl1 (Debian), or a graphics driver"
        raise InputError("OpenGL", f"no context ({error})", advice) from error


class Gl:
    """Entry points of one context, callable only where that context is current.

    A GL call on a thread without a context does nothing and reports no error, so every
    entry asks the driver first, which answers only where a context is current. Where
    two contexts live on one thread, the right one is made current.
    """

    def __init__(
        self, context: moderngl.Context, load: Callable[[str], int] | None = None
    ) -> None:
        self.context = context
        self._load = load or egl_loader()
        self._addresses = {CLOCK: _clock_address()}
        self._functions: dict[str, Any] = {}
        self._version = ctypes.PYFUNCTYPE(ctypes.c_void_p, ctypes.c_uint)(
            self.address("glGetString")
        )
        context.mglo.__enter__()
        current = self._load("eglGetCurrentContext")
        self._current = ctypes.PYFUNCTYPE(ctypes.c_void_p)(current) if current else None
        self._handle = self._current() if self._current else None
        self._require()
        self.is_software = any(
            name in context.info["GL_RENDERER"]
            for name in ("llvmpipe", "softpipe", "Swift")
        )

    def _require(self) -> None:
        self.guard()
        missing = [name for name in NEEDED if name not in self.context.extensions]
        if missing:
            advice = "use a driver with OpenGL 4.5, for example Mesa's llvmpipe"
            raise InputError(
                self.context.info["GL_RENDERER"], f"lacks {', '.join(missing)}", advice
            )

    def guard(self) -> None:
        """Raise RuntimeError on a thread where no context is current."""
        if not self._version(VERSION):
            raise RuntimeError("OpenGL belongs to the thread that made the context")
        if self._current and self._handle and self._current() != self._handle:
            self.context.mglo.__enter__()

    def address(self, name: str) -> int:
        """Return the address of an entry point."""
        if name not in self._addresses:
            address = self._load(name)
            if not address:
                raise InputError("OpenGL", f"has no {name}", "use a driver with OpenGL 4.5")
            self._addresses[name] = address
        return self._addresses[name]

    def call(self, name: str, *arguments: int) -> int:
        """Make one short call now, holding the GIL; for set-up and small copies."""
        function = self._functions.get(name)
        if function is None:
            words = [ctypes.c_int64] * len(arguments)
            function = ctypes.PYFUNCTYPE(ctypes.c_int64, *words)(self.address(name))
            self._functions[name] = function
        return int(function(*arguments))

    def create(self, name: str, *before: int) -> int:
        """Return the new object of one of the glCreate... calls."""
        made = np.zeros(1, np.uint32)
        self.call(name, *before, 1, made.ctypes.data)
        return int(made[0])

    def check(self, doing: str) -> None:
        """Raise RuntimeError when GL reports an error."""
        error = self.call("glGetError") & 0xFFFF
        if error:
            raise RuntimeError(f"OpenGL error {error:#06x} while {doing}")


class CallTable:
    """A growing list of GL calls that run together without the GIL."""

    def __init__(self, gl: Gl, room: int = 96) -> None:
        self._gl = gl
        self._rows = np.zeros((room, ARGUMENTS + 1), np.int64)
        self._address = self._rows.ctypes.data
        self._stamps = np.zeros((room, 2), np.int64)
        self.count = 0
        self._stamp_count = 0
        self._running = False

    def add(self, name: str, *arguments: int) -> int:
        """Append a call and return its row, for `change`."""
        row = self._rows[self.count]
        row[0] = self._gl.address(name)
        row[1 : 1 + len(arguments)] = arguments
        self.count += 1
        return self.count - 1

    def stamp(self) -> int:
        """Append a look at the clock and return its number, for `stamps_ns`."""
        place = self._stamps[self._stamp_count].ctypes.data
        self.add(CLOCK, *((time.CLOCK_MONOTONIC, place) if HAS_CLOCK else (place,)))
        self._stamp_count += 1
        return self._stamp_count - 1

    def change(self, row: int, argument: int, value: int) -> None:
        """Set an argument (0 is the first) of a row."""
        self._rows[row, 1 + argument] = value

    def run(self) -> int:
        """Run all rows; returns the ns between the last clock row and this thread's GIL."""
        self._gl.guard()
        self._stamps[self._stamp_count - 1] = 0
        self._running = True
        run_table(self._address, self.count)
        now = time.perf_counter_ns()
        self._running = False
        return now - int(self.stamps_ns[-1]) if self._stamp_count else 0

    def is_back(self) -> bool:
        """Say whether GL is done and `run` waits for the GIL. Thread: any."""
        return self._running and bool(self._stamps[self._stamp_count - 1].any())

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """(s,) monotonic time of each clock row in the last run."""
        stamps = self._stamps[: self._stamp_count]
        if not HAS_CLOCK:
            return np.asarray(stamps[:, 0] * 1_000_000_000 // _ticks_per_s())
        return np.asarray(stamps[:, 0] * 1_000_000_000 + stamps[:, 1])


def _clock_address() -> int:
    library: Any = ctypes
    if HAS_CLOCK:
        function = ctypes.CDLL(None).clock_gettime
    else:
        function = library.windll.kernel32.QueryPerformanceCounter
    return int(ctypes.cast(function, ctypes.c_void_p).value or 0)


def _ticks_per_s() -> int:
    library: Any = ctypes
    ticks = ctypes.c_int64()
    library.windll.kernel32.QueryPerformanceFrequency(ctypes.byref(ticks))
    return ticks.value

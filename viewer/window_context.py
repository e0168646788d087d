# SPDX-License-Identifier: Apache-2.0
"""Opening a window and finding the driver's entry points, or saying why not."""

import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import glfw

from tiles.errors import InputError

GL_VERSION = 4, 3
NEEDS = "geopage view needs OpenGL 4.5 (or 4.3 with direct state access and clip control)"
ADVICE = {
    "darwin": "macOS stops at OpenGL 4.1: use a machine with Linux or Windows",
    "win32": "install the graphics driver of the card's maker",
}
NO_DISPLAY = (
    "run it on a desktop, or make pictures without a window: `geopage render`, `film`"
)
_WORDS = re.compile(r"""\(\d+\) b?['"]?(.*?)\.?['"]?""")


class Loader:
    """What moderngl asks of a context that it did not make."""

    def __init__(self, handle: Any) -> None:
        self._handle = handle

    def load_opengl_function(self, name: str) -> int:
        """Return the address of an entry point."""
        return address_of(name)

    def __enter__(self) -> None:
        glfw.make_context_current(self._handle)

    def __exit__(self, *_: object) -> None:
        pass

    def release(self) -> None:
        """Keep the context: it is the window's."""


def address_of(name: str) -> int:
    """Return the address of an entry point; GLFW makes up some for names it can't know."""
    if name.startswith("egl") and not _has_egl():
        return 0
    address: Any = glfw.get_proc_address(name)
    return int(address or 0)


def _has_egl() -> bool:
    handle = glfw.get_current_context()
    api = glfw.get_window_attrib(handle, glfw.CONTEXT_CREATION_API)
    return bool(api == glfw.EGL_CONTEXT_API)


def make_window(title: str, size_px: tuple[int, int], *, visible: bool) -> Any:
    """Return a new window; GLFW's errors become one line each."""
    try:
        glfw.init()
    except glfw.GLFWError as error:
        raise InputError("window", f"no display ({_reason(error)})", NO_DISPLAY) from None
    # EGL goes with headless contexts in one process, GLX does not; others have their own.
    kinds = [glfw.EGL_CONTEXT_API] if sys.platform.startswith("linux") else []
    reason = ""
    for kind in (*kinds, glfw.NATIVE_CONTEXT_API):
        glfw.default_window_hints()
        glfw.window_hint(glfw.CONTEXT_CREATION_API, kind)
        glfw.window_hint(glfw.CONTEXT_VERSION_MAJOR, GL_VERSION[0])
        glfw.window_hint(glfw.CONTEXT_VERSION_MINOR, GL_VERSION[1])
        glfw.window_hint(glfw.OPENGL_PROFILE, glfw.OPENGL_CORE_PROFILE)
        glfw.window_hint(glfw.OPENGL_FORWARD_COMPAT, glfw.TRUE)
        glfw.window_hint(glfw.VISIBLE, int(visible))
        glfw.window_hint(glfw.DEPTH_BITS, 0)
        glfw.window_hint(glfw.STENCIL_BITS, 0)
        glfw.window_hint(glfw.SCALE_TO_MONITOR, glfw.TRUE)
        try:
            return glfw.create_window(*size_px, title, None, None)
        except glfw.GLFWError as error:
            reason = _reason(error)
    advice = ADVICE.get(sys.platform, "install Mesa's drivers (libgl1-mesa-dri, libegl1)")
    raise InputError("window", f"no OpenGL context ({reason})", f"{NEEDS}; {advice}")


def _reason(error: Exception) -> str:
    """Return GLFW's own words."""
    words = _WORDS.fullmatch(str(error))
    return words[1] if words else str(error)


@contextmanager
def raising() -> Iterator[None]:
    """Turn GLFW's errors into exceptions for a while; later ones are not worth a stop."""
    glfw.ERROR_REPORTING = "raise"
    try:
        yield
    finally:
        glfw.ERROR_REPORTING = "ignore"

# SPDX-License-Identifier: Apache-2.0
"""What this machine can draw with, and what to install where something is missing."""

from importlib.util import find_spec
from typing import Any

import moderngl

from geopage import __version__
from tiles.errors import InputError
from viewer import gl
from viewer.gl import Gl
from viewer.machine import host

Json = dict[str, Any]
FAST_PATHS = {
    "clip control (reverse depth)": "GL_ARB_clip_control",
    "multi-draw indirect": "GL_ARB_multi_draw_indirect",
    "direct state access": "GL_ARB_direct_state_access",
    "base instance": "GL_ARB_base_instance",
    "BC1 textures": "GL_EXT_texture_compression_s3tc",
}
"""All but the last are needed; without that one, textures take eight times the memory."""
EXTRAS = {
    "report": ("pictures, charts", ("PIL", "matplotlib")),
    "video": ("films", ("imageio_ffmpeg",)),
    "gui": ("what the window writes and asks", ("imgui_bundle", "OpenGL")),
    "geoparquet": ("GeoParquet files", ("pyarrow",)),
}
"""What each extra is for, and the modules that it brings."""
SOFTWARE = "a graphics driver makes drawing many times as fast; this one computes pixels"


def examine() -> Json:
    """Return the driver, its fast paths, whether a window opens, extras, and advice.

    `can_draw` says whether anything can be drawn at all. Nothing is raised for what is
    missing; `advice` has a line for each.
    """
    advice: list[str] = []
    found: Json = {"geopage": __version__, **host(), "can_draw": False}
    ways = {"without_a_window": _headless, "window": _window}
    for way, attempt in ways.items():
        try:
            found |= attempt() | {"can_draw": True, way: "yes"}
        except InputError as error:
            _, reason, what_to_do = error.args
            found[way] = f"no, {reason}"
            advice.append(f"{way.replace('_', ' ')}: {what_to_do}")
    if found.get("is_software"):
        advice.append(SOFTWARE)
    found["extras"] = {name: _is_there(modules) for name, (_, modules) in EXTRAS.items()}
    missing = [name for name, there in found["extras"].items() if not there]
    advice += [f"for {EXTRAS[x][0]}: pip install geopage[{x}]" for x in missing]
    return {**found, "advice": advice}


def _headless() -> Json:
    context = gl.open_headless()
    try:
        return about(context) | {"is_software": Gl(context).is_software}
    finally:
        context.release()


def _window() -> Json:
    try:
        from viewer.window import Window  # noqa: PLC0415  (loads glfw's library)
    except ImportError as error:
        raise InputError("glfw", f"is missing ({error})", "pip install glfw") from error
    with Window("geopage doctor", (64, 64)) as window:
        return about(window.gl.context) | {"is_software": window.gl.is_software}


def about(context: moderngl.Context) -> Json:
    """Return who made a driver, and its fast paths."""
    info, names = context.info, context.extensions
    return {
        "gl_vendor": info["GL_VENDOR"],
        "gl_renderer": info["GL_RENDERER"],
        "gl_version": info["GL_VERSION"],
        "fast_paths": {what: name in names for what, name in FAST_PATHS.items()},
    }


def _is_there(modules: tuple[str, ...]) -> bool:
    return all(find_spec(module) is not None for module in modules)


def lines(found: Json) -> list[str]:
    """Return what was found as text."""
    said = []
    for key, value in found.items():
        if isinstance(value, dict):
            said.append(f"{key.replace('_', ' ')}:")
            said += [
                f"  {what}: {'yes' if there else 'no'}" for what, there in value.items()
            ]
        elif isinstance(value, bool):
            said.append(f"{key.replace('_', ' ')}: {'yes' if value else 'no'}")
        elif key != "advice" and value is not None:
            said.append(f"{key.replace('_', ' ')}: {value}")
    return said + [f"advice: {line}" for line in found["advice"]]

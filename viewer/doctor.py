# SPDX-License-Identifier: Apache-2.0
"""What this machine can draw with."""

from viewer import gl
from viewer.gl import Gl
from viewer.machine import machine


def examine() -> dict[str, object]:
    """Return what the GL driver is, and which fast paths it has.

    Raises
    ------
    InputError
        When there is no usable driver; it says what to install.
    """
    made = Gl(gl.open_headless())
    names = sorted(made.context.extensions)
    wanted = {
        "clip control (reverse depth)": "GL_ARB_clip_control",
        "multi-draw indirect": "GL_ARB_multi_draw_indirect",
        "BC1 textures": "GL_EXT_texture_compression_s3tc",
        "persistent mapping": "GL_ARB_buffer_storage",
    }
    paths = {what: name in names for what, name in wanted.items()}
    return {**machine(made), "fast_paths": paths}

# SPDX-License-Identifier: Apache-2.0
"""The machine that a figure was measured on."""

import os
import platform
import subprocess
from pathlib import Path

from viewer.gl import Gl

CPUINFO = Path("/proc/cpuinfo")


def machine(gl: Gl) -> dict[str, object]:
    """Return processor, cores, GL renderer, Python and commit."""
    info = gl.context.info
    driver = {"gl_renderer": info["GL_RENDERER"], "gl_version": info["GL_VERSION"]}
    return {**host(), **driver, "commit": commit()}


def where_measured(where: dict[str, object]) -> dict[str, object]:
    """Return what a file of figures says of the machine, given as `machine` does."""
    return {
        "machine": f"{where['cpu']}, {where['cores']} cores",
        "gl_renderer": where["gl_renderer"],
        "python": where["python"],
        "commit": where["commit"] or "unknown",
    }


def host() -> dict[str, object]:
    """Return processor, cores, Python and operating system."""
    return {
        "cpu": cpu_name(),
        "cores": os.cpu_count(),
        "python": platform.python_version(),
        "system": platform.system(),
    }


def cpu_name() -> str:
    """Return the processor's name."""
    if CPUINFO.exists():
        for line in CPUINFO.read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()


def commit() -> str | None:
    """Return the commit of the checkout that runs, None outside of one."""
    here = Path(__file__).resolve().parent
    try:
        done = subprocess.run(
            ["git", "-C", str(here), "rev-parse", "--short", "HEAD"],
            capture_output=True,
            text=True,
            timeout=5,
            check=False,
        )
    except OSError:
        return None
    return done.stdout.strip() or None

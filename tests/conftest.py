# SPDX-License-Identifier: Apache-2.0
"""Fixtures for every test: a seeded generator and a GL context without a screen."""

import signal
from collections.abc import Iterator

import moderngl
import numpy as np
import pytest
from hypothesis import settings

# The same examples on every run; no deadline, because a first call may compile a kernel.
settings.register_profile("geopage", derandomize=True, deadline=None)
settings.load_profile("geopage")

# A shell starts what it runs in the background deaf to Ctrl-C, and children inherit that.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark every test that asks for a GL context with ``gpu``."""
    for item in items:
        if "gl_context" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.gpu)


@pytest.fixture
def rng() -> np.random.Generator:
    """Random numbers that are the same in every run of a test."""
    return np.random.default_rng(20_240_229)


@pytest.fixture(scope="session")
def gl_context() -> Iterator[moderngl.Context]:
    """One headless EGL context for all tests; a test that cannot have it is skipped."""
    try:
        context = moderngl.create_context(standalone=True, backend="egl")
    except Exception as error:  # moderngl raises the bare class
        pytest.skip(f"no OpenGL context: {error}")
    yield context
    context.release()

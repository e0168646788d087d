# SPDX-License-Identifier: Apache-2.0
import ctypes
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import moderngl
import pytest

from tiles.errors import InputError
from viewer.gl import CallTable, Gl, egl_loader

USLEEP = ctypes.cast(ctypes.CDLL(None).usleep, ctypes.c_void_p).value


def waiting_table(gl: Gl, micros: int) -> CallTable:
    gl._addresses["usleep"] = int(USLEEP or 0)
    table = CallTable(gl)
    table.stamp()
    table.add("usleep", micros)
    table.stamp()
    return table


@contextmanager
def busy_thread() -> Iterator[list[int]]:
    """Count in Python on another thread."""
    count, stop = [0], []

    def work() -> None:
        while not stop:
            count[0] += 1

    thread = threading.Thread(target=work)
    thread.start()
    try:
        yield count
    finally:
        stop.append(1)
        thread.join()


def test_a_table_runs_its_rows_in_order(gl_context: moderngl.Context) -> None:
    table = waiting_table(Gl(gl_context), 2000)
    table.run()
    before, after = table.stamps_ns
    assert 2_000_000 <= after - before < 1_000_000_000


def test_another_thread_runs_while_a_table_runs(gl_context: moderngl.Context) -> None:
    table = waiting_table(Gl(gl_context), 30_000)
    table.run()
    with busy_thread() as count:
        start = count[0]
        table.run()
        assert count[0] - start > 10_000


def test_waiting_for_the_gil_is_seen(gl_context: moderngl.Context) -> None:
    table = waiting_table(Gl(gl_context), 1000)
    table.run()
    interval = sys.getswitchinterval()
    sys.setswitchinterval(0.02)
    try:
        with busy_thread():
            assert table.run() > 5_000_000
    finally:
        sys.setswitchinterval(interval)


def test_who_has_the_gil_sees_that_a_table_waits_for_it(
    gl_context: moderngl.Context,
) -> None:
    table = waiting_table(Gl(gl_context), 1000)
    table.run()
    seen: list[bool] = []
    interval = sys.getswitchinterval()
    sys.setswitchinterval(0.02)

    def watch() -> None:
        while not (seen and seen[-1]):
            seen.append(table.is_back())

    thread = threading.Thread(target=watch)
    try:
        thread.start()
        while thread.is_alive():
            assert not table.is_back()
            table.run()
    finally:
        sys.setswitchinterval(interval)
    assert seen.count(True) == 1
    assert not table.is_back()


def test_a_thread_without_the_context_is_refused(gl_context: moderngl.Context) -> None:
    table = waiting_table(Gl(gl_context), 0)
    raised: list[str] = []

    def work() -> None:
        try:
            table.run()
        except RuntimeError as error:
            raised.append(str(error))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert raised == ["OpenGL belongs to the thread that made the context"]


def test_the_right_one_of_two_contexts_is_made_current(
    gl_context: moderngl.Context,
) -> None:
    gl = Gl(gl_context)
    other = moderngl.create_context(standalone=True, backend="egl")
    try:
        assert gl._current is not None
        assert gl._current() != gl._handle
        gl.guard()
        assert gl._current() == gl._handle
    finally:
        other.release()
        gl.guard()


def test_a_missing_entry_point_is_one_line(gl_context: moderngl.Context) -> None:
    gl = Gl(gl_context)
    gl._load = lambda _: 0
    with pytest.raises(InputError) as caught:
        gl.address("glNotThere")
    assert "glNotThere" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_loader_says_zero_for_no_function() -> None:
    assert egl_loader()("") == 0

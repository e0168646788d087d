# SPDX-License-Identifier: Apache-2.0
import importlib
from pathlib import Path

import pytest

from tiles.kernels import is_compiled

CODE = """
from tiles.kernels import kernel

@kernel
def twice(x: int) -> int:
    return 2 * x
"""


def test_a_kernel_is_compiled_once_and_found_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "some_kernels.py").write_text(CODE)
    monkeypatch.syspath_prepend(tmp_path)
    found = importlib.import_module("some_kernels")
    assert not is_compiled(found.twice)
    assert found.twice(21) == 42
    assert is_compiled(found.twice)

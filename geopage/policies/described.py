# SPDX-License-Identifier: Apache-2.0
"""The policies in words, for help texts: none of them is imported for that."""

import ast
from collections.abc import Iterable
from pathlib import Path


def described(names: Iterable[str]) -> str:
    """Return a line a policy: its name, and what its module says it is."""
    lines = []
    for name in names:
        source = Path(__file__).with_name(f"{name.partition('-')[0]}.py").read_text("utf-8")
        said = ast.get_docstring(ast.parse(source)) or ""
        lines.append(f"  {name:14}{said.splitlines()[0]}")
    return "\n".join(lines)

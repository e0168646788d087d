# SPDX-License-Identifier: Apache-2.0
"""The shape of the house: who imports whom, how long a module may be, what lies where."""

import importlib
import re
import subprocess
import tomllib
from pathlib import Path
from typing import Any

import pytest
from importlinter.cli import lint_imports

ROOT = Path(__file__).parents[2]
PACKAGES = ("geopage", "tiles", "ingest", "viewer")
TOP_LEVEL_FOLDERS = {*PACKAGES, "tests", "data_samples", ".ci"}
MAX_LINES = 300
SPDX = "# SPDX-License-Identifier: Apache-2.0"

CONFIG: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text())
CONTRACTS = [contract["id"] for contract in CONFIG["tool"]["importlinter"]["contracts"]]
COMMANDS: dict[str, str] = CONFIG["project"]["entry-points"]["geopage.commands"]

# Paths that exist on one person's machine only.
MACHINE_PATH = re.compile(r"(?<![\w.~])/(?:home|root|tmp|work|Users)/\w")


def checkout_files() -> list[Path]:
    """Files of the checkout that git does not ignore, relative to its root.

    Without git, as in an unpacked archive: the files of the known folders.
    """
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    try:
        listed = subprocess.run(command, cwd=ROOT, capture_output=True, check=True)
        names = [Path(name) for name in listed.stdout.decode().split("\0") if name]
    except (OSError, subprocess.CalledProcessError):
        inside = (path for name in TOP_LEVEL_FOLDERS for path in (ROOT / name).rglob("*"))
        names = [path.relative_to(ROOT) for path in (*ROOT.glob("*"), *inside)]
        names = [name for name in names if "__pycache__" not in name.parts]
    return sorted(name for name in names if (ROOT / name).is_file())


FILES = checkout_files()
PYTHON_FILES = [path for path in FILES if path.suffix == ".py"]
MODULES = [path for path in PYTHON_FILES if path.parts[0] in PACKAGES]


def text_of(path: Path) -> str:
    """The file's text, empty for a binary one."""
    data = (ROOT / path).read_bytes()
    return "" if b"\0" in data else data.decode("utf-8", errors="replace")


@pytest.mark.parametrize("contract", CONTRACTS)
def test_an_import_contract_holds(
    contract: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(ROOT)
    config = str(ROOT / "pyproject.toml")
    status = lint_imports(config, limit_to_contracts=(contract,), no_cache=True)
    assert status == 0, capsys.readouterr().out


def test_every_package_has_modules() -> None:
    assert {path.parts[0] for path in MODULES} == set(PACKAGES)


def test_no_module_is_over_300_lines() -> None:
    modules = [path for path in PYTHON_FILES if path.parts[0] != "tests"]
    lengths = {str(path): len(text_of(path).splitlines()) for path in modules}
    assert {path: n for path, n in lengths.items() if n > MAX_LINES} == {}


def test_every_python_file_starts_with_its_licence() -> None:
    first_lines = {str(path): text_of(path).partition("\n")[0] for path in PYTHON_FILES}
    assert [path for path, line in first_lines.items() if line != SPDX] == []


def test_mypy_sees_every_module() -> None:
    settings = CONFIG["tool"]["mypy"]
    assert set(settings["packages"]) == set(PACKAGES)
    assert not {"exclude", "files", "modules"} & set(settings)
    folders = {parent for path in MODULES for parent in path.parents if parent.parts}
    hidden = [str(path) for path in folders if not (ROOT / path / "__init__.py").is_file()]
    assert hidden == []


def test_only_threaded_modules_that_exist_are_excused() -> None:
    contracts = CONFIG["tool"]["importlinter"]["contracts"]
    threads = next(contract for contract in contracts if contract["id"] == "threads")
    excused = {rule.partition(" -> ")[0] for rule in threads["ignore_imports"]}
    owners = excused - {"viewer.stability.paging_threads"}  # that one only counts threads
    assert {name.partition(".")[0] for name in owners} == {"geopage"}
    modules = {".".join(path.with_suffix("").parts) for path in MODULES}
    assert excused - modules == set()


@pytest.mark.parametrize("name", COMMANDS)
def test_a_declared_command_can_be_called(name: str) -> None:
    module, _, function = COMMANDS[name].partition(":")
    assert callable(getattr(importlib.import_module(module), function))


def test_there_are_no_further_top_level_folders() -> None:
    folders = {path.parts[0] for path in FILES if len(path.parts) > 1}
    assert folders - TOP_LEVEL_FOLDERS == set()


def test_the_samples_lie_beside_the_packages() -> None:
    ingest = importlib.import_module("ingest")
    assert ingest.__file__ is not None
    assert (Path(ingest.__file__).parent.parent / "data_samples").is_dir()


def test_no_file_names_a_path_of_one_machine() -> None:
    found = {str(path): MACHINE_PATH.findall(text_of(path)) for path in FILES}
    assert {path: hits for path, hits in found.items() if hits} == {}

# SPDX-License-Identifier: Apache-2.0
"""The umbrella command: exit codes, one line for what goes wrong, no traceback."""

import json
import sqlite3
import subprocess
import sys
from pathlib import Path

import pytest

from geopage.cli import find, guarded, main
from tests.geopage.worlds import deep_globe, object_records, write_store
from tiles.errors import InputError, TileFault


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("cli") / "world.geopage"
    write_store(path, deep_globe(), object_records())
    return path


def test_without_a_command_it_explains_itself(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 2
    assert main(["--help"]) == 0
    out = capsys.readouterr().out
    for name in ("ingest", "info", "check", "sample", "render", "fly", "chart", "remove"):
        assert name in out
        assert find(name) is not None


def test_the_version_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.startswith("geopage 0.")


def test_an_unknown_command_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explode"]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


@pytest.mark.parametrize(
    ("error", "code", "says"),
    [
        (InputError("a.tif", "is bad", "fix it"), 2, "a.tif: is bad; fix it"),
        (TileFault("TERRAIN", "3/1/0/1", "checksum differs"), 2, "checksum differs"),
        (sqlite3.OperationalError("database is locked"), 2, "another command writes to it"),
        (sqlite3.OperationalError("database or disk is full"), 2, "make room"),
        (sqlite3.DatabaseError("malformed"), 2, "geopage check"),
        (
            PermissionError(13, "Permission denied", "out.png"),
            2,
            "out.png: Permission denied",
        ),
        (KeyboardInterrupt(), 130, "stopped"),
    ],
)
def test_what_goes_wrong_is_one_line(
    error: BaseException, code: int, says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(words: list[str]) -> int:
        del words
        raise error

    assert guarded(fail, []) == code
    out, err = capsys.readouterr()
    assert out == ""
    assert len(err.splitlines()) == 1
    assert says in err


def test_a_programming_error_is_not_hidden() -> None:
    def fail(words: list[str]) -> int:
        raise KeyError(words[0])

    with pytest.raises(KeyError):
        guarded(fail, ["x"])


@pytest.mark.parametrize("command", ["info", "check", "sample"])
@pytest.mark.parametrize("kind", ["missing", "folder", "junk", "newer", "truncated"])
def test_a_store_that_can_not_be_read_is_one_line(
    command: str, kind: str, world: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / f"{kind}.geopage"
    raw = bytearray(world.read_bytes())
    if kind == "folder":
        path.mkdir()
    elif kind == "junk":
        path.write_bytes(b"junk" * 100)
    elif kind == "newer":
        raw[63] = 99
        path.write_bytes(bytes(raw))
    elif kind == "truncated":
        path.write_bytes(bytes(raw[: len(raw) // 2]))
    words = [command, str(path), *(["--at", "1,2"] if command == "sample" else [])]
    assert main(words) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert len(err.splitlines()) == 1
    assert str(path) in err


def test_info_says_what_a_store_holds(
    world: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["info", str(world)]) == 0
    assert "terrain: level" in capsys.readouterr().out
    assert main(["info", str(world), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert sum(row["cells"] for row in found["lanes"]["terrain"]) == len(deep_globe())
    assert found["bytes"] == world.stat().st_size


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (None, "no such file"),
        ("", "lacks lat_deg or lon_deg"),
        ("lat,lon\n1,2\n", "lacks lat_deg or lon_deg"),
        ("lat_deg,lon_deg\n1,2\n95,1\n", "line 3 is no place"),
        ("lat_deg,lon_deg\n1\n", "line 2 is no place"),
        ("lat_deg,lon_deg\nx,2\n", "line 2 is no place"),
        ("lat_deg,lon_deg\nnan,2\n", "line 2 is no place"),
    ],
)
def test_bad_points_are_one_line(
    content: str | None, says: str, world: Path, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    points = tmp_path / "points.csv"
    if content is not None:
        points.write_text(content)
    assert main(["sample", str(world), "--points", str(points)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert len(err.splitlines()) == 1
    assert str(points) in err
    assert says in err


@pytest.mark.parametrize("at", ["91,0", "1", "a,b", "0,1000", "nan,0"])
def test_a_bad_place_is_one_line(
    at: str, world: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["sample", str(world), "--at", at]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert len(err.splitlines()) == 1


def test_a_reader_that_goes_away_is_no_error(world: Path) -> None:
    script = "import sys; from geopage.cli import main; sys.exit(main(sys.argv[1:]))"
    words = [sys.executable, "-c", script, "info", str(world), "--json"]
    root = str(Path(__file__).parents[2])
    with subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=root
    ) as child:
        assert child.stdout is not None
        assert child.stderr is not None
        child.stdout.close()
        assert b"Traceback" not in child.stderr.read()

# SPDX-License-Identifier: Apache-2.0
from pathlib import Path

import pytest

from tiles.errors import InputError
from viewer.bookmarks import (
    Bookmark,
    bookmark_of,
    files_of,
    read_bookmarks,
    write_bookmarks,
)

MARK = Bookmark("home", 47.4, 8.5, 500.0, 10.0, -30.0)


def test_a_bookmark_leads_back_to_its_pose() -> None:
    again = bookmark_of("home", MARK.pose())
    assert again.name == MARK.name
    for name in ("lat_deg", "lon_deg", "height_m", "heading_deg", "pitch_deg"):
        assert getattr(again, name) == pytest.approx(getattr(MARK, name), abs=1e-12)


def test_bookmarks_lie_beside_the_store(tmp_path: Path) -> None:
    store = tmp_path / "w.geopage"
    assert read_bookmarks(store) == []
    assert write_bookmarks(store, [MARK]) == tmp_path / "w.geopage.bookmarks.json"
    assert read_bookmarks(store) == [MARK]


def test_where_that_is_impossible_they_lie_in_the_users_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    (tmp_path / "disc").write_text("no folder")
    store = tmp_path / "disc" / "w.geopage"
    kept = write_bookmarks(store, [MARK])
    assert kept == tmp_path / "config" / "geopage" / "w.geopage.bookmarks.json"
    assert read_bookmarks(store) == [MARK]
    (tmp_path / "config" / "geopage").rename(tmp_path / "elsewhere")
    (tmp_path / "config" / "geopage").write_text("no folder either")
    with pytest.raises(InputError, match="writable"):
        write_bookmarks(store, [MARK])


@pytest.mark.parametrize("text", ["{", '[{"name": "x"}]', "\xff"])
def test_a_broken_file_is_named_in_one_line(tmp_path: Path, text: str) -> None:
    store = tmp_path / "w.geopage"
    files_of(store)[0].write_text(text, "latin-1")
    with pytest.raises(InputError, match=r"bookmarks\.json") as found:
        read_bookmarks(store)
    assert "\n" not in str(found.value)

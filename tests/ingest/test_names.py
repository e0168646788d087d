# SPDX-License-Identifier: Apache-2.0
"""A source is called as its file; who takes another's place is named."""

from pathlib import Path

import pytest

from ingest.names import name_of
from ingest.terrain import RasterOptions, ingest_rasters
from tests.ingest.rasters import hills, north_up, write
from tiles.store import Store

SHORT = (
    ("a/dem.2019.tif", "dem.2019"),
    ("N43E007.hgt.zip", "N43E007"),
    ("town.city.json.gz", "town"),
    ("town.geojson.gz", "town"),
    ("plain", "plain"),
    (".hidden", ".hidden"),
)


@pytest.mark.parametrize(("path", "name"), SHORT)
def test_only_endings_go(path: str, name: str) -> None:
    assert name_of(path) == name


def test_a_source_that_takes_anothers_place_says_so(tmp_path: Path) -> None:
    store, options = tmp_path / "w.geopage", RasterOptions(datum="ellipsoid")
    files = []
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        path = tmp_path / folder / "dem.tif"
        write(path, hills((12, 12), 1.0, 100.0), north_up(11.0, 46.4, 0.01), "EPSG:4326")
        files.append(path)
    one, again, other = (
        ingest_rasters(store, [(path, options)], workers=1)["warnings"]
        for path in (files[0], files[0], files[1])
    )
    assert not one
    assert not again
    assert other == [f"dem: takes the place of {files[0]}; --name would keep both"]
    with Store(store) as reader:
        assert [source["path"] for source in reader.sources()] == [str(files[1])]

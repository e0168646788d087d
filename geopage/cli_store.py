# SPDX-License-Identifier: Apache-2.0
"""`geopage info`, `check`, `sample` and `find`."""

import csv
import json
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from geopage.arguments import LAT_LON, Parser, print_json, whole
from geopage.find import find_ids, view_of
from geopage.overview import overview, overview_lines
from geopage.progress import bar
from tiles.check import faults_of, warnings_of
from tiles.errors import InputError
from tiles.lanes import Lane
from tiles.places import Places
from tiles.reach import unreachable
from tiles.store import Store

DOUBTFUL_M = 10.0
"""A height that may be off by more is given with a warning."""


def info(words: list[str]) -> int:
    """Say what a store holds."""
    parser = Parser(
        "info",
        "Say what a store holds: sources, and a row a level: cells, tiles, triangles"
        " without skirts (~: estimated from a part of the tiles), bytes, the bound of the"
        " error (edge / 256) and the measured error, median and largest.",
    )
    parser.add_argument("store", type=Path)
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout")
    given = parser.read(words)
    with Store(given.store) as store:
        found = overview(store)
    if given.json:
        print_json(found)
    else:
        print("\n".join(overview_lines(found)))
    return 0


def check(words: list[str]) -> int:
    """Verify a store; 1 when something is wrong with it."""
    parser = Parser(
        "check",
        "Verify every tile's checksum and every invariant; exit 1 when one is broken.",
    )
    parser.add_argument("store", type=Path)
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout")
    given = parser.read(words)
    with Store(given.store) as store:
        with bar("checking", 100, "%") as show:
            faults = list(faults_of(store, lambda done, total: show(100 * done / total)))
        count = 0
        if not faults:
            lost = unreachable(store)
            faults = [f"object {one} is not found where it stands" for one in lost]
            count = sum(int((store.index(lane)["row"] > 0).sum()) for lane in Lane)
        warnings = [] if faults else list(warnings_of(store))
    if given.json:
        said = {"faults": faults, "warnings": warnings}
        print_json({"ok": not faults, "tiles": count, **said})
    else:
        for line in (*faults, *(f"warning: {one}" for one in warnings)):
            print(line)
        print(
            f"{given.store}: {len(faults)} faults"
            if faults
            else f"{given.store}: sound, {count} tiles"
        )
    return 1 if faults else 0


def find(words: list[str]) -> int:
    """Find objects by attribute; 1 when there are none."""
    parser = Parser(
        "find",
        "Find buildings by what is known of them: FIELD=VALUE, FIELD!=VALUE, FIELD>10\n"
        "(also <, >=, <=), FIELD~TEXT where a field contains a text, TEXT where any does.",
        "Fields are the attributes of the sources, and id, source, lon_deg, lat_deg,\n"
        "base_m, height_m and dimension_m. `geopage render STORE --at ...` with the place\n"
        "after --at shows the building.",
    )
    parser.add_argument("store", type=Path)
    parser.add_argument("condition", metavar="CONDITION")
    parser.add_argument("--limit", type=whole, default=20, metavar="N")
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout")
    given = parser.read(words)
    with Store(given.store) as store:
        ids = find_ids(store, given.condition)
        objects = store.objects(ids[: given.limit])
    for one in objects:
        one["at"] = view_of(one)
    if given.json:
        print_json({"count": len(ids), "objects": objects})
    else:
        for one in objects:
            print(_object_line(one))
        more = f", the first {len(objects)} shown" if len(ids) > len(objects) else ""
        print(f"{len(ids)} of {given.condition!r} in {given.store}{more}", file=sys.stderr)
    return 0 if ids else 1


def _object_line(one: dict[str, Any]) -> str:
    """Say what an object is and where."""
    said = json.dumps(one["attributes"], ensure_ascii=False)
    return (
        f"object {one['id']} of {one['source']}  --at {one['at']}"
        f"  {one['height_m']:.1f} m high  {said}"
    )


def sample(words: list[str]) -> int:
    """Heights, cells and buildings at places."""
    parser = Parser(
        "sample",
        "Finest height above the ellipsoid, its error bound, linked cells and buildings.",
        "A points file is CSV with the columns lat_deg,lon_deg; answers keep its order.\n"
        "Places without a source, or with an error of more than 10 m, get a `warning` in\n"
        "the JSON object, and a line on stderr.",
    )
    parser.add_argument("store", type=Path)
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument("--at", type=LAT_LON, metavar="LAT,LON")
    where.add_argument("--points", type=Path, metavar="FILE.csv")
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout")
    given = parser.read(words)
    lat_lon = np.array([given.at]) if given.at else read_points(given.points)
    with Store(given.store) as store:
        points = Places(store).at(lat_lon[:, 1], lat_lon[:, 0])
        spacing_m = {one["name"]: one["spacing_m"] for one in store.sources("terrain")}
    for point in points:
        if said := _warning(point, spacing_m):
            point["warning"] = said
    if given.json:
        print_json({"points": points})
    else:
        for point in points:
            print(_line(point))
        for line in _warning_lines(points):
            print(line, file=sys.stderr)
    return 0


def _warning(point: dict[str, Any], spacing_m: dict[str, float]) -> str:
    """Say why a height is not to be trusted; empty where it is."""
    if point["source"] is None:
        return "no source has data here: the height is made up"
    if point["error_m"] <= DOUBTFUL_M:
        return ""
    apart_m = spacing_m[point["source"]]
    return (
        f"the height may be off by {point['error_m']:.0f} m from the posts of"
        f" {point['source']}, which are {apart_m:,.0f} m apart: ingest a finer"
        " elevation model for this place"
    )


def _warning_lines(points: list[dict[str, Any]]) -> list[str]:
    """Return a line a source, with the worst height's warning."""
    doubted = sorted((p for p in points if "warning" in p), key=lambda p: p["error_m"])
    worst = {one["source"]: one["warning"] for one in doubted}
    counts = Counter(one["source"] for one in doubted)
    return [
        f"geopage: {text}"
        + (f" ({counts[name]} of {len(points)} places)" * (len(points) > 1))
        for name, text in worst.items()
    ]


def _line(point: dict[str, Any]) -> str:
    place = f"{point['lat_deg']:.7f},{point['lon_deg']:.7f}"
    height = f"{point['height_m']:.2f} m +- {point['error_m']:.2f} m"
    standing = "".join(
        f"\n  object {one['id']} of {one['source']}: {one['height_m']:.1f} m high"
        f" {one['attributes']}"
        for one in point["objects"]
    )
    linked = "".join(f" {cell}" for cell in point["linked_cells"])
    source = point["source"] or "no source here"
    ground = f"level {point['level']}  {source}" + (linked and f"  linked{linked}")
    return f"{place}  {height}  {ground}{standing}"


def read_points(path: Path) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """Read a CSV of places.

    Returns
    -------
    (n, 2) float64, latitude and longitude, degrees

    Raises
    ------
    InputError
    """
    if not path.is_file():
        raise InputError(path, "no such file", "check the path")
    with path.open(newline="", encoding="utf-8-sig", errors="replace") as file:
        rows = csv.DictReader(file)
        if not {"lat_deg", "lon_deg"} <= set(rows.fieldnames or []):
            raise InputError(path, "lacks lat_deg or lon_deg", "begin with lat_deg,lon_deg")
        found = []
        for number, row in enumerate(rows, start=2):
            try:
                place = float(row["lat_deg"]), float(row["lon_deg"])
            except (TypeError, ValueError):
                place = np.nan, np.nan
            if not (abs(place[0]) <= 90 and abs(place[1]) <= 360):
                raise InputError(
                    path, f"line {number} is no place", "give degrees, lat then lon"
                )
            found.append(place)
    return np.array(found).reshape(-1, 2)

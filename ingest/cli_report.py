# SPDX-License-Identifier: Apache-2.0
"""How `geopage ingest` prints its report."""

import json
import math
import sys
from typing import Any

from ingest.grounding_report import lines


def show(report: dict[str, Any], *, as_json: bool) -> None:
    """Print a report: one JSON object, or lines for people."""
    if as_json:
        sys.stdout.write(json.dumps(report) + "\n")
        return
    for key, value in report.items():
        if key == "warnings":
            print(*(f"warning: {one}\n" for one in value), sep="", end="")
        elif key == "sources":
            for source in value:
                print(f"source {about(source)}")
        elif key == "grounding":
            if found := lines(value):
                print("all buildings of the store, on terrain coarser than the finest:")
                print(*(f"  {one}" for one in found), sep="\n")
        elif isinstance(value, dict) and value:
            said = {name: plain(one) for name, one in value.items()}
            listed = ", ".join(f"{name} {one}" for name, one in said.items() if one)
            print(f"{key.replace('_', ' ')}: {listed}")
        elif value not in ({}, [], None):
            print(f"{key.replace('_', ' ')}: {plain(value)}")


def about(source: str | dict[str, Any]) -> str:
    """Return a line on one source: its datum, its place, and what was skipped of it."""
    if isinstance(source, str):
        return f"{source}: buildings"
    west, south, east, north = source["bounds_deg"]
    # Enough digits to tell one side from the other.
    digits = 2 - math.floor(math.log10(min(north - south, east - west)))
    corners = [f"{one:.{max(digits, 0)}f}" for one in (south, west, north, east)]
    where = "{},{} to {},{}".format(*corners)
    place = f"{source['spacing_m']:.3g} m apart from {where}"
    skipped = [f"{count} posts skipped: {why}" for why, count in source["skipped"].items()]
    met = []
    if reach_m := source.get("reach_m"):
        met = [f"meets {source['meets'] or 'sea level'} over {reach_m / 1000:.3g} km"]
    if missed_m := source.get("missed_m"):
        met += [f"1 in 100 places along its long edge is missed by over {missed_m:.2g} m"]
    parts = [source.get("datum_here", "a picture"), place, *met, *skipped]
    return f"{source['name']}: {'; '.join(parts)}"


def plain(value: object) -> str:
    """Return a value of a report as people read it."""
    if isinstance(value, float):
        return f"{value:.7g}"
    return " + ".join(map(str, value)) if isinstance(value, list) else str(value)

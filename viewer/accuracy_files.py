# SPDX-License-Identifier: Apache-2.0
"""What `geopage accuracy` found, in files."""

import csv
import json
from collections.abc import Sequence
from pathlib import Path

from tiles.errors import InputError
from viewer.accuracy_chart import accuracy_chart
from viewer.accuracy_table import CHART, as_markdown
from viewer.tally import Json, Tally

COLUMNS = (
    *("threshold_px", "lat_deg", "lon_deg", "height_m", "heading_deg", "pitch_deg"),
    *("judged", "p50", "p95", "p99", "max", "share_within_threshold", "triangles"),
    "raised_threshold_px",
)


def write(out: Path, report: Json, tallies: Sequence[Tally]) -> None:
    """Write accuracy.json, views.csv with a line per view, ACCURACY.md and its chart.

    Raises
    ------
    InputError
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
        text = json.dumps(report, indent=2, allow_nan=False)
        (out / "accuracy.json").write_text(text + "\n")
        with (out / "views.csv").open("w", newline="") as file:
            table = csv.DictWriter(file, COLUMNS)
            table.writeheader()
            for tally in tallies:
                table.writerows(tally.rows)
        (out / CHART).parent.mkdir(exist_ok=True)
        drawn = accuracy_chart(tallies, out / CHART)
        (out / "ACCURACY.md").write_text(as_markdown(report, drawn))
    except OSError as error:
        advice = "name a folder that can be made"
        raise InputError(out, str(error.strerror or error), advice) from error

# SPDX-License-Identifier: Apache-2.0
"""What paging may cost, and whether it does."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from geopage.settings import MIB
from tiles.errors import InputError
from viewer.paging_chart import OURS, REFERENCE

Json = dict[str, Any]
MET, MISSED, OPEN = "met", "MISSED", "open"
OVER_IDEAL, NEVER_DRAWN = 1.3, 0.05
GOOD, BEHIND_POINTS = 0.95, 3.0
HALF = 0.5
HUGE_HOLES = "a city ten times the budget, a store of 20 GB: frames with a hole"
HUGE_BYTES = "the same city: most bytes in use, index included"
HUGE_RSS = "the same city: most that the process grew by"
FLAT = "frame time with 1,000,000 objects in the store / with 1,000, worst of 5 views"
"""What benchmarks measure"""


@dataclass(frozen=True, slots=True)
class Line:
    """One number beside its limit."""

    what: str
    limit: str
    found: str
    verdict: str
    note: str = ""


def line(what: str, limit: str, found: str, note: str = "", *, is_met: bool) -> Line:
    """Return a number that was measured."""
    return Line(what, limit, found, MET if is_met else MISSED, note)


def as_dict(one: Line) -> Json:
    """Return a number, JSON-ready."""
    return asdict(one)


def read_lines(path: Path) -> list[Line]:
    """Read numbers that a benchmark wrote.

    Raises
    ------
    InputError
    """
    try:
        return [Line(**one) for one in json.loads(path.read_text())["numbers"]]
    except (OSError, ValueError, KeyError, TypeError) as error:
        reason = f"holds no numbers of a benchmark: {error}"
        raise InputError(path, reason, "name what --numbers wrote") from error


def in_words(one: Line) -> str:
    """Return a number as a line of text."""
    note = f"; {one.note}" if one.note else ""
    return f"{one.verdict:7} {one.what}: {one.found or '-'} (limit {one.limit}{note})"


def of_policy(runs: Sequence[Json], policy: str, times: float | None) -> list[Json]:
    """Return the runs of a policy over lines of one speed."""
    return [run for run in runs if run["policy"] == policy and run["times"] == times]


def replayed(runs: Sequence[Json], budget_bytes: int) -> list[Line]:
    """Hold what replays found against its limits."""
    free = of_policy(runs, OURS, None)
    peak = max(run["peak_bytes"] for run in runs)
    found = [at_half(*pair) for pair in beside_reference(runs)]
    if free:
        found += [over_ideal(run) for run in free] + [undrawn(run, runs) for run in free]
    found.append(
        line(
            f"most bytes in use, all {len(runs)} replays",
            f"{budget_bytes / MIB:,.0f} MiB",
            f"{peak / MIB:,.0f} MiB",
            is_met=peak <= budget_bytes,
        )
    )
    return found


def beside_reference(runs: Sequence[Json]) -> list[tuple[Json, Json | None]]:
    """Return our runs at half the line, each with the clairvoyant's."""
    theirs = {run["flight"]: run for run in of_policy(runs, REFERENCE, HALF)}
    return [(run, theirs.get(run["flight"])) for run in of_policy(runs, OURS, HALF)]


def at_half(ours: Json, theirs: Json | None) -> Line:
    """Say whether enough frames are good over half of the line that a flight needs."""
    share = ours["share_frames_within"]
    behind = 100 * (theirs["share_frames_within"] - share) if theirs else 100.0
    note = f"{REFERENCE} {theirs['share_frames_within']:.1%}" if theirs else ""
    return line(
        f"frames within {ours['threshold_px']:g} px at {HALF:g} x, {ours['flight']}",
        f"95 %, or {BEHIND_POINTS:g} points behind {REFERENCE}",
        f"{share:.1%}",
        note,
        is_met=share >= GOOD or behind <= BEHIND_POINTS,
    )


def over_ideal(run: Json) -> Line:
    """Say how much more is read than the views draw."""
    ratio = run.get("bytes_over_ideal", 1.0)
    return line(
        f"bytes read / bytes of the ideal draw sets, {run['flight']}",
        f"{OVER_IDEAL:g}",
        f"{ratio:.2f}",
        f"{run['bytes_read'] / 1e6:.2f} MB read, not throttled",
        is_met=ratio <= OVER_IDEAL,
    )


def undrawn(run: Json, runs: Sequence[Json]) -> Line:
    """Say how much of what is loaded is never drawn, over a fast line too."""
    share = _undrawn(run)
    times = max((one["times"] for one in runs if (one["times"] or 0) > 1), default=None)
    also = [
        f"; {_undrawn(one):.1%} at {times:g} x"
        for one in of_policy(runs, OURS, times)
        if times and one["flight"] == run["flight"]
    ]
    return line(
        f"tiles loaded and never drawn, {run['flight']}",
        f"{NEVER_DRAWN:.0%}",
        f"{share:.1%}",
        f"of {run['tiles_loaded']} tiles, not throttled{''.join(also)}",
        is_met=share <= NEVER_DRAWN,
    )


def _undrawn(run: Json) -> float:
    return float(run["prediction"].get("never_drawn_share", 0.0))

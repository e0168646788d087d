# SPDX-License-Identifier: Apache-2.0
"""PAGING.md: each number beside its limit, and all replays."""

from collections.abc import Iterable, Sequence
from typing import Any

from viewer.paging_chart import OURS, REFERENCE
from viewer.paging_numbers.limits import HALF, MISSED, Line, of_policy

Json = dict[str, Any]
CHART = "pictures/policies.svg"
LEAD = (
    "Replays run by a virtual clock: selecting, reading and decoding take no time, a line"
    " carries so many bytes a second. They give the same figures on any machine. A line"
    " of *1 x* carries the bytes of the distinct tiles that the flight's views draw, when"
    " all is there, in just the time that the flight takes. *Within* is the share of"
    " frames whose 95th percentile of the terrain's screen error, by area, is at most the"
    " threshold; *complete* that of frames in which, besides, no object tile is missing."
    " Each flight begins when its first view has all that it needs."
)
REFERENCE_TEXT = (
    f"`{REFERENCE}` knows the flight beforehand. It is there for the terrain: objects come"
    " in the order of their screen error."
)
MORE = (
    "- `geopage fly STORE PATH --pairs 5 --out DIR`: a flight beside its floors",
    "- `geopage fly STORE PATH --profile T_S --out DIR`: where one frame's time goes",
    "- `geopage replay STORE PATH --policy NAME --throttle MIB_PER_S,MS --out DIR`: what"
    " became of each tile",
    "- `geopage stability --out DIR`: where paging fails, and how far we are from it",
    "- `python -m tests.benchmarks.huge_city FOLDER`: a city ten times the budget, 20 GB",
    "- `python -m tests.benchmarks.million FOLDER`: frame time over objects in the store",
)


def as_markdown(
    about: Json, lines: Sequence[Line], runs: Sequence[Json], profile: Sequence[str]
) -> str:
    """Return PAGING.md."""
    parts = ["# Paging: its numbers beside their limits"]
    parts += ["`geopage paging` wrote this file: don't edit it.", LEAD]
    parts += ["\n".join(f"- {key}: {value}" for key, value in about.items())]
    parts += ["## Numbers and limits", counted(lines), _numbers(lines)]
    if any(run["times"] for run in runs):
        parts += ["## Share of good frames over line speed", f"![Curves]({CHART})"]
    if of_policy(runs, OURS, HALF):
        parts += [f"## How far ahead {OURS} is at {HALF:g} x", _leads(runs)]
    parts += ["## All replays", REFERENCE_TEXT, *_flights(runs)]
    if profile:
        parts += ["## One frame", "```\n" + "\n".join(profile) + "\n```"]
    parts += ["## To look closer", "\n".join(MORE)]
    return "\n\n".join(parts) + "\n"


def counted(lines: Sequence[Line]) -> str:
    """Say how many numbers keep their limits, and which do not."""
    verdicts = [one.verdict for one in lines]
    told = [f"{verdicts.count(one)} {one}" for one in dict.fromkeys(verdicts)]
    return f"{len(lines)} numbers: {', '.join(told)}."


def _numbers(lines: Sequence[Line]) -> str:
    rows = [
        (one.what, one.limit, one.found, _strong(one.verdict), one.note) for one in lines
    ]
    return table(("number", "limit", "found", "", "note"), rows)


def _strong(verdict: str) -> str:
    return f"**{verdict}**" if verdict == MISSED else verdict


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table of a document; numbers stand right."""
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    return "\n".join(
        "| " + " | ".join(text.replace("|", "/") for text in row) + " |" for row in lines
    )


def names_of(runs: Sequence[Json], key: str) -> list[Any]:
    """Return the different values of a column, in order of coming."""
    return list(dict.fromkeys(run[key] for run in runs))


def _leads(runs: Sequence[Json]) -> str:
    """Return points between our policy and each other, within and complete."""
    others = [name for name in names_of(runs, "policy") if name != OURS]
    rows = []
    for flight in names_of(runs, "flight"):
        here = {run["policy"]: run for run in runs if _is_at(run, flight, HALF)}
        ours = here[OURS]
        rows.append([flight, _shares(ours), *(_points(ours, here[n]) for n in others)])
    text = "In points, *within* and in brackets *complete*; a minus: we lose."
    return text + "\n\n" + table(["flight", OURS, *others], rows)


def _is_at(run: Json, flight: str, times: float | None) -> bool:
    return bool(run["flight"] == flight and run["times"] == times)


def _points(ours: Json, theirs: Json) -> str:
    within, complete = (
        100 * (ours[key] - theirs[key])
        for key in ("share_frames_within", "share_frames_complete")
    )
    return f"{within:+.1f} ({complete:+.1f})"


def _shares(run: Json) -> str:
    within, complete = run["share_frames_within"], run["share_frames_complete"]
    return f"{100 * within:.1f} ({100 * complete:.1f})"


def _flights(runs: Sequence[Json]) -> list[str]:
    """Return for each flight its tables."""
    parts = []
    for flight in names_of(runs, "flight"):
        here = [run for run in runs if run["flight"] == flight]
        first = here[0]
        slow = [
            f"{run['times']:g} x: {run['throttle'][0]:.3g} MiB/s"
            for run in here
            if run["times"] and run["policy"] == first["policy"]
        ]
        text = (
            f"{first['seconds']:g} s, {first['frames']} frames; its views draw"
            f" {first['ideal_bytes'] / 1e6:.2f} MB. {', '.join(slow)}."
            " Frames within (complete), %:"
        )
        parts += [f"### {flight}", text, _frames(here), "What was read, and how late:"]
        parts += [_reading(here)]
    return parts


def _frames(here: Sequence[Json]) -> str:
    """Return good frames, a row for each policy and a column for each line."""
    lines = names_of(here, "times")
    rows = [
        [policy, *(_shares(run) for run in here if run["policy"] == policy)]
        for policy in names_of(here, "policy")
    ]
    return table(["policy", *(_speed(times) for times in lines)], rows)


def _speed(times: float | None) -> str:
    return f"{times:g} x" if times else "not throttled"


READING = (
    ("bytes / ideal", "bytes_over_ideal", "{:.2f}"),
    ("never drawn", "never_drawn_share", "{:.1%}"),
    ("hit", "prediction_hit_share", "{:.0%}"),
    ("late tiles", "tiles_late", "{:.0f}"),
    ("late by, p95 ms", "late_p95_ms", "{:,.0f}"),
)


def _reading(here: Sequence[Json]) -> str:
    """Return what the policies read at half the line and as fast as can be."""
    speeds = [times for times in names_of(here, "times") if times in {HALF, None}]
    head = [f"{title}, {_speed(t)}" for t in speeds for title, _, _ in READING]
    rows = []
    for policy in names_of(here, "policy"):
        row = [policy]
        for times in speeds:
            (run,) = of_policy(here, policy, times)
            values = {**run, **run["prediction"]}
            row += [f.format(values[k]) if k in values else "-" for _, k, f in READING]
        rows.append(row)
    return table(["policy", *head], rows)

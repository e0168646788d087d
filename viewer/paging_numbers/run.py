# SPDX-License-Identifier: Apache-2.0
"""Measure everything, and write PAGING.md, paging.json and the chart."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from geopage.progress import bar
from geopage.settings import MIB, REPLAYED, PagerSettings
from tiles.errors import InputError
from tiles.store import Store
from viewer.machine import commit, host
from viewer.paging_chart import paging_chart, panels_of
from viewer.paging_numbers.document import CHART, as_markdown
from viewer.paging_numbers.jobs import Job, each, ideal_of, replay
from viewer.paging_numbers.limits import Line, as_dict, replayed
from viewer.paging_numbers.live import ELSEWHERE, PACED, at_rest, beside_floors, profile
from viewer.paging_numbers.routes import RATE_HZ, SAMPLE, TIMES, Route
from viewer.session import Picture

Json = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Asked:
    """What is to be measured."""

    routes: Sequence[Route]
    policies: Sequence[str]
    times: Sequence[float]
    settings: PagerSettings
    size_px: tuple[int, int]
    frame_s: float
    out: Path
    pairs: int = 0
    profile_s: float | None = None
    also: Sequence[Line] = ()


def measure(asked: Asked) -> Json:
    """Measure and write; return what paging.json holds.

    Raises
    ------
    InputError
    """
    _folders(asked.out)
    runs = replays(asked)
    lines = replayed(runs, asked.settings.budget_bytes)
    first, picture = asked.routes[0], Picture(asked.size_px)
    lines += at_rest(first, asked.size_px)
    told: list[str] = []
    real = asked.out / "real_time"
    if asked.pairs:
        lines += beside_floors(first, asked.settings, picture, asked.pairs, real)
    else:
        lines += PACED
    if asked.profile_s is not None:
        told = profile(first, asked.settings, picture, asked.profile_s, real)
    lines += [*asked.also, *(one for one in ELSEWHERE if one.what not in _named(asked))]
    about = about_of(asked)
    found = {
        "about": about,
        "numbers": [as_dict(one) for one in lines],
        "runs": runs,
        "profile": told,
    }
    _write(asked.out, as_markdown(about, lines, runs, told), found)
    return found


def _named(asked: Asked) -> set[str]:
    return {one.what for one in asked.also}


def replays(asked: Asked) -> list[Json]:
    """Page all flights under all policies over all lines."""
    settings = replace(asked.settings, fade_s=0.0)
    plain = [Job(r, asked.size_px, settings, asked.frame_s) for r in asked.routes]
    with bar("what the flights need", len(plain), "flights") as show:
        ideal = each(ideal_of, plain, show)
    jobs = [
        replace(
            job,
            ideal_bytes=needs,
            times=times,
            settings=replace(settings, policy=policy),
        )
        for job, needs in zip(plain, ideal, strict=True)
        for policy in asked.policies
        for times in (*asked.times, None)
    ]
    with bar("paging", len(jobs), "replays") as show:
        return each(replay, jobs, show)


def about_of(asked: Asked) -> Json:
    """Return what the header says."""
    where, settings = host(), asked.settings
    words = {}
    for store in dict.fromkeys(route.store for route in asked.routes):
        paths = [route.path.stem for route in asked.routes if route.store == store]
        words[f"store {store.stem}"] = f"{_of_store(store)}; flown: {', '.join(paths)}"
    size = " x ".join(map(str, asked.size_px))
    hz = 1 / asked.frame_s
    return {
        "command": command(asked),
        **words,
        "picture": f"{size} px, {hz:g} frames a second in replays",
        "threshold": f"{settings.threshold_px:g} px of screen error; objects from"
        f" {settings.objects_px:g} px on",
        "budget": f"{settings.budget_bytes / MIB:,.0f} MiB, indexes included",
        "machine": f"{where['cpu']}, {where['cores']} cores (replays do not depend on it)",
        "python": where["python"],
        "commit": commit() or "unknown",
    }


def command(asked: Asked) -> str:
    """Return the words that measure this again, but for what is as usual."""
    words = ["geopage paging"]
    for store in dict.fromkeys(route.store for route in asked.routes):
        paths = [route.path.stem for route in asked.routes if route.store == store]
        only = "" if tuple(paths) == SAMPLE else f"={','.join(paths)}"
        words.append(f"{store.name}{only}")
    if tuple(asked.policies) != REPLAYED:
        words.append(f"--policy {','.join(asked.policies)}")
    if tuple(asked.times) != TIMES:
        words.append(f"--times {','.join(f'{times:g}' for times in asked.times)}")
    if asked.frame_s != 1 / RATE_HZ:
        words.append(f"--rate {1 / asked.frame_s:g}")
    if asked.pairs:
        words.append(f"--pairs {asked.pairs}")
    if asked.profile_s is not None:
        words.append(f"--profile {asked.profile_s:g}")
    return " ".join([*words, "--out DIR"])


def _of_store(path: Path) -> str:
    """Say what a store holds."""
    with Store(path) as store:
        names = ", ".join(source["name"] for source in store.sources())
        count = store.object_count()
    return f"{path.stat().st_size / 1e6:,.0f} MB, {count:,} buildings, from {names}"


def _folders(out: Path) -> None:
    """Make the folders before anything is measured."""
    try:
        (out / CHART).parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        advice = "name a folder that can be made"
        raise InputError(out, str(error.strerror or error), advice) from error


def _write(out: Path, text: str, found: Json) -> None:
    try:
        (out / "paging.json").write_text(json.dumps(found, indent=1) + "\n")
        (out / "PAGING.md").write_text(text)
    except OSError as error:
        reason = str(error.strerror or error)
        raise InputError(out, reason, "name a folder that can be written") from error
    if any(run["times"] for run in found["runs"]):
        paging_chart(panels_of(found["runs"]), out / CHART)

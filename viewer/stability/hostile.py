# SPDX-License-Identifier: Apache-2.0
"""Numbers that are none: in camera paths, and in views that a program makes."""

import json
import math
import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

from geopage.settings import PagerSettings
from geopage.view import ViewState
from tiles.errors import InputError
from tiles.frames import Ecef
from viewer.camera_path import RANGES, read_path
from viewer.flight import FRAME_S
from viewer.paging import Paging
from viewer.stability.memory import still_view
from viewer.stability.place import Place
from viewer.stability.row import Finding, Row

BAD = ("NaN", "Infinity", "-Infinity", "1e999", "null", '"x"', "[]", "1e308")
FRAMES = 6


def whole_path() -> dict[str, Any]:
    """Return a camera path that is right."""
    pose = {"lat_deg": 1.0, "lon_deg": 2.0, "height_m": 9.0}
    pose |= {"heading_deg": 0.0, "pitch_deg": 0.0}
    frames = [{"t_s": float(t), **pose} for t in range(3)]
    return {
        "name": "hostile",
        "duration_s": 3.0,
        "height_reference": "ellipsoid",
        "interpolation": "linear",
        "keyframes": frames,
    }


def poisoned_paths() -> list[str]:
    """Return texts of paths, each with one number that is none or far outside."""
    found = []
    for field, bad, frame in product(RANGES, BAD, range(3)):
        path = whole_path()
        path["keyframes"][frame][field] = "HERE"
        found.append(json.dumps(path).replace('"HERE"', bad))
    whole = json.dumps({**whole_path(), "duration_s": "HERE"})
    return [*found, *(whole.replace('"HERE"', bad) for bad in BAD)]


def paths(_: Place) -> Finding:
    """Read paths with poison in every place."""
    texts, accepted, naive = poisoned_paths(), 0, 0
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "path.json"
        for text in texts:
            file.write_text(text)
            accepted += is_read(file)
            naive += is_json(text)
    note = "others: what a JSON reader takes as it is"
    return Finding(float(len(texts)), accepted, math.nan, float(len(texts)), naive, note)


def is_read(file: Path) -> bool:
    """Say whether a path is accepted."""
    try:
        read_path(file)
    except InputError:
        return False
    return True


def is_json(text: str) -> bool:
    """Say whether Python's own reader takes a text."""
    try:
        json.loads(text)
    except ValueError:
        return False
    return True


def poisons(good: ViewState) -> list[Callable[[], ViewState]]:
    """Return makers of views with one bad number each."""
    makers: list[Callable[[], ViewState]] = []
    for bad in (math.nan, math.inf, -math.inf):
        for i in range(3):
            eye, rotation = good.eye.copy(), good.rotation.copy()
            eye[i] = rotation[i, i] = bad
            makers.append(partial(replace, good, eye=Ecef(eye)))
            makers.append(partial(replace, good, rotation=rotation))
        makers.append(partial(replace, good, focal_px=bad))
        makers.append(partial(replace, good, t_s=bad))
    return makers


def views(place: Place) -> Finding:
    """Give the pager views with poison between good ones: what it draws must stay."""
    good = still_view(place)
    makers = poisons(good)
    lost = sum(not survives(place, good, maker) for maker in makers)
    count = float(len(makers))
    return Finding(
        count, lost, math.nan, count, note=f"each between {2 * FRAMES} good ones"
    )


def survives(place: Place, good: ViewState, poisoned: Callable[[], ViewState]) -> bool:
    """Say whether a bad view is refused, and the good one complete again after it."""
    paging = Paging(place.store, PagerSettings())
    with paging.pager as pager:
        now_s = paging.settle(good)
        refused = False
        for i in range(2 * FRAMES):
            view = good
            if i == FRAMES:
                try:
                    view = poisoned()
                except ValueError:
                    refused = True
            drawn = paging.frame(view)
            pager.advance(now_s, now_s + FRAME_S)
            now_s += FRAME_S
        return refused and bool(len(drawn.terrain)) and paging.missing(good) == (0, 0)


ROWS = (
    Row(
        "NaN in a camera path",
        "a number that is none goes through, and the flight with it",
        "paths with one bad number",
        "paths that are accepted",
        0.0,
        paths,
    ),
    Row(
        "NaN in a view",
        "one bad view of a program stops the pager, or the program",
        "views with one bad number",
        "views that are not refused, or after which good ones are not complete",
        0.0,
        views,
    ),
)

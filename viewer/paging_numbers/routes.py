# SPDX-License-Identifier: Apache-2.0
"""Which camera paths are flown over which stores."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from tiles.errors import InputError
from tiles.samples import PATHS

SAMPLE = (
    "fly_in",
    "street_slow",
    "street_fast",
    "street_turning",
    "street_backward",
    "street_revisit",
)
"""The sample world's fly-in and its street sessions"""
TIMES, RATE_HZ = (0.25, 0.5, 1.0, 2.0), 20.0
"""Lines, in what a flight needs, and frames a second, if not told otherwise"""


class Route(NamedTuple):
    """A camera path over a store."""

    store: Path
    path: Path

    @property
    def title(self) -> str:
        """What it is called."""
        return f"{self.path.stem} over {self.store.stem}"


def read_routes(words: Sequence[str]) -> list[Route]:
    """Read words such as `world.geopage` or `monaco.geopage=monaco,other.json`.

    A store without paths is flown on those of the sample world.

    Raises
    ------
    InputError
    """
    routes: list[Route] = []
    for word in words:
        store, _, names = word.partition("=")
        if not Path(store).is_file():
            raise InputError(store, "no such file", "name a store: STORE[=PATH[,PATH..]]")
        paths = [_path_of(name) for name in (names.split(",") if names else SAMPLE)]
        routes += [Route(Path(store), path) for path in paths]
    titles = [route.title for route in routes]
    for title in titles:
        if titles.count(title) > 1:
            raise InputError(title, "stands there twice", "leave one out or rename it")
    return routes


def _path_of(name: str) -> Path:
    """Return a file, or the camera path among the samples that is called so."""
    sample = PATHS / f"{name}.json"
    if Path(name).is_file():
        return Path(name)
    if sample.is_file():
        return sample
    advice = f"name a file, or one of {', '.join(sorted(p.stem for p in PATHS.glob('*')))}"
    raise InputError(name, "no such camera path", advice)

# SPDX-License-Identifier: Apache-2.0
"""Where experiments find their data, and how much they do."""

from pathlib import Path
from typing import NamedTuple

from tiles.errors import InputError
from tiles.lanes import Lane
from tiles.samples import PATHS
from tiles.store import Store
from tiles.surface import Surface
from viewer.camera_path import read_path
from viewer.demo import ingest_samples
from viewer.poses import Flight


class Setting(NamedTuple):
    """What a run of the experiments was asked for."""

    out: Path
    quick: bool = False
    store: Path | None = None
    """of the sample world; None: it is made in `out`"""

    @property
    def data(self) -> Path:
        """Folder of generated data, which is used again."""
        folder = self.out / "data"
        folder.mkdir(parents=True, exist_ok=True)
        return folder

    def pick(self, full: float, quick: float) -> float:
        """Return how much to do."""
        return quick if self.quick else full

    def world(self) -> Path:
        """Return the store of the sample world, made where there is none.

        Raises
        ------
        InputError
        """
        if self.store is None:
            made = self.data / "world.geopage"
            ingest_samples(made)
            return made
        with Store(self.store) as store:
            if not len(store.index(Lane.TERRAIN)) or not len(store.index(Lane.OBJECTS)):
                advice = "name the store that `geopage demo` makes, or none"
                raise InputError(self.store, "holds no terrain or no buildings", advice)
        return self.store


def sample_flight(store: Path, name: str, size_px: tuple[int, int]) -> Flight:
    """Return one of the sample camera paths over a store."""
    with Store(store) as reader:
        return Flight(read_path(PATHS / f"{name}.json"), Surface(reader), size_px)

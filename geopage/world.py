# SPDX-License-Identifier: Apache-2.0
"""A store for scripts and notebooks."""

from os import PathLike
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from geopage.find import find_ids
from tiles.frames import Floats
from tiles.places import Places
from tiles.store import Store

Json = dict[str, Any]


class World:
    """Terrain and objects of one store. Thread: the one that made it.

    Parameters
    ----------
    path : of a .geopage file

    Examples
    --------
    >>> with geopage.open("world.geopage") as world:  # doctest: +SKIP
    ...     world.sample(8.54, 47.37)["height_m"]
    ...     world.find("name~museum")[0]["attributes"]
    """

    def __init__(self, path: str | PathLike[str]) -> None:
        self.store = Store(Path(path))
        self._places: Places | None = None

    @property
    def places(self) -> Places:
        """What the store knows about places; its indexes are read at the first use."""
        if self._places is None:
            self._places = Places(self.store)
        return self._places

    def sample(self, lon_deg: float | Floats, lat_deg: float | Floats) -> Any:
        """Return height, error, level, source, linked cells and objects of places.

        Parameters
        ----------
        lon_deg, lat_deg : a place, or (n,) places

        Returns
        -------
        A dict for a place, a list of dicts for an array: lat_deg, lon_deg, height_m above
        the ellipsoid, error_m, level, source, feathered, linked_cells, objects
        """
        lon, lat = _places(lon_deg, lat_deg)
        found = self.places.at(lon, lat)
        return found[0] if np.ndim(lon_deg) == np.ndim(lat_deg) == 0 else found

    def objects_at(self, lon_deg: float | Floats, lat_deg: float | Floats) -> Any:
        """Return the objects that cover a place (a list), or places (a list of lists).

        An object is a dict: id, source, lon_deg, lat_deg, base_m, height_m, dimension_m
        and its source's attributes.
        """
        lon, lat = _places(lon_deg, lat_deg)
        found = self.places.objects_at(lon, lat)
        return found[0] if np.ndim(lon_deg) == np.ndim(lat_deg) == 0 else found

    def find(self, condition: str, limit: int | None = None) -> list[Json]:
        """Return the objects that fulfil a condition, as `geopage find` takes it.

        Raises
        ------
        InputError
            When the condition can't be read, or no object has its field.
        """
        return self.store.objects(find_ids(self.store, condition)[:limit])

    def close(self) -> None:
        """Close the store."""
        self.store.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()


def _places(lon_deg: float | Floats, lat_deg: float | Floats) -> tuple[Floats, Floats]:
    """Return longitudes and latitudes as arrays of one length.

    Raises
    ------
    ValueError
    """
    lon, lat = np.broadcast_arrays(
        np.atleast_1d(np.asarray(lon_deg, np.float64)), np.asarray(lat_deg, np.float64)
    )
    if not (np.isfinite(lon).all() and (np.abs(lat) <= 90).all()):
        raise ValueError(
            "a place: expected finite degrees, longitude, then latitude -90..90"
        )
    return lon.ravel(), lat.ravel()

# SPDX-License-Identifier: Apache-2.0
"""A store for scripts and notebooks."""

from importlib.metadata import entry_points
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from geopage.find import find_ids
from tiles.closing import Closing
from tiles.errors import InputError
from tiles.frames import Floats
from tiles.places import Places
from tiles.store import Store

Json = dict[str, Any]
VIEWS = "geopage.views"
"""Packages register here what draws a store, so this one imports none of them."""


class World(Closing):
    """Terrain and objects of one store. Thread: the one that made it.

    Parameters
    ----------
    path : of a .geopage file

    Examples
    --------
    >>> with geopage.open("world.geopage") as world:  # doctest: +SKIP
    ...     world.sample(8.54, 47.37)["height_m"]
    ...     world.find("name~museum")[0]["attributes"]
    ...     world.render(8.54, 47.37, 500, heading_deg=0, pitch_deg=-30).save("city.png")
    ...     world.fly("path.json").frames.p99_ms
    """

    def __init__(self, path: str | PathLike[str]) -> None:
        self.store = Store(Path(path))
        self._places: Places | None = None
        self._studio: Any = None

    def __repr__(self) -> str:
        return f"<geopage world, {self.store.path}>"

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

    def render(
        self,
        lon_deg: float,
        lat_deg: float,
        height_m: float,
        heading_deg: float = 0.0,
        pitch_deg: float = -30.0,
        **options: Any,
    ) -> Any:
        """Draw what an eye sees; in a notebook the picture shows itself.

        Parameters
        ----------
        lon_deg, lat_deg, height_m : of the eye, above the ground
        heading_deg, pitch_deg : clockwise from north; 0 level, -90 straight down
        options : size_px=(1280, 720), threshold_px=2.0, fov_deg=60.0, style=None, and
            above_ground=True (False: the height is above the ellipsoid)

        Returns
        -------
        An image: `numpy.asarray(image)` is (h, w, 3) uint8, `image.save(path)` writes a
        PNG, `image.about` is a dict of figures
        """
        lon, lat = _places(lon_deg, lat_deg)
        angles = np.radians([lon[0], lat[0], heading_deg, pitch_deg]).tolist()
        return self.studio.render((*angles[:2], height_m, *angles[2:]), **options)

    def fly(
        self,
        path: str | PathLike[str],
        out: str | PathLike[str] | None = None,
        **options: Any,
    ) -> Any:
        """Fly a camera path and measure; in a notebook the report shows itself.

        Parameters
        ----------
        path : of a camera path
        out : folder for report, table and page; None: they are not kept
        options : size_px=(1280, 720), threshold_px=2.0, budget_mib=512, style=None,
            fps=0 (more: hold that rate by coarser detail), and settled_poses=0 (more:
            stop at so many until each is settled)

        Returns
        -------
        A report: a dict as in report.json, its keys also as attributes
        (`report.frames.p99_ms`); `report.chart()` is the flight over time
        """
        return self.studio.fly(path, out, **options)

    @property
    def studio(self) -> Any:
        """What draws this store; it opens OpenGL at the first use.

        Raises
        ------
        InputError
            When no installed package can draw.
        """
        if self._studio is None:
            for entry in entry_points(group=VIEWS, name="studio"):
                self._studio = entry.load()(self.store.path)
                return self._studio
            advice = "install geopage again, with pip install geopage"
            raise InputError(self.store.path, "nothing is installed that draws", advice)
        return self._studio

    def close(self) -> None:
        """Close the store, and what drew it."""
        if self._studio is not None:
            self._studio.close()
        self.store.close()


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

# SPDX-License-Identifier: Apache-2.0
"""Coordinates of a file to longitude and latitude; a wrong CRS is found and named."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import shapely

from ingest.horizontal import GOOD_M, doubt
from ingest.raw_features import Geometries
from tiles.errors import InputError
from tiles.frames import Floats

_WGS84 = pyproj.CRS.from_epsg(4326)
_MAX_MERCATOR_M = 20_037_509.0
_MARGIN_DEG = 1.0
"""How far from where a CRS is meant for a city may lie without a word."""
_SWAP = "swap them (in QGIS: Swap X and Y coordinates) or name the right CRS with --crs"


def outside_world(geometry: Geometries) -> "np.ndarray[Any, np.dtype[np.bool_]]":
    """Tell which geometries leave longitude +-360, latitude +-90 (False where empty)."""
    west, south, east, north = shapely.bounds(geometry).T
    return np.asarray((west < -360) | (east > 360) | (south < -90) | (north > 90))


@dataclass(frozen=True, slots=True)
class ToDegrees:
    """How the coordinates of a file become longitude and latitude."""

    path: Path
    system: pyproj.CRS
    """2-D, horizontal"""

    @classmethod
    def of(cls, path: Path, crs: str | None) -> "ToDegrees":
        """Make one for a CRS as a file or a user names it; heights are left aside."""
        if crs is None:
            beside = ", or add its .prj file" if path.suffix.lower() == ".shp" else ""
            advice = f"name it with --crs, such as --crs EPSG:4326{beside}"
            raise InputError(path, "says no CRS", advice)
        try:
            system = pyproj.CRS.from_user_input(crs)
            if system.is_compound:
                system = system.sub_crs_list[0]
            system = system.to_2d()
        except pyproj.exceptions.CRSError as error:
            name = " ".join(crs.split())[:60]
            raise InputError(
                path, f"unknown CRS {name!r}", "use a code such as --crs EPSG:4326"
            ) from error
        if not (system.is_geographic or system.is_projected):
            reason = f"CRS {system.name!r} is no map of the earth's surface"
            raise InputError(path, reason, "name the right one with --crs")
        return cls(path, system)

    def turn(self, geometry: Geometries) -> Geometries:
        """Turn to EPSG:4326, always longitude first."""
        if self.system.equals(_WGS84, ignore_axis_order=True):
            return geometry
        turn = pyproj.Transformer.from_crs(self.system, _WGS84, always_xy=True)

        def turned(xy: Floats) -> Floats:
            return np.column_stack(turn.transform(xy[:, 0], xy[:, 1]))

        return np.asarray(shapely.transform(geometry, turned), object)

    def check(
        self, geometry: Geometries, turned: Geometries, bbox: Sequence[Any] = ()
    ) -> list[str]:
        """Refuse features most of which can't be where they say; return doubts.

        Parameters
        ----------
        geometry : (n,) as in the file
        turned : (n,) in degrees
        bbox : west, south, east, north of `geometry` as the file says, if it says it
        """
        box = shapely.bounds(geometry)
        known = np.isfinite(box).all(axis=1)
        box, degrees = box[known], shapely.bounds(turned)[known]
        if not len(box):
            return []
        self._require_right_units(box)
        lost = outside_world(turned)[known] | ~np.isfinite(degrees).all(axis=1)
        if 2 * np.count_nonzero(lost) > len(box):
            raise self._refused(box[lost])
        there = degrees[~lost]
        (west, south), (east, north) = there[:, :2].min(axis=0), there[:, 2:].max(axis=0)
        found = doubt(self.path, self.system, (west, south, east, north), GOOD_M)
        doubts = [*self._doubts(box, degrees), *self._bbox_doubts(box, bbox)]
        return [*doubts, found] if found else doubts

    def _require_right_units(self, box: Floats) -> None:
        if self.system.is_projected and (np.abs(box) <= (360, 90, 360, 90)).all():
            size_m = np.ptp(box[:, :2], axis=0).max() * self._unit_m()
            if size_m < 360:
                x, y = box[0, :2]
                raise InputError(
                    self.path,
                    f"coordinates such as {x:.6g}, {y:.6g} look like degrees, but its CRS"
                    f" is {self.system.to_string()[:60]}",
                    "name the right one with --crs, such as --crs EPSG:4326",
                )

    def _unit_m(self) -> float:
        return float(self.system.axis_info[0].unit_conversion_factor or 1.0)

    def _refused(self, box: Floats) -> InputError:
        """Return the refusal, with the likely reason where there is one."""
        x, y = box[0, :2]
        name = self.system.to_string()[:60]
        such = f"such as {x:.6g}, {y:.6g}"
        if self.system.is_geographic:
            if (np.abs(box[:, 1::2]) <= 360).all() and (np.abs(box[:, ::2]) <= 90).all():
                reason = f"latitudes beyond 90 ({such}): longitude and latitude are swapped"
                return InputError(self.path, reason, _SWAP)
            if (np.abs(box) <= _MAX_MERCATOR_M).all():
                turn = pyproj.Transformer.from_crs(3857, 4326, always_xy=True)
                lon, lat = turn.transform(x, y)
                return InputError(
                    self.path,
                    f"coordinates outside longitude +-180, latitude +-90 ({such}): no"
                    f" degrees, as its CRS {name} says",
                    "name the right one with --crs (EPSG:3857 would put that at longitude"
                    f" {lon:.4g}, latitude {lat:.4g})",
                )
        elif self._swapped_fits(box):
            return InputError(self.path, f"x and y ({such}) are swapped for {name}", _SWAP)
        return InputError(
            self.path,
            f"coordinates outside longitude +-180, latitude +-90 ({such})",
            f"name the right CRS with --crs (read as {name})",
        )

    def _doubts(self, box: Floats, degrees: Floats) -> list[str]:
        """Compare with the area that the CRS is meant for."""
        away = ~self._in_area((degrees[:, :2] + degrees[:, 2:]) / 2)
        area = self.system.area_of_use
        if area is None or 2 * np.count_nonzero(away) <= len(box):
            return []
        lon, lat = degrees[away][0, :2]
        text = (
            f"{self.path.name}: lies at longitude {lon:.4g}, latitude {lat:.4g}, outside"
            f" the area of {self.system.to_string()[:50]} ({area.name.split(';')[0][:60]})"
        )
        if self._swapped_fits(box):
            text += "; x and y seem to be swapped"
        return [text]

    def _bbox_doubts(self, box: Floats, bbox: Sequence[Any]) -> list[str]:
        """Compare with the box that the file says."""
        if not bbox or not all(isinstance(one, int | float) for one in bbox):
            return []
        west, south, east, north = bbox
        if west > east:  # astride longitude 180
            return []
        middle = (box[:, :2] + box[:, 2:]) / 2
        low, high = np.array((west, south), float), np.array((east, north), float)
        if np.mean(((middle >= low) & (middle <= high)).all(axis=1)) >= 0.5:
            return []
        swapped = ((middle[:, ::-1] >= low) & (middle[:, ::-1] <= high)).all(axis=1)
        text = f"{self.path.name}: most features lie outside the bbox that it states"
        return [text + "; x and y seem to be swapped" if swapped.mean() > 0.5 else text]

    def _swapped_fits(self, box: Floats) -> bool:
        if self.system.area_of_use is None:
            return False
        turn = pyproj.Transformer.from_crs(self.system, _WGS84, always_xy=True)
        lon, lat = turn.transform(box[:, 1], box[:, 0])
        fits = self._in_area(np.column_stack((lon, lat)))
        return bool(2 * np.count_nonzero(fits) > len(box))

    def _in_area(self, lon_lat: Floats) -> "np.ndarray[Any, np.dtype[np.bool_]]":
        area = self.system.area_of_use
        if area is None:
            return np.ones(len(lon_lat), bool)
        lon, lat = lon_lat.T
        width = (area.east - area.west) % 360 or 360.0
        with np.errstate(invalid="ignore"):
            from_west = (lon - area.west + _MARGIN_DEG) % 360
            wide = width + 2 * _MARGIN_DEG >= 360
            level = np.abs(lat - (area.south + area.north) / 2)
            high = level <= (area.north - area.south) / 2 + _MARGIN_DEG
            return np.asarray(high & (wide | (from_west <= width + 2 * _MARGIN_DEG)))

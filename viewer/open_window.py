# SPDX-License-Identifier: Apache-2.0
"""From what `geopage view` is told to a running window."""

import argparse
import math
import os
import sys
from pathlib import Path

import numpy as np

from geopage.settings import PagerSettings
from tiles import geodesy
from tiles.errors import InputError, is_interrupt
from tiles.frames import Ecef
from tiles.lanes import Lane
from viewer.app import App
from viewer.app_commands import keys_text
from viewer.app_hud import Hud
from viewer.app_state import AppState
from viewer.bookmarks import read_bookmarks
from viewer.camera import Pose
from viewer.camera_path import read_path
from viewer.session import Picture, Session
from viewer.window import Window

START_M = 1.2e7
DEFAULT_LOOK = 0.0, -30.0
NO_HUD = "geopage: without imgui-bundle there are no panels: pip install 'geopage[gui]'"


def open_window(store: Path, settings: PagerSettings, given: argparse.Namespace) -> None:
    """Show a store in a window until it is closed.

    Raises
    ------
    InputError
    """
    path = read_path(given.path) if given.path else None
    bookmarks = read_bookmarks(store)
    make_folder(given.out)
    if not store.exists():
        raise InputError(store, "there is no such file", "name a store, or make one first")
    with Window(f"geopage - {store.name}", given.size) as window:
        picture = Picture(window.size_px)
        with Session(store, settings, picture, given.style, window.gl) as session:
            state = AppState(settings.threshold_px, settings.object_threshold_px)
            state.policy, state.out, state.bookmarks = settings.policy, given.out, bookmarks
            app = App(session, window, start_of(session, given), state, hud_of(window))
            if path is not None:
                app.do.replay(path)
            if given.fps:
                app.do.set_fps(given.fps)
            state.style = session.styling.legend["field"] if session.styling else ""
            if given.fullscreen:
                window.toggle_fullscreen()
            try:
                app.run()
            except BaseException as error:
                if not is_interrupt(error):
                    raise  # Ctrl-C is as good as Q
            finally:
                for line in app.close():
                    print(f"geopage: {line}", file=sys.stderr)  # noqa: T201


def make_folder(folder: Path) -> None:
    """Make sure that pictures and tours can be saved in a folder.

    Raises
    ------
    InputError
    """
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        reason = str(error.strerror or error)
        raise InputError(folder, reason, "give --out a folder to write in") from error
    if not os.access(folder, os.W_OK):
        raise InputError(folder, "can't be written", "give --out a folder to write in")


def hud_of(window: Window) -> Hud | None:
    """Return the panels, None where their library is not installed."""
    try:
        from viewer.hud import ImguiHud  # noqa: PLC0415  an extra
    except ImportError:
        print(NO_HUD, file=sys.stderr)  # noqa: T201  (a command's own lines)
        print(keys_text())  # noqa: T201
        return None
    return ImguiHud(window)


def start_of(session: Session, given: argparse.Namespace) -> Pose:
    """Return where to begin: as told, or above the globe and its data."""
    if given.at is None:
        lon, lat = middle_of(session)
        heading, pitch = given.look or (0.0, -90.0)
        return Pose(lon, lat, START_M, math.radians(heading), math.radians(pitch))
    lat, lon, height_m = given.at
    lon_rad, lat_rad = math.radians(lon), math.radians(lat)
    if given.height_reference == "ground":
        height_m += session.surface.height_at(lon_rad, lat_rad)
    heading, pitch = given.look or DEFAULT_LOOK
    return Pose(lon_rad, lat_rad, height_m, math.radians(heading), math.radians(pitch))


def middle_of(session: Session) -> tuple[float, float]:
    """Return longitude and latitude of the largest tile of objects, or finest ground."""
    forests = session.pager.forests
    if len(objects := forests[Lane.OBJECTS].records):
        leaves = np.where(objects["children"] == 0, objects["tile_bytes"], 0)
        centre = objects["centre"][int(np.argmax(leaves))]
    else:
        records = forests[Lane.TERRAIN].records
        leaves = np.flatnonzero(records["children"] == 0)
        centre = records["centre"][leaves[int(np.argmin(records["texel_m"][leaves]))]]
    lon, lat, _ = geodesy.to_geodetic(Ecef(centre))
    return float(lon), float(lat)

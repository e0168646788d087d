# SPDX-License-Identifier: Apache-2.0
"""How many triangles a city takes with proxies and without, and how the pictures differ.

`GEOPAGE_STORE=world.geopage pytest -s` prints a line per distance for the buildings of a
store: triangles of objects, and the PSNR against the picture of all buildings. The
terrain is the same in all pictures.
"""

import math
import os
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import moderngl
import numpy as np
import pytest
from numpy.typing import NDArray

from geopage.draw_list import DrawList
from geopage.selection import ideal
from geopage.settings import PagerSettings
from geopage.view import ViewState
from tiles.frames import Ecef
from tiles.geodesy import to_geodetic
from tiles.lanes import Lane
from viewer.accuracy import without_objects
from viewer.camera import Pose, view_state
from viewer.session import Picture, Session

SIZE = (1280, 720)
DISTANCES_KM = (3, 15, 160)
THRESHOLDS_PX = (1.0, 2.0)
PITCH = math.radians(40)
TINY_PX = 1e-9
Rgb = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Drawn:
    """Objects of one picture."""

    triangles: int
    rgb: Rgb


def psnr_db(one: Rgb, other: Rgb) -> float:
    """Return the peak signal-to-noise ratio of two pictures."""
    square = np.mean((one.astype(float) - other) ** 2)
    return 10 * math.log10(255**2 / max(float(square), 1e-9))


def city_view(session: Session, distance_m: float) -> ViewState:
    """Look down at the middle of all buildings, aslant, from a distance."""
    records = session.pager.forests[Lane.OBJECTS].records
    leaves = records[records["children"] == 0]
    lon, lat, _ = to_geodetic(Ecef(np.median(leaves["centre"], axis=0)))
    south = distance_m * math.cos(PITCH) / 6.37e6
    height_m = distance_m * math.sin(PITCH)
    return view_state(Pose(float(lon), float(lat) - south, height_m, 0.0, -PITCH), SIZE)


def draw(session: Session, wanted: DrawList) -> Drawn:
    """Draw a list and count its objects' triangles."""
    bare = without_objects(wanted)
    session.hold(wanted)
    below = session.renderer.draw(bare, wanted.view).triangles
    above = session.renderer.draw(wanted, wanted.view).triangles
    return Drawn(above - below, session.renderer.read_rgb().copy())


def of_objects(
    session: Session, view: ViewState, tau: float, objects_px: float
) -> DrawList:
    """Return a list with terrain at 2 px and objects at other thresholds."""
    forests = session.pager.forests
    ground, above = ideal(forests, view, 2.0, 2.0), ideal(forests, view, tau, objects_px)
    proxies = above.proxies if tau > TINY_PX else np.zeros_like(above.proxies)
    keep = above.own | (proxies > 0)
    return replace(
        ground,
        objects=above.objects[keep],
        own=above.own[keep],
        proxies=proxies[keep],
        object_threshold_px=objects_px,
    )


@pytest.mark.slow
@pytest.mark.skipif("GEOPAGE_STORE" not in os.environ, reason="names no store")
def test_a_store_with_proxies_and_without(gl_context: moderngl.Context) -> None:
    del gl_context
    settings = PagerSettings(budget_bytes=2**31)
    path = Path(os.environ["GEOPAGE_STORE"])
    with Session(path, settings, Picture(SIZE, 2)) as session:
        for distance_km in DISTANCES_KM:
            view = city_view(session, distance_km * 1e3)
            full = draw(session, of_objects(session, view, TINY_PX, TINY_PX))
            for tau in THRESHOLDS_PX:
                near = draw(session, of_objects(session, view, tau, tau))
                bare = draw(session, of_objects(session, view, TINY_PX, tau))
                assert near.triangles <= max(1.1 * full.triangles, 10_000)
                sys.stdout.write(
                    f"\n{distance_km} km, {tau:g} px: all {full.triangles};"
                    f" without proxies {bare.triangles}"
                    f" ({psnr_db(bare.rgb, full.rgb):.1f} dB), with {near.triangles}"
                    f" ({psnr_db(near.rgb, full.rgb):.1f} dB),"
                    f" ratio {near.triangles / max(bare.triangles, 1):.2f}"
                )

# SPDX-License-Identifier: Apache-2.0
"""A picture over a pole is drawn as it is, not as a star."""

import math
from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from geopage.settings import PagerSettings
from ingest.drape import COARSE_SHARE
from ingest.terrain import RasterOptions, ingest_rasters
from tests.ingest.rasters import ELLIPSOID, north_up, write
from tiles.geodesy import to_geodetic
from viewer.camera import Pose, view_state
from viewer.look import PLAIN
from viewer.session import Picture, Session

pytestmark = pytest.mark.usefixtures("gl_context")
STEP_DEG, DARK, BRIGHT, WAVE_RAD = 0.25, 60.0, 160.0, 0.08
"""Of the picture; and the length of its waves, which are the same in all directions"""
RINGS_RAD = (0.01, 0.03), (0.03, 0.06), (0.06, 0.12), (0.12, 0.2)
Floats = NDArray[np.float64]


def pattern(lon: Floats, lat: Floats) -> Floats:
    """Return waves both ways over a pole, on a map true to distances from it, 0 to 1."""
    away = math.pi / 2 - np.abs(lat)
    x, y = away * np.cos(lon), away * np.sin(lon)
    turn = 2 * math.pi / WAVE_RAD
    return np.asarray(0.5 + 0.5 * np.sin(turn * x) * np.sin(turn * (y + 0.3 * x)))


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Session]:
    folder = tmp_path_factory.mktemp("polar")
    # All white, so that nothing but the picture makes a difference.
    posts, where = np.full((90, 180), 3000.0), north_up(-180, 90, 2)
    flat = write(folder / "flat.tif", posts, where, "EPSG:4326")
    lon, lat = np.meshgrid(
        np.radians(-180 + STEP_DEG * (np.arange(1440) + 0.5)),
        np.radians(90 - STEP_DEG * (np.arange(720) + 0.5)),
    )
    grey = np.rint(DARK + (BRIGHT - DARK) * pattern(lon, lat)).astype(np.uint8)
    where = north_up(-180, 90, STEP_DEG)
    picture = write(folder / "waves.tif", np.stack([grey] * 3), where, "EPSG:4326")
    sources = [(flat, ELLIPSOID), (picture, RasterOptions("imagery"))]
    ingest_rasters(folder / "polar.geopage", sources, workers=1)
    settings = PagerSettings(2.0)
    with Session(folder / "polar.geopage", settings, Picture((480, 360))) as opened:
        opened.renderer.look = PLAIN
        yield opened


@pytest.mark.parametrize("height_m", [3e6, 1e6])
@pytest.mark.parametrize("pole", [1, -1])
def test_rings_around_a_pole_show_the_picture(
    session: Session, pole: int, height_m: float
) -> None:
    pose = Pose(0.4, pole * (math.pi / 2 - 1e-3), height_m, 0.0, -math.pi / 2)
    session.settle(view_state(pose, (480, 360)))
    seen = session.renderer.read_rgb()[..., 0].astype(float)
    points = session.renderer.read_positions()
    lon, lat, _ = to_geodetic(points)
    away = math.pi / 2 - np.abs(lat)
    for low, high in RINGS_RAD:
        ring = np.isfinite(away) & (away > low) & (away < high)
        if ring.sum() < 200:
            continue
        wanted = pattern(lon[ring], lat[ring])
        alike = np.corrcoef(wanted, seen[ring])[0, 1]
        contrast = seen[ring].std() / (wanted.std() * (BRIGHT - DARK) * COARSE_SHARE)
        assert alike > 0.95
        assert 0.85 < contrast < 1.15

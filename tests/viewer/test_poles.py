# SPDX-License-Identifier: Apache-2.0
"""Flights over the poles and along the antimeridian are smooth, whole and cheap.

The ground is noise in space, alike everywhere on the sphere, so that a flight costs
more in one place than in another only because of how the globe is cut into cells.
"""

import math
import sys
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pytest

from geopage.settings import MIB, PagerSettings
from ingest.terrain import ingest_rasters
from tests.viewer.rough_world import ELLIPSOID, write_earth
from tiles import cells
from tiles.lanes import Lane
from tiles.mesh import SKIRT, UV_ONE
from tiles.samples import SAMPLES
from viewer.camera import view_state
from viewer.camera_path import read_path
from viewer.holes import hole_pixels
from viewer.poses import Flight
from viewer.session import Picture, Session

pytestmark = pytest.mark.usefixtures("gl_context")
POSES = 15
SIZE = Picture((320, 180))
HERE, THERE = "parallel_45", ("north_pole", "south_pole", "antimeridian")
MOST = {2.0: 1.5, 1.0: 1.65}
"""Triangles and tiles of a flight by those of the same flight at 45 degrees, for thresholds
in px. At 1 px nearly all that shows is leaves, and a long one at a pole is drawn for its
near end and its far end alike."""


class Cost(NamedTuple):
    """What the settled frames of a flight come to."""

    triangles: float
    tiles: float
    most_tiles: int
    holes: int


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Session]:
    folder = tmp_path_factory.mktemp("noise")
    earth = write_earth(folder / "earth.tif", 0.25, range(1, 8), 600.0)
    store = folder / "noise.geopage"
    ingest_rasters(store, [(earth, ELLIPSOID)], workers=1)
    with Session(store, PagerSettings(1.0, budget_bytes=256 * MIB), SIZE) as opened:
        yield opened


@pytest.fixture(scope="module")
def costs(session: Session) -> dict[tuple[float, str], Cost]:
    found = {}
    for threshold_px in MOST:
        session.pager.set_limits(threshold_px)
        for name in (HERE, *THERE):
            found[threshold_px, name] = flown(session, name)
    return found


def flown(session: Session, name: str) -> Cost:
    """Stop at some poses of a sample flight until each is settled."""
    lowest_m = float(session.pager.forests[Lane.TERRAIN].records["min_height_m"].min())
    flight = Flight(
        read_path(SAMPLES / "paths" / f"{name}.json"), session.surface, SIZE.size_px
    )
    triangles, tiles, holes = [], [], 0
    for t_s in np.linspace(0.0, flight.path.duration_s, POSES).tolist():
        view = flight.view(t_s)
        _, stats = session.settle(view)
        triangles.append(stats.triangles)
        tiles.append(stats.tiles)
        holes += hole_pixels(session.renderer, view, lowest_m)
    return Cost(float(np.mean(triangles)), float(np.mean(tiles)), max(tiles), holes)


@pytest.mark.parametrize("threshold_px", MOST)
@pytest.mark.parametrize("name", THERE)
def test_a_flight_costs_little_more_than_at_45_degrees(
    costs: dict[tuple[float, str], Cost], name: str, threshold_px: float
) -> None:
    there, here = costs[threshold_px, name], costs[threshold_px, HERE]
    ratios = there.triangles / here.triangles, there.tiles / here.tiles
    sys.stdout.write(f"\n{name}: {ratios[0]:.2f} x triangles, {ratios[1]:.2f} x tiles\n")
    assert here.triangles > 400
    assert ratios[0] <= MOST[threshold_px]
    assert ratios[1] <= MOST[threshold_px]


@pytest.mark.parametrize("edge", [0, UV_ONE])
def test_tiles_around_a_pole_meet_on_the_axis(session: Session, edge: int) -> None:
    """Their corners there are between columns of posts."""
    pole_rad, found = math.copysign(math.pi / 2, edge - 1), 0
    for row, record in enumerate(session.pager.forests[Lane.TERRAIN].records):
        if pole_rad in cells.bounds_rad(record["cell"])[1::2]:
            mesh = session.tile(Lane.TERRAIN, row).mesh
            top = mesh.vertices["flags"] & SKIRT == 0
            tips = mesh.centre + mesh.local[top & (mesh.vertices["detail"][:, 1] == edge)]
            assert len(tips) >= 2
            assert np.abs(tips[:, :2]).max() < 1e-6
            assert np.ptp(tips[:, 2]) < 1e-6
            found += 1
    assert found > 16


@pytest.mark.parametrize("name", [HERE, *THERE])
def test_a_flight_has_no_hole(costs: dict[tuple[float, str], Cost], name: str) -> None:
    assert all(costs[threshold_px, name].holes == 0 for threshold_px in MOST)


@pytest.mark.parametrize("name", [HERE, *THERE])
def test_a_flight_turns_evenly(name: str) -> None:
    path = read_path(SAMPLES / "paths" / f"{name}.json")
    times = np.linspace(0.0, path.duration_s, round(120 * path.duration_s) + 1)
    views = [view_state(path.pose_at(t_s), SIZE.size_px) for t_s in times.tolist()]
    turns = np.array([view.rotation for view in views])
    # The angle of a turn, from the trace of the one matrix times the other's transpose.
    cosine = ((turns[1:] * turns[:-1]).sum((1, 2)) - 1) / 2
    deg_s = np.degrees(np.arccos(np.clip(cosine, -1, 1))) * 120
    assert deg_s.mean() == pytest.approx(1.5, rel=0.05)
    assert deg_s.max() < 3.0
    steps_m = np.linalg.norm(np.diff([view.eye for view in views], axis=0), axis=1)
    assert steps_m.max() < 2.0 * steps_m.mean()

# SPDX-License-Identifier: Apache-2.0
"""What flights over the poles and along the antimeridian cost, beside one at 45 degrees."""

from collections.abc import Sequence

import numpy as np

from geopage.progress import bar
from tiles.lanes import Lane
from tiles.samples import SAMPLES
from viewer.camera_path import read_path
from viewer.poses import Flight
from viewer.session import Session
from viewer.tally import Json

HERE, THERE = "parallel_45", ("north_pole", "south_pole", "antimeridian")
POSES = 15


def globe_flights(session: Session, thresholds_px: Sequence[float]) -> list[Json]:
    """Settle the poses of four flights, alike but for where they are.

    Returns
    -------
    For each threshold and flight: `flight`, `threshold_px`, means a frame of `triangles`
    and `tiles`, `triangles_ratio` and `tiles_ratio` to the flight at 45 degrees, and
    `leaf_share`, of the pixels of ground that show a tile as fine as the data are
    """
    found: list[Json] = []
    names, total = (HERE, *THERE), len(thresholds_px) * (1 + len(THERE))
    with bar("flying over the poles", total, "flights") as show:
        for threshold_px in thresholds_px:
            session.pager.set_limits(threshold_px, session.settings.object_threshold_px)
            here = _flown(session, HERE)
            for name in names:
                there = here if name == HERE else _flown(session, name)
                ratios = {
                    f"{key}_ratio": there[key] / here[key] for key in ("triangles", "tiles")
                }
                about = {"flight": name, "threshold_px": threshold_px}
                found.append({**about, **there, **ratios})
                show(len(found))
    return found


def _flown(session: Session, name: str) -> dict[str, float]:
    path = read_path(SAMPLES / "paths" / f"{name}.json")
    flight = Flight(path, session.surface, session.picture.size_px)
    children = session.pager.forests[Lane.TERRAIN].records["children"]
    triangles, tiles, leaves = list[float](), list[float](), list[float]()
    for t_s in np.linspace(0.0, path.duration_s, POSES).tolist():
        drawn, stats = session.settle(flight.view(t_s))
        triangles.append(stats.triangles)
        tiles.append(stats.tiles)
        entry = session.renderer.read_ids() - 1
        seen = drawn.terrain[entry[(entry >= 0) & (entry < len(drawn.terrain))]]
        leaves.append(float((children[seen] == 0).mean()) if len(seen) else 0.0)
    means = {"triangles": triangles, "tiles": tiles, "leaf_share": leaves}
    return {key: float(np.mean(values)) for key, values in means.items()}

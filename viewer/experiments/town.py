# SPDX-License-Identifier: Apache-2.0
"""A made-up downtown of 471 buildings, side by side as often as is asked for.

VGIS (Davis et al., IEEE Visualization 1999, section 5) had downtown Atlanta, which is
not to be had. Ours has as many buildings and one tower of 312 m, as Atlanta has, and
stands on the 10 m terrain of the sample world: San Francisco's hills.
"""

import json
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import numpy as np

from tiles.errors import InputError
from tiles.frames import Floats
from tiles.store import Store

SEED = 471
COUNT = 471
LAT_DEG, LON_DEG = 37.7615, -122.4485
TOWER_M = 312.0
LOTS, LOT_M = 22, 62.0
SIDE_M = LOTS * LOT_M
OPEN_M = 90.0
"""No building stands closer to the middle, where the fly-in ends"""
DEGREE_M = 111_195.0
NAME = "town"


def outline(random: np.random.Generator) -> Floats:
    """Return a building's corners around its middle, (k, 2) m: round, or a block."""
    if random.uniform() < 0.3:
        turn = np.linspace(0, 2 * np.pi, int(random.integers(8, 25)), endpoint=False)
        ring = np.stack((np.cos(turn), np.sin(turn)), -1)
        return np.asarray(ring * random.uniform(10, 22))
    x, y = random.uniform(9, 24, 2)
    if random.uniform() < 0.5:
        return np.array(((-x, -y), (x, -y), (x, y), (-x, y)))
    notch = ((-x, -y), (x, -y), (x, 0), (0, 0), (0, y), (-x, y))
    return np.array(notch, np.float64)


def downtown() -> list[tuple[Floats, float]]:
    """Return outlines (k, 2) m around the middle of the town, and heights."""
    random = np.random.default_rng(SEED)
    lots = np.stack(np.meshgrid(*[np.arange(LOTS)] * 2), -1).reshape(-1, 2)
    middle = (lots + 0.5 - LOTS / 2) * LOT_M
    far_m = np.linalg.norm(middle, axis=1)
    middle, far_m = middle[far_m > OPEN_M], far_m[far_m > OPEN_M]
    order = np.argsort(far_m, kind="stable")[:COUNT]
    high = np.sort(random.lognormal(np.log(25), 0.7, COUNT).clip(6, 0.8 * TOWER_M))[::-1]
    high[0] = TOWER_M  # the tallest stand in the middle
    return [(outline(random) + middle[k], float(high[i])) for i, k in enumerate(order)]


def write_town(path: Path, copies: int) -> int:
    """Write `copies` downtowns as GeoJSON, a square of them; return their buildings."""
    side = round(copies**0.5)
    offsets = (np.arange(side) - (side // 2)) * SIDE_M
    squeeze = np.cos(np.radians(LAT_DEG))
    features = []
    for east in offsets:
        for north in offsets:
            for corners, height_m in downtown():
                lon = LON_DEG + (corners[:, 0] + east) / (DEGREE_M * squeeze)
                lat = LAT_DEG + (corners[:, 1] + north) / DEGREE_M
                ring = np.stack((lon, lat), -1).round(7).tolist()
                shape = {"type": "Polygon", "coordinates": [[*ring, ring[0]]]}
                about = {"height": round(height_m, 1)}
                feature = {"type": "Feature", "properties": about, "geometry": shape}
                features.append(feature)
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return len(features)


def bare_copy(world: Path, store: Path) -> None:
    """Copy a store and take the buildings out."""
    for tail in ("", "-wal", "-shm"):
        Path(f"{store}{tail}").unlink(missing_ok=True)
    with Store(world) as reader, closing(sqlite3.connect(store)) as copy:
        names = [source["name"] for source in reader.sources("buildings")]
        reader.connection.backup(copy)
    for name in names:
        geopage(store, "remove", str(store), name)


def build(store: Path, copies: int) -> int:
    """Make `copies` downtowns the only buildings of a store; return how many."""
    file = store.with_name(f"{NAME}.geojson")
    count = write_town(file, copies)
    geopage(store, "ingest", "buildings", str(store), str(file), "--name", NAME)
    file.unlink()
    return count


def geopage(store: Path, *words: str) -> None:
    """Run another command of geopage; viewer and ingest know nothing of each other.

    Raises
    ------
    InputError
    """
    command = [sys.executable, "-m", "geopage", *words]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        said = (done.stderr.strip().splitlines() or ["it failed"])[-1]
        raise InputError(store, said, "give it a store that can be copied, or none")

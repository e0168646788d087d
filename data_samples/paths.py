# SPDX-License-Identifier: Apache-2.0
"""The sample flights, made from the street lines and terrain they follow."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
import shapely
from mvt import TileSet
from numpy.typing import NDArray
from pyproj import Proj
from scipy import ndimage
from streets import Streets, along, rounded

Array = NDArray[np.float64]
UTM = Proj("EPSG:32610")
HOME = (548519.1, 4179519.0)
"""Cole Street, 95 m north of its crossing with Carmel Street; the view is north."""
ORBIT = (548800.0, 4180050.0)
LOOPS = 2
METRES_PER_DEG = 111_200.0


def smooth(share: Array) -> Array:
    """0 to 1 with a soft start and a soft end."""
    x = np.clip(share, 0.0, 1.0)
    return np.asarray(x * x * x * (x * (6.0 * x - 15.0) + 10.0))


def write(
    path: Path, reference: str, times: Array, rows: dict[str, Array], interpolation: str
) -> None:
    """Write one flight: lon_deg, lat_deg, height_m, heading_deg, pitch_deg by time."""
    digits = {"lat_deg": 7, "lon_deg": 7, "height_m": 3, "heading_deg": 3, "pitch_deg": 3}
    frames: list[dict[str, float]] = []
    for k, t in enumerate(times):
        frame = {"t_s": round(float(t), 3)}
        for name, places in digits.items():
            frame[name] = round(float(rows[name][k]), places)
        frames.append(frame)
    head: dict[str, Any] = {
        "name": path.stem,
        "duration_s": frames[-1]["t_s"],
        "height_reference": reference,
        "interpolation": interpolation,
    }
    body = ",\n".join("  " + json.dumps(frame) for frame in frames)
    text = json.dumps(head, indent=1)[:-2] + f',\n "keyframes": [\n{body}\n ]\n}}\n'
    path.write_text(text)


def place(points: Array) -> dict[str, Array]:
    """Longitudes and latitudes of points in UTM metres."""
    lon, lat = UTM(points[:, 0], points[:, 1], inverse=True)
    return {"lon_deg": np.asarray(lon), "lat_deg": np.asarray(lat)}


def convergence_deg(x: float, y: float) -> float:
    """Return what to add to a heading in the grid to have one from true north."""
    lon, lat = UTM(x, y, inverse=True)
    return float(UTM.get_factors(lon, lat).meridian_convergence)


def home_on_street(streets: Streets) -> tuple[Array, float]:
    """Return the fly-in's end on the street's axis and its heading from true north."""
    line = streets.lines["Cole St"]
    home = np.asarray(line.interpolate(line.project(shapely.Point(HOME))).coords[0])
    points = streets.between("Cole St", home, streets.corner("Cole St", "Parnassus Ave"))
    ahead = points[np.hypot(*(points - home).T) > 60.0][0]
    east, north = ahead - home
    heading = np.degrees(np.arctan2(east, north)) + convergence_deg(*home)
    return home[None], float(heading % 360.0)


def fly(out: Path, streets: Streets) -> None:
    """``fly_in`` and ``fly_out``: 10,000 km to 10 m over one spot, in 30 s."""
    home, heading = home_on_street(streets)
    times = np.arange(0.0, 30.01, 0.5)
    # mostly an even pace in the logarithm, softened at both ends
    share = 0.55 * times / 30.0 + 0.45 * smooth(times / 30.0)
    height = 10.0 ** (7.0 - 6.0 * share)
    tilt = smooth((np.log10(3000.0) - np.log10(height)) / (np.log10(3000.0) - 1.0))
    spot = {k: np.repeat(v, len(times)) for k, v in place(home).items()}
    rows = spot | {
        "height_m": height,
        "heading_deg": np.full(len(times), heading),
        "pitch_deg": -90.0 + 86.0 * tilt,
    }
    write(out / "fly_in.json", "ground", times, rows, "log_height")
    write(
        out / "fly_out.json",
        "ground",
        times,
        {k: v[::-1] for k, v in rows.items()},
        "log_height",
    )


def orbit(out: Path, terrain: Path) -> None:
    """``street_orbit``: once round some blocks, 400 m off and 150 m above their ground."""
    with rasterio.open(terrain) as file:
        ground = next(file.sample([ORBIT]))[0]
    lon, lat = UTM(*ORBIT, inverse=True)
    with rasterio.open(terrain.parent / "egm96_15.tif") as file:
        geoid = float(next(file.sample([(lon, lat)]))[0]) * 0.01
    times = np.arange(0.0, 20.01, 0.5)
    angle = 2.0 * np.pi * times / 20.0
    points = np.asarray(ORBIT) + 400.0 * np.column_stack([np.sin(angle), np.cos(angle)])
    rows = place(points) | {
        "height_m": np.full(len(times), float(ground) + geoid + 150.0),
        "heading_deg": (np.degrees(angle) + 180.0 + convergence_deg(*ORBIT)) % 360.0,
        "pitch_deg": np.full(len(times), -np.degrees(np.arctan2(145.0, 400.0))),
    }
    write(out / "street_orbit.json", "ellipsoid", times, rows, "linear")


def drive(
    path: Path,
    way: Array,
    speed: float,
    seconds: float,
    height_m: float,
    turned: float = 0.0,
) -> Array:
    """Follow a way at a speed in m/s and return where the keyframes are."""
    times = np.arange(0.0, seconds + 0.01, 0.25)
    points, heading = along(way, 2.0 + speed * times)
    north = np.array([convergence_deg(*p) for p in points])
    rows = place(points) | {
        "height_m": np.full(len(times), height_m),
        "heading_deg": (heading + north + turned) % 360.0,
        "pitch_deg": np.full(len(times), -2.0),
    }
    write(path, "ground", times, rows, "linear")
    return points


def sessions(out: Path, streets: Streets) -> dict[str, float]:
    """Write the street-level sessions; return each one's distance to the footprints."""
    cole = streets.way([("Cole St", "Carmel St"), ("Cole St", "Waller St")], ["Cole St"])
    page = streets.way(
        [("Page St", "Stanyan St"), ("Page St", "Divisadero St")], ["Page St"]
    )
    zigzag = streets.way(
        [
            ("Cole St", "Carmel St"),
            ("Cole St", "Parnassus Ave"),
            ("Clayton St", "Parnassus Ave"),
            ("Clayton St", "Carl St"),
            ("Cole St", "Carl St"),
            ("Cole St", "Frederick St"),
            ("Ashbury St", "Frederick St"),
        ],
        ["Cole St", "Parnassus Ave", "Clayton St", "Carl St", "Cole St", "Frederick St"],
    )
    block = [
        ("Cole St", "Carl St"),
        ("Cole St", "Frederick St"),
        ("Clayton St", "Frederick St"),
        ("Clayton St", "Carl St"),
    ]
    sides = ["Cole St", "Frederick St", "Clayton St", "Carl St"]
    loop = streets.way([*block * LOOPS, block[0]], sides * LOOPS)
    flights = {
        "street_slow": (rounded(cole, 8.0), 1.5, 20.0, 2.0, 0.0),
        "street_fast": (rounded(page, 30.0), 30.0, 20.0, 8.0, 0.0),
        "street_turning": (rounded(zigzag, 9.0), 14.0, 40.0, 4.0, 0.0),
        "street_backward": (rounded(cole, 8.0), 6.0, 20.0, 4.0, 180.0),
        "street_revisit": (rounded(loop, 9.0), 15.0, 70.0, 5.0, 0.0),
    }
    clear = {}
    for name, (way, speed, seconds, height_m, turned) in flights.items():
        length = float(np.hypot(*np.diff(way, axis=0).T).sum())
        lasts = min(seconds, np.floor((length - 4.0) / speed * 4.0) / 4.0)
        points = drive(out / f"{name}.json", way, speed, lasts, height_m, turned)
        clear[name] = streets.clearance_m(points)
    return clear


def river(tiles: TileSet, name: str) -> Array:
    """Return a river's smoothed course, west to east, every 50 m: longitude, latitude."""
    pieces = [
        tiles.to_lon_lat(shapely.get_coordinates(f.geometry))
        for f in tiles.features("waterway_label")
        if f.properties["name"] == name
    ]
    pieces = [p if p[0, 0] < p[-1, 0] else p[::-1] for p in pieces if len(p) > 1]
    course = np.vstack(sorted(pieces, key=lambda p: float(p[:, 0].min())))
    scale = METRES_PER_DEG * np.array([np.cos(np.radians(course[:, 1].mean())), 1.0])
    at = np.r_[0.0, np.cumsum(np.hypot(*(np.diff(course, axis=0) * scale).T))]
    even = np.arange(0.0, at[-1], 50.0)
    line = np.column_stack([np.interp(even, at, course[:, k]) for k in (0, 1)])
    return np.asarray(ndimage.gaussian_filter1d(line, 7.0, axis=0, mode="nearest"))


def mountains(out: Path, tiles: TileSet) -> None:
    """``langtang``: from 200 km down into the Langtang valley and up along its river."""
    course = river(tiles, "Langtang Khola")
    times = np.arange(0.0, 25.01, 0.5)
    first = int(np.argmin(np.hypot(*(course - np.array([85.4705, 28.2035])).T)))
    # 7 km in all: still above the atmosphere, half a kilometre a second in the valley
    pace = np.clip((times - 4.0) / 9.0, 0.0, 1.0) ** 2
    run = np.r_[0.0, np.cumsum(0.5 * (pace[1:] + pace[:-1]) * np.diff(times))]
    index = first + run / run[-1] * 7000.0 / 50.0
    spot = np.column_stack(
        [np.interp(index, np.arange(len(course)), course[:, k]) for k in (0, 1)]
    )
    east, north = np.array(
        [np.interp(index + 25, np.arange(len(course)), course[:, k]) for k in (0, 1)]
    ) - np.array([np.interp(index, np.arange(len(course)), course[:, k]) for k in (0, 1)])
    heading = np.degrees(np.arctan2(east * np.cos(np.radians(spot[:, 1])), north))
    turn = smooth((times - 19.0) / 6.0)
    down = smooth(times / 17.0)
    rows = {
        "lon_deg": spot[:, 0],
        "lat_deg": spot[:, 1],
        "height_m": 10.0 ** (np.log10(2e5) + (np.log10(400.0) - np.log10(2e5)) * down),
        "heading_deg": heading + 65.0 * turn,
        "pitch_deg": -90.0 + 80.0 * smooth((times - 4.0) / 13.0) + 12.0 * turn,
    }
    write(out / "langtang.json", "ground", times, rows, "log_height")


def build_paths(out: Path, streets: Streets, nepal: TileSet) -> dict[str, float]:
    """Write every flight; returns the city's least distances to footprints, metres."""
    folder = out / "paths"
    folder.mkdir(exist_ok=True)
    fly(folder, streets)
    mountains(folder, nepal)
    orbit(folder, out / "sanfrancisco.tif")
    clear = sessions(folder, streets)
    clear["fly_in"] = streets.clearance_m(home_on_street(streets)[0])
    return clear

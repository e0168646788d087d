# SPDX-License-Identifier: Apache-2.0
"""BC1 blocks, decoded by Pillow, show the picture that was encoded."""

import io
import struct

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from ingest.bc1 import encode
from tiles.terrain import MIP_BYTES, MIP_SIDES, TEXTURE_BYTES


def decoded(blocks: NDArray[np.uint8], side: int) -> NDArray[np.float64]:
    """Read BC1 blocks as a DDS file."""
    pixel_format = struct.pack("<II4s5I", 32, 4, b"DXT1", 0, 0, 0, 0, 0)
    head = struct.pack("<4s7I44x", b"DDS ", 124, 0x1007, side, side, 0, 0, 0)
    file = io.BytesIO(
        head + pixel_format + struct.pack("<5I", 0x1000, 0, 0, 0, 0) + blocks.tobytes()
    )
    with Image.open(file) as picture:
        return np.asarray(picture.convert("RGB"), np.float64)


def levels(texture: NDArray[np.uint8]) -> dict[int, NDArray[np.float64]]:
    parts = np.split(texture, np.cumsum(MIP_BYTES)[:-1])
    return {side: decoded(p, side) for side, p in zip(MIP_SIDES, parts, strict=True)}


@pytest.fixture
def scene(rng: np.random.Generator) -> NDArray[np.float32]:
    """Smooth colours with some grain, as terrain has."""
    y, x = np.mgrid[:256, :256] / 255.0
    base = np.stack([60 + 120 * x, 80 + 90 * y, 130 - 60 * x * y], axis=-1)
    return np.asarray(base + rng.normal(0, 4, base.shape), np.float32)


def test_a_texture_has_all_its_levels(scene: NDArray[np.float32]) -> None:
    assert encode(scene).shape == (TEXTURE_BYTES,)


def test_the_picture_comes_back_within_a_few_steps(scene: NDArray[np.float32]) -> None:
    gap = np.abs(levels(encode(scene))[256] - scene)
    assert gap.mean() < 4
    assert np.sqrt((gap**2).mean()) < 6


def test_a_plain_colour_comes_back_within_the_rounding_of_565() -> None:
    for colour in ([0, 0, 0], [255, 255, 255], [200, 40, 90], [17, 130, 222]):
        plain = np.broadcast_to(np.array(colour, np.float32), (256, 256, 3))
        for found in levels(encode(plain)).values():
            assert np.abs(found - colour).max() <= 2


def test_a_slow_change_of_colour_shows_no_steps() -> None:
    """Open sea: 5-6-5 bits alone would make bands 8 wide."""
    slow = np.linspace(0, 12, 256)[None, :, None] + np.array([50.0, 95.0, 145.0])
    ramp = np.broadcast_to(slow, (256, 256, 3)).astype(np.float32)
    gap = levels(encode(np.ascontiguousarray(ramp)))[256] - ramp
    assert np.abs(gap).max() < 3
    assert np.sqrt((gap**2).mean()) < 1.5


def test_every_texel_takes_the_nearest_of_its_blocks_colours(
    rng: np.random.Generator,
) -> None:
    picture = rng.uniform(0, 255, (256, 256, 3)).astype(np.float32)
    blocks = encode(picture)[: MIP_BYTES[0]].reshape(-1, 8)
    texels = picture.reshape(64, 4, 64, 4, 3).swapaxes(1, 2).reshape(-1, 16, 3)
    ends = blocks[:, :4].copy().view("<u2").astype(np.float64)
    assert (ends[:, 0] > ends[:, 1]).all(), "four colours, none transparent"
    rgb = np.stack([ends // 2048 / 31, ends // 32 % 64 / 63, ends % 32 / 31], -1) * 255
    first, second = rgb[:, 0], rgb[:, 1]
    palette = np.stack(
        [first, second, (2 * first + second) / 3, (first + 2 * second) / 3], 1
    )
    codes = blocks[:, 4:].copy().view("<u4") >> np.arange(0, 32, 2) & 3
    away = np.linalg.norm(texels[:, :, None] - palette[:, None], axis=-1)
    taken = np.take_along_axis(away, codes[..., None].astype(np.int64), 2)[..., 0]
    np.testing.assert_allclose(taken, away.min(axis=2), atol=0.01)


def test_an_edge_between_two_colours_stays_sharp() -> None:
    edge = np.zeros((256, 256, 3), np.float32)
    edge[:, 130:] = 240
    found = levels(encode(edge))[256]
    assert found[:, :128].max() < 40
    assert found[:, 132:].min() > 200
    assert (found[:, 130:132].mean() - found[:, 128:130].mean()) > 150


def test_each_level_is_the_mean_of_the_finer_one(scene: NDArray[np.float32]) -> None:
    found = levels(encode(scene))
    exact = scene
    for side in MIP_SIDES[1:]:
        exact = exact.reshape(side, 2, side, 2, 3).mean(axis=(1, 3))
        # A block has colours on one line only: the last levels hold the whole picture.
        assert np.abs(found[side] - exact).mean() < (5 if side >= 16 else 12)
        assert np.abs(found[side].mean() - scene.mean()) < 3


def test_a_scene_is_as_good_as_along_the_exact_axis_of_each_block(
    scene: NDArray[np.float32],
) -> None:
    """Oracle: principal axes by singular values, ends and choices in float64."""
    texels = scene.reshape(64, 4, 64, 4, 3).swapaxes(1, 2).reshape(-1, 16, 3)
    mean = texels.mean(axis=1, keepdims=True, dtype=np.float64)
    axis = np.linalg.svd(texels - mean)[2][:, 0]
    along = np.einsum("nik,nk->ni", texels - mean, axis)
    low, high = along.min(axis=1), along.max(axis=1)
    inset = (high - low) / 16
    steps = np.array([31, 63, 31]) / 255
    ends = np.stack([low + inset, high - inset], axis=1)[..., None] * axis[:, None] + mean
    ends = np.round(np.clip(ends, 0, 255) * steps) / steps
    thirds = np.arange(4)[:, None] / 3
    palette = ends[:, :1] + thirds * (ends[:, 1:] - ends[:, :1])
    away = ((texels[:, :, None] - palette[:, None]) ** 2).sum(axis=-1).min(axis=-1)
    found = ((levels(encode(scene))[256] - scene) ** 2).sum(axis=-1)
    assert 10 * np.log10(found.mean() / away.mean()) < 0.3

# SPDX-License-Identifier: Apache-2.0
"""Surface textures: one array texture whose layers are handed out to terrain tiles."""

import numpy as np
from numpy.typing import NDArray

from tiles.kernels import brief, inlined
from tiles.terrain import MIP_BYTES, MIP_SIDES, TEXTURE_SIDE
from viewer import gl
from viewer.gl import Gl

S3TC = "GL_EXT_texture_compression_s3tc"
WATER_START = sum(MIP_BYTES[:2])
WATER_END = WATER_START + MIP_BYTES[2]
BLUER = 1.7
"""Blue by red, as light, from which on texels count as wet"""
MAX_LAYERS = 2048  # what every driver has


class TextureLayers:
    """Layers of one array texture, BC1 where the driver can, else decoded to RGBA8."""

    def __init__(self, calls: Gl, layers: int) -> None:
        self._gl = calls
        self.compressed = S3TC in calls.context.extensions
        self._format = gl.BC1 if self.compressed else gl.RGBA8
        self.count = min(layers, MAX_LAYERS)
        self._free = list(range(self.count))[::-1]
        self.name = calls.create("glCreateTextures", gl.TEXTURE_2D_ARRAY)
        calls.call(
            "glTextureStorage3D",
            self.name,
            len(MIP_SIDES),
            self._format,
            TEXTURE_SIDE,
            TEXTURE_SIDE,
            self.count,
        )
        # On a CPU a second mip level costs 10 ms of a 1280x720 frame, for little.
        between = gl.LINEAR_MIPMAP_NEAREST if calls.is_software else gl.LINEAR_MIPMAP_LINEAR
        for parameter, value in (
            (gl.MIN_FILTER, between),
            (gl.MAG_FILTER, gl.LINEAR),
            (gl.WRAP_S, gl.CLAMP_TO_EDGE),
            (gl.WRAP_T, gl.CLAMP_TO_EDGE),
        ):
            calls.call("glTextureParameteri", self.name, parameter, value)

    def put(self, texture: NDArray[np.uint8]) -> int | None:
        """Copy a tile's BC1 levels to a free layer; None where no layer is free."""
        if not self._free:
            return None
        layer = self._free.pop()
        start = 0
        texture = np.ascontiguousarray(texture)
        for level, (side, size) in enumerate(zip(MIP_SIDES, MIP_BYTES, strict=True)):
            self._put_level(layer, level, side, texture[start : start + size])
            start += size
        return layer

    def _put_level(
        self, layer: int, level: int, side: int, blocks: NDArray[np.uint8]
    ) -> None:
        head = (self.name, level, 0, 0, layer, side, side, 1)
        if self.compressed:
            size = blocks.nbytes
            self._gl.call(
                "glCompressedTextureSubImage3D",
                *head,
                self._format,
                size,
                blocks.ctypes.data,
            )
            return
        texels = decode_bc1(blocks, side)
        self._gl.call(
            "glTextureSubImage3D", *head, gl.RGBA, gl.UNSIGNED_BYTE, texels.ctypes.data
        )

    def give_back(self, layer: int) -> None:
        """Free a layer."""
        self._free.append(layer)

    @property
    def used_bytes(self) -> int:
        """Bytes that the layers in use take."""
        layer = sum(MIP_BYTES) if self.compressed else 4 * sum(s * s for s in MIP_SIDES)
        return (self.count - len(self._free)) * layer


@brief
def shows_water(texture: NDArray[np.uint8]) -> bool:
    """Say whether a tile's texture has texels that `wet` of `terrain.frag` is above 0 for.

    Looked for in the ends of the blocks of a level of 64 x 64 texels: what is smaller
    than its texels is no sheet of water.
    """
    for block in range(WATER_START, WATER_END, 8):
        for end in (block, block + 2):
            word = np.int64(texture[end]) | np.int64(texture[end + 1]) << 8
            red, blue = light_of((word >> 11) / 31.0), light_of((word & 31) / 31.0)
            if blue > BLUER * red:
                return True
    return False


@inlined
def light_of(srgb: float) -> float:
    """Return light as `colour.glsl` does, 0 to 1."""
    return srgb * srgb * (0.72 + 0.28 * srgb)


def decode_bc1(blocks: NDArray[np.uint8], side: int) -> NDArray[np.uint8]:
    """Return the texels of BC1 blocks.

    Parameters
    ----------
    blocks : (side/4 * side/4 * 8,) uint8, row by row
    side : texels along an edge, a multiple of 4

    Returns
    -------
    texels : (side, side, 4) uint8 RGBA, row 0 first
    """
    block = blocks.reshape(-1, 8)
    ends = block[:, :4].copy().view("<u2").astype(np.int64)
    colours = np.stack((ends >> 11 << 3, (ends >> 5 & 63) << 2, (ends & 31) << 3), -1)
    colours |= colours >> np.array((5, 6, 5))
    c0, c1 = colours[:, 0], colours[:, 1]
    four = (ends[:, 0] > ends[:, 1])[:, None]
    third = np.where(four, (2 * c0 + c1) // 3, (c0 + c1) // 2)
    fourth = np.where(four, (c0 + 2 * c1) // 3, 0)
    palette = np.stack((c0, c1, third, fourth), 1)
    codes = block[:, 4:].copy().view("<u4") >> np.arange(0, 32, 2) & 3
    texels = np.take_along_axis(palette, codes.astype(np.int64)[:, :, None], 1)
    grid = texels.reshape(side // 4, side // 4, 4, 4, 3).swapaxes(1, 2)
    opaque = np.full((side, side, 4), 255, np.uint8)
    opaque[..., :3] = grid.reshape(side, side, 3)
    return opaque

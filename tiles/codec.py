# SPDX-License-Identifier: Apache-2.0
"""Bytes on disk are the GPU's bytes: header, vertices, indices, lane's own tables.

`FORMAT.md` specifies the layout. A stored body is the zstd frame of these bytes; its
checksum covers lane, cell and body, so that a right body under a wrong cell is found.
"""

import struct
import sys
import zlib
from functools import cache

import numpy as np
from numpy.typing import NDArray

from tiles.errors import TileFault
from tiles.lanes import Lane
from tiles.mesh import VERTEX, Mesh

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

__all__ = [
    "HEADER",
    "MAGIC",
    "VERSION",
    "checksum",
    "header_of",
    "pack",
    "read_header",
    "unpack",
    "zstd",
]

VERSION = 1
MAGIC = b"GPT1"
ZSTD_LEVEL = 5
"""A terrain tile takes a ninth less than at 3, for a quarter of a millisecond."""
HEADER = np.dtype(
    [
        ("magic", "S4"),
        ("version", "<u2"),
        ("lane", "<u2"),
        ("cell", "<i8"),
        ("centre", "<f8", 3),
        ("scale_m", "<f8"),
        ("error_m", "<f4"),
        ("texel_m", "<f4"),
        ("vertex_count", "<u4"),
        ("index_count", "<u4"),
        ("surface_index_count", "<u4"),
        ("tail_bytes", "<u4"),
        ("object_count", "<u4"),
        ("proxy_count", "<u4"),
    ]
)


def header_of(lane: Lane, cell: int, mesh: Mesh) -> NDArray[np.void]:
    """Return a one-element HEADER with everything that a mesh and its cell decide."""
    head = np.zeros(1, HEADER)
    head["magic"], head["version"], head["lane"], head["cell"] = MAGIC, VERSION, lane, cell
    head["centre"], head["scale_m"] = mesh.centre, mesh.scale_m
    head["vertex_count"], head["index_count"] = len(mesh.vertices), len(mesh.indices)
    return head


def pack(
    head: NDArray[np.void], mesh: Mesh, *tail: bytes, zstd_level: int = ZSTD_LEVEL
) -> bytes:
    """Join header, vertices, indices and the lane's tables, and compress them."""
    joined = b"".join(tail)
    head["tail_bytes"] = len(joined)
    whole = head.tobytes() + mesh.vertices.tobytes() + mesh.indices.tobytes() + joined
    return _compressor(zstd_level).compress(whole, zstd.ZstdCompressor.FLUSH_FRAME)


@cache
def _compressor(zstd_level: int) -> zstd.ZstdCompressor:
    """Return one to use again and again: a new one costs as much as a small tile."""
    return zstd.ZstdCompressor(zstd_level)


def unpack(lane: Lane, body: bytes) -> tuple[np.void, Mesh, memoryview]:
    """Split a stored body into header, mesh and the lane's tables (views, no copies).

    Raises
    ------
    TileFault
        When the body is not a tile of this lane and version, or its lengths disagree.
    """
    try:
        raw = zstd.decompress(body)
        head = np.frombuffer(raw, HEADER, 1)[0]
    except (zstd.ZstdError, ValueError, MemoryError) as error:
        raise TileFault(lane.name, "?", f"unreadable body ({error})") from error
    _require(lane, head)
    counts = int(head["vertex_count"]), int(head["index_count"])
    start = HEADER.itemsize
    middle = start + counts[0] * VERTEX.itemsize
    tail = middle + counts[1] * 2
    if len(raw) != tail + int(head["tail_bytes"]):
        raise TileFault(lane.name, str(int(head["cell"])), "lengths disagree")
    mesh = Mesh(
        head["centre"].copy(),
        float(head["scale_m"]),
        np.frombuffer(raw, VERTEX, counts[0], start),
        np.frombuffer(raw, "<u2", counts[1], middle),
    )
    return head, mesh, memoryview(raw)[tail:]


def read_header(lane: Lane, body: bytes) -> np.void:
    """Return a stored body's header alone, without unpacking all of it.

    Raises
    ------
    TileFault
    """
    try:
        start = zstd.ZstdDecompressor().decompress(body, max_length=HEADER.itemsize)
        head: np.void = np.frombuffer(start, HEADER, 1)[0]
    except (zstd.ZstdError, EOFError, ValueError) as error:
        raise TileFault(lane.name, "?", f"unreadable body ({error})") from error
    _require(lane, head)
    return head


def _require(lane: Lane, head: np.void) -> None:
    if head["magic"] != MAGIC or head["version"] != VERSION or head["lane"] != lane:
        raise TileFault(lane.name, "?", "not a tile of this lane and version")


def checksum(lane: Lane, cell: int, body: bytes) -> int:
    """CRC-32 over lane, cell and body."""
    return zlib.crc32(body, zlib.crc32(struct.pack("<Bq", lane, cell)))

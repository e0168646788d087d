# SPDX-License-Identifier: Apache-2.0
"""Tile bodies come back as they were; anything else is a fault, never a traceback."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tiles import objects, terrain
from tiles.codec import HEADER, MAGIC, checksum, pack, read_header, unpack, zstd
from tiles.errors import TileFault
from tiles.frames import Ecef, Local
from tiles.index_tree import INDEX
from tiles.lanes import Lane
from tiles.mesh import VERTEX, Mesh, quantise
from tiles.objects import OBJECT, PROXY, ObjectTile, prefix_end
from tiles.terrain import MIP_BYTES, RUNG, TEXTURE_BYTES, TerrainTile


@pytest.fixture
def mesh(rng: np.random.Generator) -> Mesh:
    steps, scale_m = quantise(Local(rng.uniform(-500, 500, (50, 3))))
    vertices = np.zeros(50, VERTEX)
    vertices["position"] = steps
    vertices["detail"] = rng.integers(0, 32768, (50, 2))
    indices = rng.integers(0, 50, 90).astype("<u2")
    return Mesh(Ecef(np.array([4e6, 1e5, 4.9e6])), scale_m, vertices, indices)


@pytest.fixture
def ground(mesh: Mesh, rng: np.random.Generator) -> TerrainTile:
    texture = rng.integers(0, 256, TEXTURE_BYTES).astype(np.uint8)
    return TerrainTile(12345, mesh, 60, 1.25, 0.5, texture)


@pytest.fixture
def town(mesh: Mesh) -> ObjectTile:
    things, proxies = np.zeros(7, OBJECT), np.zeros(2, PROXY)
    things["id"], things["dimension_m"] = np.arange(7), np.arange(70, 0, -10)
    things["index_end"] = np.arange(6, 48, 6)
    proxies["child"], proxies["error_m"] = (1, 3), (2.5, 4.5)
    return ObjectTile(777, mesh, things, proxies)


def assert_same(one: Any, other: Any) -> None:
    for name in ("cell", "surface_index_count", "error_m", "texel_m"):
        assert getattr(one, name, None) == getattr(other, name, None)
    assert one.mesh.centre.tolist() == other.mesh.centre.tolist()
    assert one.mesh.scale_m == other.mesh.scale_m
    assert one.mesh.vertices.tobytes() == other.mesh.vertices.tobytes()
    assert one.mesh.indices.tobytes() == other.mesh.indices.tobytes()


def test_a_terrain_tile_comes_back(ground: TerrainTile) -> None:
    found = terrain.decode(terrain.encode(ground))
    assert_same(found, ground)
    assert found.texture.tobytes() == ground.texture.tobytes()


def test_rungs_come_back_and_none_reaches_beyond_the_indices(ground: TerrainTile) -> None:
    rungs = np.array([(2.0, 48, 12, 24), (4.0, 72, 6, 18)], RUNG)
    tile = replace(ground, surface_index_count=36, rungs=rungs)
    found = terrain.decode(terrain.encode(tile))
    assert found.rungs.tolist() == rungs.tolist()
    assert found.parts().tolist() == [(1.25, 0, 36, 48), *rungs.tolist()]
    for rung, ends in ((0, (0, 36)), (1, (48, 60)), (2, (72, 78)), (3, (72, 78))):
        triangles = found.surface(rung)
        assert triangles.ravel().tolist() == tile.mesh.indices[slice(*ends)].tolist()
    rungs["index_count"][1] = 19
    with pytest.raises(TileFault, match="a rung beyond"):
        terrain.decode(terrain.encode(replace(tile, rungs=rungs)))


def test_an_object_tile_comes_back(town: ObjectTile) -> None:
    found = objects.decode(objects.encode(town))
    assert_same(found, town)
    assert found.objects.tobytes() == town.objects.tobytes()
    assert found.proxies.tobytes() == town.proxies.tobytes()


def test_records_lie_where_the_format_says() -> None:
    offsets = {name: HEADER.fields[name][1] for name in HEADER.names or ()}
    assert offsets == {
        "magic": 0, "version": 4, "lane": 6, "cell": 8, "centre": 16, "scale_m": 40,
        "error_m": 48, "texel_m": 52, "vertex_count": 56, "index_count": 60,
        "surface_index_count": 64, "tail_bytes": 68, "object_count": 72, "proxy_count": 76,
    }  # fmt: skip
    assert HEADER.itemsize == 80
    assert INDEX.itemsize == 84
    index = {name: INDEX.fields[name][1] for name in INDEX.names or ()}
    assert [index[name] for name in ("radius_m", "row", "check", "children")] == [
        32,
        64,
        76,
        80,
    ]
    assert VERTEX.itemsize == 16
    assert [VERTEX.fields[name][1] for name in VERTEX.names or ()] == [0, 6, 8, 12]
    assert (OBJECT.itemsize, PROXY.itemsize) == (32, 24)
    assert MIP_BYTES[0] == 256 * 256 // 2
    assert (
        sum((side // 4) ** 2 * 8 for side in (256, 128, 64, 32, 16, 8, 4)) == TEXTURE_BYTES
    )


def test_a_body_begins_with_its_magic_and_header(ground: TerrainTile) -> None:
    raw = zstd.decompress(terrain.encode(ground))
    assert raw[:4] == MAGIC == b"GPT1"
    assert int.from_bytes(raw[8:16], "little") == 12345
    assert len(raw) == 80 + 16 * 50 + 2 * 90 + TEXTURE_BYTES


def test_the_header_comes_without_the_rest(ground: TerrainTile, town: ObjectTile) -> None:
    body = terrain.encode(ground)
    head = read_header(Lane.TERRAIN, body)
    assert (head["cell"], head["index_count"], head["surface_index_count"]) == (
        12345,
        90,
        60,
    )
    assert (
        read_header(Lane.OBJECTS, objects.encode(town))
        == unpack(Lane.OBJECTS, objects.encode(town))[0]
    )
    for bad in (b"", b"x", b"\0" * 99, zstd.compress(b"GPT1"), zstd.compress(b"\0" * 99)):
        with pytest.raises(TileFault):
            read_header(Lane.TERRAIN, bad)
    with pytest.raises(TileFault, match="not a tile of this lane"):
        read_header(Lane.OBJECTS, body)


def test_any_damaged_body_is_a_fault(
    ground: TerrainTile, town: ObjectTile, rng: np.random.Generator
) -> None:
    for decode, body in (
        (terrain.decode, terrain.encode(ground)),
        (objects.decode, objects.encode(town)),
    ):
        whole = zstd.decompress(body)
        bad = [b"", b"x", body[:-1], body[: len(body) // 2], zstd.compress(whole[:70])]
        bad += [zstd.compress(whole[:cut]) for cut in rng.integers(0, len(whole), 20)]
        bad += [zstd.compress(whole + b"\0")]
        for one in bad:
            with pytest.raises(TileFault):
                decode(one)
        for _ in range(200):
            changed = bytearray(whole)
            changed[int(rng.integers(80))] ^= int(rng.integers(1, 256))
            try:
                decode(zstd.compress(bytes(changed)))
            except TileFault:
                continue


def test_a_tile_of_the_other_lane_is_a_fault(ground: TerrainTile, town: ObjectTile) -> None:
    with pytest.raises(TileFault, match="not a tile of this lane"):
        terrain.decode(objects.encode(town))
    with pytest.raises(TileFault, match="not a tile of this lane"):
        objects.decode(terrain.encode(ground))


def test_wrong_counts_of_tables_are_a_fault(town: ObjectTile, ground: TerrainTile) -> None:
    head, mesh, tail = unpack(Lane.OBJECTS, objects.encode(town))
    wrong = np.array([head])
    wrong["object_count"] += 1
    with pytest.raises(TileFault, match="length"):
        objects.decode(pack(wrong, mesh, bytes(tail)))
    head, mesh, tail = unpack(Lane.TERRAIN, terrain.encode(ground))
    with pytest.raises(TileFault, match="length"):
        terrain.decode(pack(np.array([head]), mesh, bytes(tail)[:-8]))


def test_the_checksum_covers_lane_cell_and_every_byte(rng: np.random.Generator) -> None:
    body = rng.bytes(300)
    known = checksum(Lane.TERRAIN, 99, body)
    assert checksum(Lane.OBJECTS, 99, body) != known
    assert checksum(Lane.TERRAIN, 98, body) != known
    for at in range(300):
        for bit in range(8):
            changed = bytearray(body)
            changed[at] ^= 1 << bit
            assert checksum(Lane.TERRAIN, 99, bytes(changed)) != known


def test_larger_than_a_threshold_is_a_prefix(town: ObjectTile) -> None:
    for threshold in (0.0, 9.99, 10.0, 35.0, 70.0, 80.0):
        count = int((town.objects["dimension_m"] > threshold).sum())
        wanted = int(town.objects["index_end"][count - 1]) if count else 0
        assert prefix_end(town.objects, threshold) == wanted

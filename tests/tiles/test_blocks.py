# SPDX-License-Identifier: Apache-2.0
"""Pieces are all of a mesh's triangles, each beside its neighbours and inside its box."""

from dataclasses import replace

import numpy as np
import pytest

from tests.viewer.worlds import one_colour, terrain_tile
from tiles import cells, terrain
from tiles.blocks import (
    BITS,
    BLOCK_BITS,
    BLOCKS,
    BOX_STEPS,
    FEWEST,
    MOST_PIECES,
    SIDE_PARTS,
    SKIRT_PIECES,
    axes_of,
    morton,
    slimness,
)
from tiles.errors import TileFault
from tiles.frames import Floats
from tiles.mesh import SKIRT, UV_ONE, Mesh
from tiles.terrain import RUNG, TerrainTile, in_pieces, no_pieces

PLACES = ((0.1, 0.2, 12), (3.1, -1.2, 8), (-2.0, 1.5707, 6), (1.0, -0.4, 3), (0.4, 0.4, 0))


def rough(seed: int, height_m: float) -> TerrainTile:
    """A tile of noise with a rung, in no pieces and in no order."""
    rng = np.random.default_rng(seed)
    lon, lat, level = PLACES[seed % len(PLACES)]
    cell = int(cells.cell_at(lon, lat, level))

    def height(lon: Floats, lat: Floats) -> Floats:
        return np.asarray(rng.uniform(0, height_m, np.broadcast(lon, lat).shape))

    fine = terrain_tile(cell, one_colour((9, 9, 9)), 33, height)
    count = fine.surface_index_count
    surface = rng.permutation(fine.surface())
    coarse, skirt = surface[:600], rng.permutation(fine.mesh.indices[count:].reshape(-1, 3))
    parts = surface, skirt, coarse, skirt
    indices = np.concatenate([part.ravel() for part in parts]).astype(np.uint16)
    rungs = np.array(
        [(5e4, len(fine.mesh.indices), 1800, len(coarse) * 3 + skirt.size)], RUNG
    )
    mesh = replace(fine.mesh, indices=indices)
    return replace(fine, mesh=mesh, rungs=rungs, pieces=no_pieces())


def ranges(tile: TerrainTile, rung: int) -> list[tuple[int, np.ndarray]]:
    """Number and triangles of each block of a mesh."""
    ends = np.cumsum(tile.pieces["count"][rung, :BLOCKS], dtype=np.int64)
    parts = np.split(tile.surface(rung), ends)
    assert len(parts.pop()) == 0
    return list(enumerate(parts))


def as_set(triangles: np.ndarray) -> list[tuple[int, ...]]:
    return sorted(tuple(one) for one in triangles.tolist())


@pytest.mark.parametrize("seed", range(10))
def test_blocks_are_all_triangles_each_in_the_square_of_its_middle(seed: int) -> None:
    before = rough(seed, 500.0)
    after = in_pieces(before)
    assert after.pieces.shape == (2, MOST_PIECES)
    for rung in (0, 1):
        assert as_set(after.surface(rung)) == as_set(before.surface(rung))
        for number, triangles in ranges(after, rung):
            at = after.mesh.vertices["detail"][triangles].astype(float).mean(axis=1)
            slim = slimness(before.cell)
            columns = np.array((8 >> slim, 8 << slim))
            col, row = np.floor(at.T * columns[:, None] / UV_ONE).astype(int)
            for bit in range(BLOCK_BITS - slim):
                assert (col >> bit & 1 == number >> 2 * bit & 1).all()
                assert (row >> bit & 1 == number >> 2 * bit + 1 & 1).all()
            most = 2 * (BLOCK_BITS - slim)
            assert (row >> BLOCK_BITS - slim == number >> most).all()
    assert after.mesh.vertices.tobytes() == before.mesh.vertices.tobytes()


@pytest.mark.parametrize("height_m", [0.0, 3000.0])
@pytest.mark.parametrize("seed", range(5))
def test_a_box_holds_its_triangles_as_a_gpu_places_them(seed: int, height_m: float) -> None:
    """Steps are added and scaled in float32, as the shader does, from any eye."""
    tile = in_pieces(rough(seed, height_m))
    axes, rng = axes_of(tile.mesh.centre), np.random.default_rng(seed)
    scale = np.float32(tile.mesh.scale_m)
    whole = np.rint(rng.uniform(-4e4, 4e4, 3)).astype(np.float32)
    rest = rng.uniform(0, 1, 3).astype(np.float32) * scale
    steps = tile.mesh.vertices["position"].astype(np.float32)
    placed = ((steps + whole) * scale + rest).astype(np.float64)
    local = (placed - rest.astype(float)) / float(scale) - whole
    for rung in (0, 1):
        for number, triangles in ranges(tile, rung):
            box = tile.pieces[rung, number]
            spots = local[triangles].reshape(-1, 3) @ axes.T
            # A step more, as culling allows.
            assert (spots >= BOX_STEPS * box["low"].astype(float) - 1.0).all()
            assert (spots <= BOX_STEPS * box["high"].astype(float) + 1.0).all()


def test_boxes_are_not_much_larger_than_their_blocks() -> None:
    tile = in_pieces(rough(0, 10.0))
    assert (tile.mesh.vertices["flags"] & SKIRT).any()
    box = tile.pieces[0, :BLOCKS]
    sides = box["high"].astype(float) - box["low"]
    whole = 2 * 32767 / BOX_STEPS
    assert (sides[:, :2] < 1.5 * whole / 8 + 3).all()


@pytest.mark.parametrize("lat_deg", [0.0, 50.0, 70.0, 80.0, 88.0])
def test_blocks_are_about_square_up_to_the_poles(lat_deg: float) -> None:
    """Within a factor of two in the cell's middle: a step changes it by four."""
    cell = int(cells.cell_at(0.1, np.radians(lat_deg), 6))
    slim, (_, south, _, north) = slimness(cell), cells.bounds_rad(cell)
    wide, high = np.cos((south + north) / 2) / (8 >> slim), 1.0 / (8 << slim)
    assert 0.5 <= wide / high <= 2.0


def skirt_of(tile: TerrainTile, rung: int) -> np.ndarray:
    part = tile.parts()[rung]
    first, count = int(part["first_index"]), int(part["index_count"])
    indices = tile.mesh.indices[first : first + count].reshape(-1, 3)
    return indices[int(part["surface_index_count"]) // 3 :]


@pytest.mark.parametrize("seed", range(5))
def test_a_skirt_is_sorted_by_parts_of_sides_each_in_its_box(seed: int) -> None:
    before = rough(seed, 500.0)
    after = in_pieces(before)
    at = after.mesh.vertices["detail"]
    edges = (at[:, 1] == 0, at[:, 0] == UV_ONE, at[:, 1] == UV_ONE, at[:, 0] == 0)
    steps = after.mesh.vertices["position"].astype(float) @ axes_of(after.mesh.centre).T
    for rung in (0, 1):
        assert as_set(skirt_of(after, rung)) == as_set(skirt_of(before, rung))
        pieces = after.pieces[rung, -SKIRT_PIECES:]
        parts = np.split(skirt_of(after, rung), np.cumsum(pieces["count"])[:-1])
        for number, (part, piece) in enumerate(zip(parts, pieces, strict=True)):
            side, nth = divmod(number, SIDE_PARTS)
            along = at[part, side % 2].mean(axis=1) * SIDE_PARTS / UV_ONE
            assert len(part) == 2 * 32 / SIDE_PARTS
            assert edges[side][part].all()
            assert ((along >= nth) & (along <= nth + 1)).all()
            assert (steps[part] >= BOX_STEPS * piece["low"].astype(float) - 1e-6).all()
            assert (steps[part] <= BOX_STEPS * piece["high"].astype(float) + 1e-6).all()


def test_a_skirt_that_is_not_on_the_cells_edge_leaves_a_tile_whole() -> None:
    tile = rough(0, 100.0)
    tile.mesh.vertices["detail"][tile.mesh.indices[tile.surface_index_count]] += 1
    assert len(in_pieces(tile).pieces) == 0


def test_small_meshes_have_no_blocks() -> None:
    side = int(np.sqrt(FEWEST / 2))
    few = terrain_tile(int(cells.cell_at(0.1, 0.2, 9)), one_colour((9, 9, 9)), side)
    assert few.pieces.shape == (1, SKIRT_PIECES)
    found = terrain.decode(terrain.encode(few))
    assert found.pieces.tobytes() == few.pieces.tobytes()


def test_blocks_come_back_and_other_counts_are_a_fault() -> None:
    tile = in_pieces(rough(1, 100.0))
    found = terrain.decode(terrain.encode(tile))
    assert found.pieces.tobytes() == tile.pieces.tobytes()
    assert found.rungs.tobytes() == tile.rungs.tobytes()
    assert found.mesh.indices.tobytes() == tile.mesh.indices.tobytes()
    for rung in (0, 1):
        for piece, fault in ((7, "blocks are not its surface"), (-1, "sides are not its")):
            wrong = tile.pieces.copy()
            wrong["count"][rung, piece] += 1
            with pytest.raises(TileFault, match=fault):
                terrain.decode(terrain.encode(replace(tile, pieces=wrong)))
    for wrong in (tile.pieces[:1], np.concatenate([tile.pieces, tile.pieces])):
        with pytest.raises(TileFault, match="another length"):
            terrain.decode(terrain.encode(replace(tile, pieces=wrong)))
    with pytest.raises(TileFault, match="another length"):
        terrain.decode(terrain.encode(replace(tile, pieces=tile.pieces[:, :9])))


def test_a_rung_whose_surface_is_longer_than_itself_is_a_fault() -> None:
    tile = rough(2, 100.0)
    rungs = tile.rungs.copy()
    rungs["surface_index_count"] = rungs["index_count"] + 3
    with pytest.raises(TileFault, match="a rung beyond"):
        terrain.decode(terrain.encode(replace(tile, rungs=rungs)))


def test_a_mesh_with_an_empty_rung_is_put_into_blocks() -> None:
    tile = rough(3, 100.0)
    rungs = tile.rungs.copy()
    rungs["surface_index_count"] = rungs["index_count"] = 0
    found = in_pieces(replace(tile, rungs=rungs))
    assert found.pieces["count"].sum(axis=1).tolist() == [2048 + 256, 0]
    assert isinstance(found.mesh, Mesh)


def test_triangles_lie_along_a_morton_curve_and_those_of_one_place_stay_in_order() -> None:
    before = rough(3, 500.0)
    triangles = before.surface().astype(np.int64)
    middle = before.mesh.vertices["detail"].astype(np.int64)[triangles].sum(axis=1)
    place = np.minimum((middle << BITS) // (3 * UV_ONE), (1 << BITS) - 1)
    code = morton(place)
    assert slimness(before.cell) == 0
    digits = [format(one, f"0{BITS}b") for one in place.ravel().tolist()]
    pairs = zip(digits[::2], digits[1::2], strict=True)
    woven = [int("".join(y + x for x, y in zip(*two, strict=True)), 2) for two in pairs]
    assert code.tolist() == woven
    order = sorted(range(len(code)), key=lambda k: woven[k])
    assert (in_pieces(before).surface() == before.surface()[order]).all()

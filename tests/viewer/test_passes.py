# SPDX-License-Identifier: Apache-2.0
import re
from itertools import chain

import moderngl
import numpy as np
import pytest

from tiles.lanes import Lane
from viewer.frame_table import PARTS
from viewer.passes import (
    SKIES,
    VARIANTS,
    make_program,
    make_sky_program,
    parts_of,
    source,
)


def test_the_version_comes_first_and_the_define_before_its_use() -> None:
    text = source("frame.glsl", "vertex_inputs.glsl", "probe.vert", define="TERRAIN")
    assert text.index("#version 430") < text.index("#define TERRAIN")
    assert text.index("#define TERRAIN") < text.index("#ifdef TERRAIN")


@pytest.mark.parametrize(
    ("lane", "name"),
    [(lane, name) for lane in Lane for names in VARIANTS[lane] for name in names],
)
def test_every_variant_compiles(
    gl_context: moderngl.Context, lane: Lane, name: str
) -> None:
    make_program(gl_context, lane, name).release()


@pytest.mark.parametrize("name", SKIES)
def test_every_sky_compiles(gl_context: moderngl.Context, name: str) -> None:
    make_sky_program(gl_context, name).release()


def linear_of(srgb: np.ndarray) -> np.ndarray:
    """IEC 61966-2-1."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


@pytest.mark.parametrize(("colours", "mean"), [("WALLS", "WALL"), ("ROOFS", "ROOF")])
def test_proxies_have_the_mean_colour_of_buildings(colours: str, mean: str) -> None:
    text = source("objects.vert")

    def vectors(start: str) -> np.ndarray:
        part = text[text.index(start) :]
        found = re.findall(r"vec3\(([\d., ]+)\)", part[: part.index(";")])
        return np.array([np.fromstring(one, sep=",") for one in found])

    each = vectors(f"const vec3 {colours}[8]")
    assert each.shape == (8, 3)
    mean_light = linear_of(each).mean(0)
    assert np.allclose(
        linear_of(vectors(f"const vec3 MEAN_{mean}")[0]), mean_light, atol=0.004
    )


@pytest.mark.parametrize(
    ("counts", "kinds"),
    [
        ((0, 0, 0), (0, 0, 0)),
        ((1, 0, 1), (0, 0, 0)),
        ((7, 3, 19), (4, 0, 5)),
        ((6, 6, 9), (2, 3, 4)),
    ],
)
def test_the_parts_of_a_frame_cover_each_draw_once(
    counts: tuple[int, int, int], kinds: tuple[int, int, int]
) -> None:
    objects, fading, terrain = counts
    found = parts_of(*counts, kinds)
    assert len(found) == len(PARTS)
    parts = [list(range(first, first + n)) for first, n in found]
    assert list(chain(*parts[:3])) == list(range(objects))
    assert list(chain(*parts[3:])) == list(range(terrain))
    assert len(parts[2]) == fading
    assert [len(part) for part in parts[3:6]] == list(kinds)

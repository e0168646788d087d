# SPDX-License-Identifier: Apache-2.0
import re
from itertools import chain

import moderngl
import numpy as np
import pytest

from tiles.lanes import Lane
from viewer.passes import VARIANTS, make_program, parts_of, source


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


@pytest.mark.parametrize(("colours", "mean"), [("WALLS", "WALL"), ("ROOFS", "ROOF")])
def test_proxies_have_the_mean_colour_of_buildings(colours: str, mean: str) -> None:
    text = source("objects.vert")

    def vectors(start: str) -> np.ndarray:
        part = text[text.index(start) :]
        found = re.findall(r"vec3\(([\d., ]+)\)", part[: part.index(";")])
        return np.array([np.fromstring(one, sep=",") for one in found])

    each = vectors(f"const vec3 {colours}[8]")
    assert each.shape == (8, 3)
    mean_light = (each**2).mean(0)
    assert np.allclose(vectors(f"const vec3 MEAN_{mean}")[0] ** 2, mean_light, atol=1e-3)


@pytest.mark.parametrize("counts", [(0, 0, 0, 0), (1, 0, 1, 0), (7, 3, 9, 4), (6, 6, 5, 5)])
def test_the_parts_of_a_frame_cover_each_draw_once(
    counts: tuple[int, int, int, int],
) -> None:
    objects, fading, terrain, grained = counts
    parts = [list(range(first, first + n)) for first, n in parts_of(*counts)]
    assert list(chain(*parts[:3])) == list(range(objects))
    assert list(chain(*parts[3:])) == list(range(terrain))
    assert len(parts[2]) == fading
    assert len(parts[3]) == grained

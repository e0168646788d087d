# SPDX-License-Identifier: Apache-2.0
from viewer.passes import source


def test_the_version_comes_first_and_the_define_before_its_use() -> None:
    text = source("frame.glsl", "vertex_inputs.glsl", "probe.vert", define="TERRAIN")
    assert text.index("#version 430") < text.index("#define TERRAIN")
    assert text.index("#define TERRAIN") < text.index("#ifdef TERRAIN")

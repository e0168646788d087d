# SPDX-License-Identifier: Apache-2.0
"""Make the README's sheet of six heights from a store of the samples.

python -m tests.benchmarks.heights_picture demo/world.geopage viewer/pictures/heights.jpg
"""

import sys

from PIL import Image

import geopage

SIZE, COLUMNS, QUALITY = (640, 360), 2, 86
VIEWS = (
    (-120.0, 37.0, 1e7, 0.0, -90.0),
    (-117.5, 27.5, 4e5, -12.0, -26.0),
    (85.45, 27.75, 2e4, -5.0, -24.0),
    (-122.459, 37.7465, 900.0, 25.0, -33.0),
    (-122.4505, 37.7575, 260.0, 20.0, -16.0),
    (-122.44915, 37.7617, 10.0, 350.9, -4.0),
)
"""Longitude, latitude, height above ground, heading and pitch: degrees and metres"""


def main(store: str, out: str) -> None:
    """Draw the views and write them side by side."""
    rows = -(-len(VIEWS) // COLUMNS)
    sheet = Image.new("RGB", (COLUMNS * SIZE[0], rows * SIZE[1]))
    with geopage.open(store) as world:
        for i, view in enumerate(VIEWS):
            drawn = Image.fromarray(world.render(*view, size_px=SIZE).rgb)
            sheet.paste(drawn, (i % COLUMNS * SIZE[0], i // COLUMNS * SIZE[1]))
    sheet.save(out, quality=QUALITY, optimize=True)


if __name__ == "__main__":
    main(*sys.argv[1:])

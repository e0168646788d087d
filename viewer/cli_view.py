# SPDX-License-Identifier: Apache-2.0
"""`geopage view`: fly through a store in a window."""

from pathlib import Path

from geopage.arguments import HEADING_PITCH, LAT_LON_HEIGHT, Parser, positive, size
from geopage.settings import FADE_S, POLICIES
from tiles.errors import InputError
from viewer.cli import fade, settings_of, styling

KEYS = """Drag turns the globe, the wheel zooms to the cursor, right drag tilts and turns,
a double click flies there; W A S D fly, N is north up, H shows all keys, Q or Escape
quits."""


def view(words: list[str]) -> int:
    """Open a window."""
    parser = Parser("view", "Fly through a store in a window.", KEYS)
    parser.add_argument("store", type=Path)
    parser.add_argument(
        "--at",
        type=LAT_LON_HEIGHT,
        metavar="LAT,LON,HEIGHT",
        help="where to begin (default: the globe, turned to the data)",
    )
    parser.add_argument("--look", type=HEADING_PITCH, metavar="HEADING,PITCH")
    parser.add_argument(
        "--height-reference",
        choices=("ground", "ellipsoid"),
        default="ground",
        help="of --at",
    )
    parser.add_argument("--path", type=Path, metavar="PATH.json", help="a tour to fly")
    parser.add_argument("--size", type=size, default=(1280, 720), metavar="WxH")
    parser.add_argument("--fullscreen", action="store_true")
    parser.add_argument(
        "--threshold", type=positive, default=2.0, metavar="PX", help="largest screen error"
    )
    parser.add_argument(
        "--object-threshold",
        type=positive,
        metavar="PX",
        help="least projected size of an object",
    )
    parser.add_argument("--budget", type=positive, default=512.0, metavar="MIB")
    parser.add_argument(
        "--fps",
        type=positive,
        metavar="N",
        help="hold this frame rate by coarser detail (default: as fine as --threshold)",
    )
    parser.add_argument("--policy", choices=POLICIES, default="benefit")
    parser.add_argument("--fade", type=fade, default=FADE_S, metavar="SECONDS")
    parser.add_argument(
        "--out",
        type=Path,
        default=Path(),
        metavar="DIR",
        help="where pictures and tours are saved (default: here)",
    )
    styling(parser)
    given = parser.read(words)
    try:
        from viewer.open_window import open_window  # noqa: PLC0415  (opens GL)
    except ImportError as error:  # glfw's, where its library can't be loaded
        raise InputError(
            "window", str(error), "pip install --force-reinstall glfw"
        ) from error

    open_window(given.store, settings_of(given), given)
    return 0

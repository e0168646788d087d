# SPDX-License-Identifier: Apache-2.0
"""`geopage view`: fly through a store in a window."""

from pathlib import Path

from geopage.arguments import HEADING_PITCH, LAT_LON_HEIGHT, Parser, positive
from tiles.errors import InputError
from viewer.cli_options import height_reference, paging, seeing, settings_of, styling

KEYS = """Drag turns the globe, the wheel zooms to the cursor, right drag tilts and turns,
a double click flies there; W A S D fly, N is north up, H shows all keys, Q or Escape
quits."""


def view(words: list[str]) -> int:
    """Open a window."""
    given = parser_of_view().read(words)
    try:
        from viewer.open_window import open_window  # noqa: PLC0415  (opens GL)
    except ImportError as error:  # glfw's, where its library can't be loaded
        raise InputError(
            "window", str(error), "pip install --force-reinstall glfw"
        ) from error

    open_window(given.store, settings_of(given), given)
    return 0


def parser_of_view() -> Parser:
    """Return what reads the words of `view`."""
    parser = Parser("view", "Fly through a store in a window.", KEYS)
    parser.add_argument("store", type=Path)
    parser.add_argument(
        "--at",
        type=LAT_LON_HEIGHT,
        metavar="LAT,LON,HEIGHT",
        help="where to begin (default: the globe, turned to the data)",
    )
    parser.add_argument("--look", type=HEADING_PITCH, metavar="HEADING,PITCH")
    height_reference(parser)
    parser.add_argument("--path", type=Path, metavar="PATH.json", help="a tour to fly")
    parser.add_argument("--fullscreen", action="store_true")
    seeing(parser)
    parser.add_argument(
        "--fps",
        type=positive,
        metavar="N",
        help="hold this frame rate by coarser detail (default: as fine as --threshold)",
    )
    paging(parser)
    parser.add_argument(
        "--out",
        type=Path,
        default=Path(),
        metavar="DIR",
        help="where pictures and tours are saved (default: here)",
    )
    styling(parser)
    return parser

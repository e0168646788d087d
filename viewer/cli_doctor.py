# SPDX-License-Identifier: Apache-2.0
"""`geopage doctor`: what this machine can draw with."""

from geopage.arguments import Parser, print_json


def doctor(words: list[str]) -> int:
    """Say what is there, and what to install; 1 when nothing can be drawn."""
    parser = Parser(
        "doctor",
        "Say which OpenGL driver is found, which fast paths it has, whether a window"
        " opens,\nwhich extras are installed, and what to install where something is"
        " missing.",
        "Exit code 1: nothing can be drawn here.",
    )
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout")
    given = parser.read(words)
    from viewer.doctor import examine, lines  # noqa: PLC0415  (opens GL)

    found = examine()
    if given.json:
        print_json(found)
    else:
        print("\n".join(lines(found)))
    return 0 if found["can_draw"] else 1

# SPDX-License-Identifier: Apache-2.0
"""The umbrella command: finds its subcommands through entry points."""

import os
import signal
import sqlite3
import sys
from collections.abc import Callable, Sequence
from importlib.metadata import entry_points

from geopage import __version__
from tiles.errors import InputError, TileFault, handled, is_interrupt

GROUP = "geopage.commands"
HELP = {
    "demo": "make the sample world, fly it, write pictures, a film, a report and a chart",
    "ingest": "read elevation models, pictures or footprints into a store",
    "info": "say what a store holds",
    "check": "verify every tile and every invariant of a store",
    "sample": "heights, cells and buildings at places",
    "find": "buildings by what is known of them",
    "view": "fly through a store in a window",
    "render": "make one settled picture",
    "fly": "fly a camera path and write a report",
    "film": "make a film of a camera path, every frame of it complete",
    "replay": "page a flight without drawing it, by any policy, the same every time",
    "paging": "replay flights under every policy: each number of paging beside its limit",
    "accuracy": "measure how far pictures of random views are from the sources, in pixels",
    "bench": "speed against accuracy of several methods over a sweep of thresholds",
    "experiments": "the experiments of five papers again, their figures beside ours",
    "stability": "how far from failing we are, for every known way to fail",
    "chart": "draw speed against accuracy from one or more flights",
    "remove": "take a source out of a store",
    "doctor": "say what this machine can draw with",
}
USAGE = """usage: geopage COMMAND ...

Fly through your own elevation models and building footprints, from the whole earth
down to the street.

commands:
{commands}

A first flight:
  geopage demo
With your own data:
  geopage ingest terrain world.geopage dem.tif --datum egm96
  geopage ingest buildings world.geopage city.geojson
  geopage view   world.geopage

`geopage COMMAND --help` explains a command."""
Command = Callable[[list[str]], int]


def main(argv: Sequence[str] | None = None) -> int:
    """Run one subcommand and turn what goes wrong into one line and an exit code.

    Returns
    -------
    0 done, 1 the answer is no, 2 the input can't be used, 130 interrupted
    """
    words = list(sys.argv[1:] if argv is None else argv)
    if not words or words[0] in {"-h", "--help", "help"}:
        print(usage())
        return 0 if words else 2
    if words[0] == "--version":
        print(f"geopage {__version__}")
        return 0
    return guarded(run, words)


def run(words: list[str]) -> int:
    """Load and run the subcommand that the first word names."""
    command = find(words[0])
    if command is None:
        print(f"geopage: no command {words[0]!r}; see geopage --help", file=sys.stderr)
        return 2
    return command(words[1:])


def guarded(command: Command, words: list[str]) -> int:
    """Run a command; a fault becomes one line on stderr."""
    try:
        # An order to end is taken as Ctrl-C, and leaves as little behind.
        with handled(signal.default_int_handler, [signal.SIGTERM]):
            return command(words)
    except (InputError, TileFault) as error:
        print(f"geopage: {error}", file=sys.stderr)
    except sqlite3.DatabaseError as error:
        print(
            f"geopage: the store can't be used ({error}); {advice(error)}", file=sys.stderr
        )
    except OSError as error:
        if isinstance(error, BrokenPipeError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return 1
        what = f"{error.filename}: " if error.filename else ""
        print(f"geopage: {what}{error.strerror}; check the path", file=sys.stderr)
    except SystemExit as stop:
        return stop.code if isinstance(stop.code, int) else 2
    except BaseException as error:
        if not is_interrupt(error):
            raise
        print("geopage: stopped; what was reported done is kept", file=sys.stderr)
        return 130
    return 2


def advice(error: sqlite3.DatabaseError) -> str:
    """Return what to do about an error of the store's file."""
    text = str(error)
    known = {
        "locked": "another command writes to it, try again when that is done",
        "full": "make room on the disk and run the command again",
        "readonly": "check the permissions of the file and of its folder",
        "disk I/O error": "make room on the disk and run the command again",
        "unable to open": "check the permissions of the file and of its folder",
    }
    return next((say for what, say in known.items() if what in text), "run geopage check")


def find(name: str) -> Command | None:
    """Load the command that an installed package registered under a name."""
    for entry in entry_points(group=GROUP, name=name):
        command: Command = entry.load()
        return command
    return None


def usage() -> str:
    """Return the overview of the commands that are installed."""
    names = {entry.name for entry in entry_points(group=GROUP)}
    known = [name for name in HELP if name in names] + sorted(names - HELP.keys())
    lines = (f"  {name:<11} {HELP.get(name, '')}" for name in known)
    return USAGE.format(commands="\n".join(lines))

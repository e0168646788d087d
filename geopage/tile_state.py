# SPDX-License-Identifier: Apache-2.0
"""The states of a tile, one byte for each row of a forest.

::

    ABSENT --wanted--> QUEUED --taken--> LOADING --delivered--> RESIDENT --uploaded--+
      ^ ^ ^               |                | |                     |                 |
      | | +--cancelled----+                | +--fault--> FAILED    |                 v
      | +------------no longer wanted------+-----------------------+             UPLOADED
      |                                                                          ^      |
      +--released-- RELEASING --wanted again, renderer not yet told--------------+      |
                        ^---------------------------evicted-----------------------------+

Only uploaded tiles are drawn. A failed tile stays failed; its stand-in stays, too.
"""

from enum import IntEnum


class State(IntEnum):
    """Where a tile is."""

    ABSENT = 0
    QUEUED = 1
    LOADING = 2
    RESIDENT = 3
    """decoded, in main memory, on its way to the renderer"""
    UPLOADED = 4
    RELEASING = 5
    """not drawn any more, but the renderer may still be drawing an older list"""
    FAILED = 6


_NEXT = {
    State.ABSENT: {State.QUEUED, State.LOADING},
    State.QUEUED: {State.LOADING, State.ABSENT},
    State.LOADING: {State.RESIDENT, State.FAILED, State.ABSENT},
    State.RESIDENT: {State.UPLOADED, State.ABSENT},
    State.UPLOADED: {State.RELEASING},
    State.RELEASING: {State.ABSENT, State.UPLOADED},
    State.FAILED: set[State](),
}


def advance(state: int, to: State) -> State:
    """Return `to`, if a tile may go there from `state`.

    Raises
    ------
    ValueError
        When no arrow leads from one to the other.
    """
    if to not in _NEXT[State(state)]:
        was = State(state).name
        raise ValueError(f"expected an arrow of the diagram, got {was} to {to.name}")
    return to

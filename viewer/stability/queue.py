# SPDX-License-Identifier: Apache-2.0
"""Work that nobody needs any more."""

from viewer.stability.paging import stale_uploads_after_a_jump
from viewer.stability.place import Place
from viewer.stability.row import Finding, Row, first_bad
from viewer.stability.site import Site

JUMPS_HZ, FASTEST_HZ, IN_FLIGHT = 5.0, 30.0, 2.0


def stale(place: Place) -> Finding:
    """Jump to and fro more and more often while decoded tiles pile up."""
    site = Site(*place.finest, place.session.surface.height_at(*place.finest))

    def tiles(per_s: float) -> float:
        return stale_uploads_after_a_jump(place.store, site, per_s)

    steps = place.count(3, 1)
    breaks = first_bad(lambda hz: tiles(hz) <= IN_FLIGHT, JUMPS_HZ, FASTEST_HZ, steps)
    return Finding(JUMPS_HZ, tiles(JUMPS_HZ), breaks, FASTEST_HZ)


ROWS = (
    Row(
        "stale work",
        "after a jump the tiles of the old view are still uploaded",
        "jumps a second",
        "tiles uploaded after a jump that are of no use",
        IN_FLIGHT,
        stale,
    ),
)

# SPDX-License-Identifier: Apache-2.0
"""What a flight counts. Each number is changed under the residency's lock only."""

from dataclasses import asdict, dataclass


@dataclass(slots=True)
class Counters:
    """Totals since the pager was made."""

    tiles_loaded: int = 0
    """read, checked and decoded"""
    bytes_read: int = 0
    """stored bytes read, also of tiles that were dropped afterwards"""
    tiles_cancelled: int = 0
    """asked for and then dropped: before the read, the decoding or the upload"""
    tiles_late: int = 0
    """uploaded after a stand-in was drawn for them in a list of the newest view"""
    tiles_unused: int = 0
    """loaded, and never drawn so far"""

    def as_dict(self) -> dict[str, int]:
        """Return the numbers by name."""
        return asdict(self)

# SPDX-License-Identifier: Apache-2.0
"""Replacing proxies by what they stand for, and back, without a visible swap.

A pixel of the screen's pattern p (0 to 1) shows the objects that were selected
p x `seconds` ago, seen with the newest pose. Each pixel so shows one whole selection:
never a building and its proxy, never neither, however often and however deep things are
replaced meanwhile. Blending levels over time is what the Berkeley walkthrough did
(Funkhouser, Sequin, Teller 1992, section 5.1), there with partial transparency.

A *span* is a part of a tile (own objects, or the proxy of a child) with the time from
when and until when it was selected, on the flight's clock.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from geopage.draw_list import DrawList, Fade
from geopage.tree import F8, U1
from tiles.forest import Rows
from tiles.kernels import kernel

OWN = np.uint8(16)
"""Bit of the own objects."""
PROXY_BITS = np.uint8(15)
"""Bit k: the proxy of child k."""


class Spans(NamedTuple):
    """Parts of tiles and when they were selected."""

    rows: Rows
    bits: U1
    """parts with the same times"""
    since_s: F8
    """-inf: so long ago that every pixel shows it"""
    until_s: F8
    """inf: still selected"""


class Transitions:
    """Remembers what was drawn a moment ago. Thread: scene manager.

    Parameters
    ----------
    seconds : duration of a fade; 0 for none
    """

    def __init__(self, seconds: float) -> None:
        self.ends_s = math.inf
        """when the last fade is over, by the clock of the steps; inf while nothing fades"""
        self._seconds = seconds
        self._spans: Spans | None = None
        self._newest: DrawList | None = None
        none = np.zeros(0, np.int32), np.zeros(0, np.uint8)
        follow(solid(*none), *none, 0.0, 0.0, 0)  # compiled before the first frame

    def blend(self, newest: DrawList, uploaded: U1, now_s: float) -> DrawList:
        """Return a list that also draws what was selected shortly before.

        Parameters
        ----------
        newest : as selected; its view's time is on the flight's clock
        uploaded : (n,) 1 where the object tile can be drawn
        now_s : by the clock of the steps; the flight's may stand still
        """
        if not self._seconds:
            return newest
        t_s, rows = newest.view.t_s, newest.objects
        bits = newest.proxies | newest.own * OWN
        last, before = self._newest or newest, self._spans or solid(rows, bits)
        self._newest = newest
        if t_s < last.view.t_s or now_s >= self.ends_s:
            stay = np.isinf(before.until_s)
            before, self.ends_s = solid(before.rows[stay], before.bits[stay]), math.inf
        spans = follow(before, rows, bits, t_s, t_s - self._seconds, len(uploaded))
        going = spans.rows[np.isfinite(spans.until_s)]
        if not uploaded[going].all():  # evicted meanwhile: better a swap than a hole
            spans = solid(rows, bits)
        self._spans = spans
        fade = Fade(spans.since_s, spans.until_s, self._seconds)
        if fade.is_over:
            self.ends_s = math.inf
            return newest
        if not draw_the_same(last, newest):
            self.ends_s = now_s + self._seconds
        own, proxies = spans.bits >= OWN, spans.bits & PROXY_BITS
        return replace(newest, objects=spans.rows, own=own, proxies=proxies, fade=fade)


def draw_the_same(a: DrawList, b: DrawList) -> bool:
    """Say whether two lists have the same objects."""
    pairs = (a.objects, b.objects), (a.own, b.own), (a.proxies, b.proxies)
    return all(np.array_equal(*pair) for pair in pairs)


def solid(rows: Rows, bits: U1) -> Spans:
    """Return spans that every pixel shows."""
    always_s = np.full(len(rows), np.inf)
    return Spans(rows, bits, -always_s, always_s)


@kernel
def follow(
    before: Spans, rows: Rows, bits: U1, t_s: float, oldest_s: float, n: int
) -> Spans:
    """Return the spans after a selection at `t_s`.

    Parameters
    ----------
    before : spans of the selection before
    rows, bits : (m,) the new selection, each row once
    oldest_s : no pixel shows what was selected until then
    n : rows of the forest
    """
    # Only what is read is written before: `n` may be much more than there are spans.
    wanted, kept, old = np.empty(n, np.uint8), np.empty(n, np.uint8), np.empty(n, np.uint8)
    for one in (before.rows, rows):
        wanted[one], kept[one], old[one] = 0, 0, 0
    wanted[rows] = bits
    room = 2 * len(before.rows) + 2 * len(rows)
    to_rows, to_bits = np.empty(room, np.int32), np.empty(room, np.uint8)
    since_s, until_s = np.full(room, -np.inf), np.full(room, np.inf)
    count = 0
    for i in range(len(before.rows)):
        row, part, from_s = before.rows[i], np.int64(before.bits[i]), before.since_s[i]
        stay, go_s = part & wanted[row], t_s
        if before.until_s[i] < np.inf:
            stay, go_s = np.int64(0), before.until_s[i]
        kept[row] |= stay
        if from_s <= oldest_s:
            old[row] |= stay
        elif stay:
            to_rows[count], to_bits[count], since_s[count] = row, stay, from_s
            count += 1
        if stay != part and from_s < go_s and go_s > oldest_s:
            to_rows[count], to_bits[count] = row, part & ~stay
            since_s[count], until_s[count] = from_s, go_s
            count += 1
    for i in range(len(rows)):
        row = rows[i]
        fresh = np.int64(bits[i]) & ~np.int64(kept[row])
        for part, from_s in ((np.int64(old[row]), -np.inf), (fresh, t_s)):
            if part:
                to_rows[count], to_bits[count], since_s[count] = row, part, from_s
                count += 1
    found = to_rows[:count].copy(), to_bits[:count].copy()
    return Spans(*found, since_s[:count].copy(), until_s[:count].copy())

# SPDX-License-Identifier: Apache-2.0
"""Cut a GeoJSON text into its features without parsing them.

The text is read in blocks, so that memory stays bounded, and brackets are counted, not
followed by recursion, so that no depth is too deep. What a feature holds is not looked
at: a broken one is found when it is parsed, and the next one is in step again.
"""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from ingest.raw_features import MAX_ITEM_BYTES
from tiles.errors import InputError
from tiles.frames import Ints
from tiles.kernels import kernel

_BLOCK_BYTES = 4 << 20
_FEATURES = re.compile(rb'"features"\s*:\s*$')
# Fields of the state between blocks. Outside means: not in the array of the features.
_INSIDE, _DEPTH, _STRING, _ESCAPED, _AT, _START, _MAY_BEGIN, _FOUND = range(8)
# Why the scan stopped.
_MORE, _FULL, _ARRAY, _CLOSED, _END, _FAULT = range(6)


@kernel
def _scan(  # noqa: C901, PLR0911, PLR0912 - one loop over bytes, each looked at once
    text: NDArray[np.uint8], state: Ints, starts: Ints, ends: Ints
) -> int:
    """Go on from state[_AT]; return why it stopped. Items found are in starts, ends."""
    state[_FOUND] = 0
    for i in range(state[_AT], len(text)):
        c = text[i]
        state[_AT] = i + 1
        if state[_STRING]:
            if state[_ESCAPED]:
                state[_ESCAPED] = 0
            elif c == 92:  # backslash
                state[_ESCAPED] = 1
            elif c == 34:  # quote
                state[_STRING] = 0
            continue
        if c in (32, 9, 10, 13):
            continue
        between = state[_INSIDE] and state[_DEPTH] == 2
        if between and state[_START] < 0 and c not in (44, 93):  # comma ]: an item begins
            if not state[_MAY_BEGIN] or c == 125:
                return _FAULT
            state[_START] = i
            state[_MAY_BEGIN] = 0
        if c == 34:
            state[_STRING] = 1
        elif c in (123, 91):  # { [
            if c == 91 and not state[_INSIDE] and state[_DEPTH] == 1:
                state[_DEPTH] = 2
                return _ARRAY
            state[_DEPTH] += 1
        elif between and c in (44, 93):  # comma ]
            if state[_START] >= 0:
                starts[state[_FOUND]], ends[state[_FOUND]] = state[_START], i
                state[_FOUND] += 1
                state[_START] = -1
            elif c == 44 and state[_MAY_BEGIN]:
                return _FAULT
            state[_MAY_BEGIN] = 1
            if c == 93:
                state[_DEPTH] = 1
                return _CLOSED
            if state[_FOUND] == len(starts):
                return _FULL
        elif c in (125, 93):  # } ]
            state[_DEPTH] -= 1
            if state[_DEPTH] == 0:
                return _END
            if state[_INSIDE] and state[_DEPTH] < 2:
                return _FAULT
    return _MORE


def split_features(path: Path, file: BinaryIO, outside: bytearray) -> Iterator[list[bytes]]:
    """Give the items of the array "features", some at a time.

    Parameters
    ----------
    path : named in errors
    file : JSON text, at its beginning
    outside : gets the text around the items. Before the first list is given it goes up
        to the array's bracket; at the end it is all of the text, with an empty array.

    Raises
    ------
    InputError
        When brackets or commas don't fit, or the text ends too early.
    """
    return _Splitter(path, file, outside).run()


class _Splitter:
    def __init__(self, path: Path, file: BinaryIO, outside: bytearray) -> None:
        self.path, self.file, self.outside = path, file, outside
        self.state = np.zeros(8, np.int64)
        self.state[_START] = -1
        self.text, self.before, self.count = b"", 0, 0

    def run(self) -> Iterator[list[bytes]]:
        starts, ends = np.empty(16384, np.int64), np.empty(16384, np.int64)
        while block := self.file.read(_BLOCK_BYTES):
            self._append(block)
            why = _FULL
            while why != _MORE:
                begin = int(self.state[_AT])
                was_inside = bool(self.state[_INSIDE])
                data = np.frombuffer(self.text, np.uint8)
                why = _scan(data, self.state, starts, ends)
                found = int(self.state[_FOUND])
                self.count += found
                if why == _FAULT:
                    raise self._fault("broken JSON")
                if not was_inside:
                    self._keep(begin, int(self.state[_AT]))
                items = zip(starts[:found].tolist(), ends[:found].tolist(), strict=True)
                if found:
                    yield [self.text[a:b] for a, b in items]
                if why == _ARRAY and self._is_of_features():
                    self.state[_INSIDE] = self.state[_MAY_BEGIN] = 1
                    yield []
                elif why == _CLOSED:
                    self.state[_INSIDE] = 0
                    self.outside += b"]"
                elif why == _END:
                    self._require_end()
                    return
        raise self._fault("JSON that ends too early")

    def _is_of_features(self) -> bool:
        end = len(self.outside) - 1  # before the bracket
        return _FEATURES.search(self.outside, max(0, end - 4096), end) is not None

    def _append(self, block: bytes) -> None:
        """Drop what is done with, keep the item that goes on, and add a block."""
        start, at = int(self.state[_START]), int(self.state[_AT])
        done = start if start >= 0 else at
        if len(self.text) - done > MAX_ITEM_BYTES:
            raise self._fault("an endless feature")
        self.text = self.text[done:] + block
        self.before += done
        self.state[_AT] = at - done
        self.state[_START] = 0 if start >= 0 else -1

    def _keep(self, begin: int, end: int) -> None:
        self.outside += self.text[begin:end]
        if len(self.outside) > MAX_ITEM_BYTES:
            raise self._fault("too much text around the features")

    def _require_end(self) -> None:
        rest = self.text[int(self.state[_AT]) :]
        while not rest.strip():
            rest = self.file.read(_BLOCK_BYTES)
            if not rest:
                return
        raise self._fault("more text after the end of the JSON")

    def _fault(self, what: str) -> InputError:
        start, at = int(self.state[_START]), int(self.state[_AT])
        byte = self.before + (start if start >= 0 else at)
        where = f"byte {byte:,}"
        if self.state[_INSIDE]:
            where = f"at feature {self.count}, {where}"
        return InputError(
            self.path,
            f"can't be read: {what} ({where})",
            "check how it was made; one feature a line reads as .geojsonl",
        )

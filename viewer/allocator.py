# SPDX-License-Identifier: Apache-2.0
"""Space in a long array, handed out first fit and merged again when given back."""

from bisect import bisect_left


class FirstFit:
    """Ranges of `size` elements; the lowest free range that is long enough is taken."""

    def __init__(self, size: int) -> None:
        self.size = size
        self._starts = [0] if size else []
        self._ends = [size] if size else []
        self.used = 0

    def take(self, count: int) -> int | None:
        """Return the start of `count` free elements, None where there is no such range."""
        for i, (start, end) in enumerate(zip(self._starts, self._ends, strict=True)):
            if end - start >= count:
                self._shorten(i, start + count)
                self.used += count
                return start
        return None

    def _shorten(self, i: int, start: int) -> None:
        if start == self._ends[i]:
            del self._starts[i], self._ends[i]
        else:
            self._starts[i] = start

    def give_back(self, start: int, count: int) -> None:
        """Free `count` elements that `take` gave at `start`."""
        if not count:
            return
        i = bisect_left(self._starts, start)
        end = start + count
        before = i > 0 and self._ends[i - 1] == start
        after = i < len(self._starts) and self._starts[i] == end
        if (i > 0 and self._ends[i - 1] > start) or (
            i < len(self._starts) and self._starts[i] < end
        ):
            raise ValueError(f"{start}..{end} is free already")
        if before and after:
            self._ends[i - 1] = self._ends[i]
            del self._starts[i], self._ends[i]
        elif before:
            self._ends[i - 1] = end
        elif after:
            self._starts[i] = start
        else:
            self._starts.insert(i, start)
            self._ends.insert(i, end)
        self.used -= count

    @property
    def free(self) -> list[tuple[int, int]]:
        """Free ranges (start, end), ascending, no two of them touching."""
        return list(zip(self._starts, self._ends, strict=True))

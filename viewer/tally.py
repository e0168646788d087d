# SPDX-License-Identifier: Apache-2.0
"""The judged pixels of several views, gathered and put in figures."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tiles.frames import Floats, Ints
from viewer.geometric_error import FrameError

PERCENTS = (50, 95, 99)
Json = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Judged:
    """One judged view."""

    pose: Json
    """lat_deg, lon_deg, height_m above the ellipsoid, heading_deg, pitch_deg"""
    frame: FrameError


@dataclass(slots=True)
class Tally:
    """All judged pixels of several views."""

    threshold_px: float
    errors: list[Floats] = field(default_factory=list)
    unlimited: list[Floats] = field(default_factory=list)
    """Of the pixels where a finer tile would exist or the leaf's bound is small"""
    moved: list[Floats] = field(default_factory=list)
    beyond: list[Floats] = field(default_factory=list)
    rows: list[Json] = field(default_factory=list)
    """One line per view"""
    counts: Ints = field(default_factory=lambda: np.zeros(6, np.int64))
    """Pixels of the earth, judged, within, limited by the leaf, beyond the threshold,
    compared for silhouettes"""
    worst: Json = field(default_factory=dict)
    _excess: float = -1.0

    def add(self, judged: Judged) -> None:
        """Take one view in."""
        frame = judged.frame
        at = np.isfinite(frame.error_px)
        error, leaf = frame.error_px[at], frame.leaf_px[at]
        within = frame.excess[at] <= 1.0
        parts = (
            frame.earth.sum(),
            at.sum(),
            within.sum(),
            (leaf > self.threshold_px).sum(),
            (error > self.threshold_px).sum(),
            frame.silhouette.compared,
        )
        self.counts += np.array(parts, np.int64)
        self.errors.append(error.astype(np.float32))
        self.unlimited.append(error[leaf <= self.threshold_px].astype(np.float32))
        self.moved.append(frame.silhouette.moved_px)
        self.beyond.append(frame.silhouette.beyond_px)
        row = {**judged.pose, "judged": len(error)}
        if len(error):
            row |= {**_percentiles(error), "share_within_threshold": within.mean()}
            self._note_worst(judged)
        self.rows.append(row)

    def _note_worst(self, judged: Judged) -> None:
        frame = judged.frame
        row, col = np.unravel_index(int(frame.excess.argmax()), frame.excess.shape)
        excess, limit_px = float(frame.excess[row, col]), float(frame.limit_px[row, col])
        if excess > self._excess:
            self._excess = excess
            pixel = {"limit_px": limit_px, "pixel": [int(col), int(row)]}
            self.worst = {**judged.pose, "error_px": excess * limit_px, **pixel}

    def figures(self) -> Json:
        """Return everything in figures; what was not measured is absent."""
        earth, judged, within, leaf, beyond, compared = self.counts.tolist()
        error = np.concatenate([np.zeros(0, np.float32), *self.errors])
        found: Json = {"threshold_px": self.threshold_px, "pixels_judged": judged}
        if earth:
            found["share_not_judged"] = 1.0 - judged / earth
        if judged:
            found = {**_percentiles(error), **found}
            found["share_within_threshold"] = within / judged
            found["share_limited_by_leaf"] = leaf / judged
            found["share_beyond_threshold"] = beyond / judged
            found["worst_view"] = self.worst
            unlimited = np.concatenate(self.unlimited)
            if len(unlimited):
                found["where_no_leaf_limits"] = _percentiles(unlimited)
        raised = [row for row in self.rows if "raised_threshold_px" in row]
        if raised:
            found["views_with_raised_threshold"] = len(raised)
        if compared:
            moved, beyond = np.concatenate(self.moved), np.concatenate(self.beyond)
            found["silhouette"] = {
                "pixels_compared": compared,
                "share_displaced": len(moved) / compared,
                "share_beyond_limit": len(beyond) / compared,
                "max_beyond_limit_px": float(beyond.max(initial=0.0)),
            }
        return found


def _percentiles(error: Any) -> Json:
    values = np.percentile(error, PERCENTS).tolist()
    named = {f"p{p}": value for p, value in zip(PERCENTS, values, strict=True)}
    return {**named, "max": float(error.max())}

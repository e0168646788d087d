# SPDX-License-Identifier: Apache-2.0
"""Names of curves at the side of a panel, moved apart, each with a line to its curve."""

from collections.abc import Sequence
from typing import Any, NamedTuple


class Label(NamedTuple):
    """The name of a curve."""

    name: str
    colour: str
    point: tuple[float, float]
    """of the curve, where the line ends"""
    weight: str = "normal"


def name_curves(
    axes: Any,
    labels: Sequence[Label],
    step: float,
    x: float,
    top: float = 1.0,
    size: int = 9,
) -> None:
    """Write names under each other; the axes' limits must be what they will be.

    Parameters
    ----------
    step, x, top : least distance of two names, their left end and the highest, shares of
        the axes' height and width
    """
    to_axes = axes.transData + axes.transAxes.inverted()
    placed = sorted((float(to_axes.transform(one.point)[1]), one) for one in labels)
    heights = apart([height for height, _ in placed], step, top)
    for height, (_, one) in zip(heights, placed, strict=True):
        axes.annotate(
            one.name,
            one.point,
            xytext=(x, height),
            textcoords="axes fraction",
            color=one.colour,
            fontsize=size,
            fontweight=one.weight,
            va="center",
            annotation_clip=False,
            arrowprops={"arrowstyle": "-", "color": one.colour, "lw": 0.5, "alpha": 0.6},
        )


def apart(heights: Sequence[float], step: float, top: float = 1.0) -> list[float]:
    """Return ascending heights moved as little as need be, at least `step` apart.

    They stay in 0..top as long as there is room for them.
    """
    limit = max(top, step * (len(heights) - 1))
    found = list(heights)
    for i in range(1, len(found)):
        found[i] = max(found[i], found[i - 1] + step)
    for i in range(len(found) - 1, -1, -1):
        found[i] = min(found[i], limit)
        limit = found[i] - step
    return found

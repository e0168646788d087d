# SPDX-License-Identifier: Apache-2.0
"""The chart of `geopage accuracy`: how many pixels err by more than so much."""

from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from viewer.charts import COLOURS, pyplot, save
from viewer.tally import Tally

SIZE, POINTS = (7.2, 4.2), 400
LEAST_PX, LEAST_SHARE = 0.02, 1e-6


def accuracy_chart(tallies: Sequence[Tally], out: Path) -> bool:
    """Draw a curve a threshold, of the pixels where no leaf's bound is above it.

    Returns
    -------
    False where there is nothing to draw, or no matplotlib (the extra `report`)
    """
    known = [tally for tally in tallies if any(map(len, tally.unlimited))]
    if not known or find_spec("matplotlib") is None:
        return False
    plt = pyplot(out)
    figure, axes = plt.subplots(figsize=SIZE)
    for i, tally in enumerate(known):
        error = np.sort(np.concatenate(tally.unlimited))
        colour, px = COLOURS[i % len(COLOURS)], tally.threshold_px
        # Evenly in the logarithm of the share that errs more, down to the worst pixel.
        share = np.geomspace(1.0, 1.0 / len(error), POINTS)
        value = error[np.minimum((len(error) * (1 - share)).astype(int), len(error) - 1)]
        axes.step(value, share, where="post", color=colour, label=f"threshold {px:g} px")
        axes.axvline(px, color=colour, lw=1, ls=":")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlim(LEAST_PX, 2 * max(tally.threshold_px for tally in known))
    axes.set_ylim(LEAST_SHARE, 1.0)
    ticks = sorted({LEAST_PX, 0.1, 0.3, *(tally.threshold_px for tally in known)})
    axes.set_xticks(ticks, [f"{px:g}" for px in ticks])
    axes.minorticks_off()
    axes.set_title("Pixels where no leaf's bound is above the threshold", loc="left")
    axes.set_xlabel("geometric error, px (dotted: the threshold)")
    axes.set_ylabel("share of pixels that err by more")
    axes.legend(frameon=False, loc="lower left")
    figure.tight_layout()
    save(figure, out)
    plt.close(figure)
    return True

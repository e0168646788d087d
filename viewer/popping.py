# SPDX-License-Identifier: Apache-2.0
"""Popping: how much more a picture changes from frame to frame than it should.

When the eye moves, every picture changes. What pops is what changes although the
reference, drawn for the same two views, does not: a tile or an object that was
exchanged for another. Changes are FLIP's, so they count as a person sees them.
"""

import numpy as np

from viewer.flip import F4


def popping(change: F4, reference_change: F4) -> float:
    """Return the mean over all pixels of the change beyond the reference's own.

    Parameters
    ----------
    change, reference_change : (h, w) FLIP from one frame to the next, of what was drawn
        and of the reference for the same two views

    Returns
    -------
    0, no pixel changes more than the reference's, to 1
    """
    return float(np.maximum(change - reference_change, 0.0).mean())

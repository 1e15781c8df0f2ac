"""Treatment of proposals that lie beyond a parameter's bound: reflection or redrawing."""

from __future__ import annotations

import numpy as np

from formats.arrays import Floats


def reflect(values: Floats, low: Floats, high: Floats) -> Floats:
    """Return values reflected at the bounds until they lie within them, each (parameters,)."""
    span = high - low
    folded = np.mod(values - low, 2 * span)
    return np.minimum(low + np.minimum(folded, 2 * span - folded), high)


def redraw(centre: Floats, uniform: Floats, spread: Floats, low: Floats, high: Floats) -> Floats:
    """Return Cauchy steps from the centre as if redrawn until inside, from one uniform number in [0, 1) each.

    The inverse of the Cauchy distribution function, restricted to its part between the bounds; each
    (parameters,).
    """
    below = np.arctan((low - centre) / spread) / np.pi
    above = np.arctan((high - centre) / spread) / np.pi
    return np.clip(centre + spread * np.tan(np.pi * (below + uniform * (above - below))), low, high)

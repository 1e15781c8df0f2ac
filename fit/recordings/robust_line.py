"""Robust linear regression over frames, with 90 % intervals that allow for correlated frames and outliers.

Outliers count less (Huber's weights). Intervals are jackknives over half seconds, because the errors of one swing's
frames are correlated. Source: P. J. Huber, "Robust Statistics" (1981), section 7; R. G. Miller, Biometrika 61 (1974).
"""

from __future__ import annotations

import numpy as np

from formats.arrays import Floats, Integers
from formats.sights import half_seconds

FEWEST_BLOCKS_ON_A_LINE = 8  # half seconds; our choice: a jackknife with 7 degrees of freedom
HUBER = 1.345  # deviations from which a frame counts less: 95 % efficiency for normal noise
REWEIGHTINGS = 20  # our choice: a fixed number, in place of a tolerance


def seconds_apart(time: Floats) -> Integers:
    """Return the number of each frame's half second, (frames,), counted from the first frame; time [s], (frames,)."""
    return half_seconds(time - time[0])


def robust_line(design: Floats, values: Floats, block: Integers) -> tuple[Floats, Floats]:
    """Return coefficients and half their 90 % intervals, (columns,) each.

    design, (frames, columns); values, (frames,); block, (frames,): half second of each frame
    """
    from scipy.special import stdtrit

    weight = np.ones(len(values))
    for _ in range(REWEIGHTINGS):
        left = values - design @ _solved(design, values, weight)
        spread = 1.4826 * float(np.median(np.abs(left - np.median(left))))
        weight = np.minimum(1.0, HUBER * max(spread, 1e-6) / np.maximum(np.abs(left), 1e-12))
    names = np.unique(block)
    without = np.stack([_solved(design[block != b], values[block != b], weight[block != b]) for b in names])
    count = len(names)
    sd = np.sqrt((count - 1) / count * ((without - without.mean(0)) ** 2).sum(0))
    return _solved(design, values, weight), np.asarray(float(stdtrit(count - 1, 0.95)) * sd)


def interval_of(middle: float, half: float) -> tuple[float, float]:
    """Return the interval of a value from half its width."""
    return float(middle - half), float(middle + half)


def _solved(design: Floats, values: Floats, weight: Floats) -> Floats:
    root = np.sqrt(weight)
    return np.asarray(np.linalg.lstsq(design * root[:, None], values * root, rcond=None)[0])

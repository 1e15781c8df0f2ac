"""Effective number of independent residuals of a recording, from their correlation in time and between points.

Residuals r_i(t) of K series, one a point and axis, vary over T frames. Let A_ij(l) be the sum of r_i(t) r_j(t + l) over
the P_ij(l) pairs of frames that lie l apart and are seen. A sum of correlated squares varies as much as one of N
independent squares:

    N = (sum_i A_ii(0))^2 / sum_l sum_ij A_ij(l)^2 / P_ij(l)

Uncorrelated series leave a sum over i and j of about (sum_i variance_i)^2 at each lag by chance. This amount is
subtracted at lag 0. Another lag counts where it exceeds twice this amount. In white noise the sum is spread as chi
square of k^2 degrees of freedom over k^2,

    k = (sum_i variance_i)^2 / sum_i variance_i^2

So it exceeds twice the chance often where k is small, as of one point. A lag must then have more than white noise has
at one lag of a thousand. White noise counts whole within a tenth, with gaps as well.

Errors of a model-form error last for a swing or more, swing to and fro, and move all points. One take is too short to
tell how many points move apart for so long. Chance alone then fills the sum, and the take counts by its frames rather
than by its points. Series that are correlated and move apart therefore count too little: of nine with a correlation of
0.5 from frame to frame a quarter counts. One common sine counts as two numbers, its sine and its cosine.

Source: G. E. P. Box, "Some theorems on quadratic forms applied in the study of analysis of variance problems, I",
Annals of Mathematical Statistics 25 (1954), theorem 3.1.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from formats.arrays import Floats

BY_CHANCE = 2.0  # times what chance leaves at a lag; among the axes of three points one lag in a million exceeds it
RARE = 1e-3  # share of the lags of white noise that count all the same, where fewer series make more exceed BY_CHANCE


def independent(takes: Sequence[Floats]) -> float:
    """Return the effective number N of independent residuals, summed over the takes.

    takes: of each (frames, ...), nan where nothing is seen
    """
    rows = [take.reshape(len(take), -1) for take in takes]
    return sum(_independent(take[:, np.isfinite(take).any(0)]) for take in rows)


def _independent(take: Floats) -> float:
    """Return N of one take, (frames, series), every series seen somewhere."""
    is_seen = np.isfinite(take)
    count, whole = float(is_seen.sum()), np.where(is_seen, take, 0.0)
    total = float((whole**2).sum())
    if total == 0.0:
        return count
    variances = (whole**2).sum(0) / is_seen.sum(0)
    squares, chance = _at_lags(whole, is_seen.astype(float), variances)
    counts = squares[1:] > _exceeded(variances) * chance[1:]
    together = squares[0] - chance[0] + 2 * float(squares[1:][counts].sum())
    return min(total**2 / together, count) if together > 0 else count


def _at_lags(whole: Floats, seen: Floats, variances: Floats) -> tuple[Floats, Floats]:
    """Return sum_ij A_ij(l)^2 / P_ij(l) at each lag l, (frames,), and its expected value by chance, (frames,).

    - `whole`, (frames, series), 0 where nothing is seen
    - `seen`, (frames, series), 1 where something is seen
    - `variances`, (series,)
    """
    frames, series = whole.shape
    length = 2 ** math.ceil(math.log2(2 * frames))  # no lag wraps around
    squares, chance = np.zeros(frames), np.zeros(frames)
    spectra = [np.fft.rfft(numbers, length, axis=0) for numbers in (whole, seen)]
    for one in range(series):
        found, pairs = (np.fft.irfft(s[:, [one]].conj() * s, length, axis=0)[:frames] for s in spectra)
        has_pairs = pairs > 0.5  # whole numbers except for rounding errors
        squares += np.where(has_pairs, found**2 / np.maximum(pairs, 0.5), 0.0).sum(1)
        chance += variances[one] * (has_pairs @ variances)
    return squares, chance


def _exceeded(variances: Floats) -> float:
    """Return the factor by which a lag must exceed chance to count, from the variance of each series, (series,)."""
    from scipy.special import chdtri

    freedom = float(variances.sum() ** 2 / (variances**2).sum()) ** 2
    return max(BY_CHANCE, float(chdtri(freedom, RARE) / freedom))

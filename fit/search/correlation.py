"""The number of independent residuals of a recording: how many there are, less those that err together.

Residuals r_i(t) of K series, one a point and axis, vary over T frames. Let A_ij(l) be the sum of r_i(t) r_j(t + l) over
the P pairs of frames that lie l apart. A sum of correlated squares varies as much as one of N independent squares:

    N = (sum_i A_ii(0))^2 / sum_l sum_ij A_ij(l)^2 / P

Series without anything in common leave a sum over i and j of about (sum_i variance_i)^2 at each lag by chance. This
much is taken off at lag 0. Another lag counts where it has more than twice as much. So white noise counts whole.

Errors of a model-form error last for a swing or more, swing to and fro, and move all points. One take is too short to
tell how many points move apart for so long. Chance alone then fills the sum, and the take counts by its frames rather
than by its points.

Source: G. E. P. Box, "Some theorems on quadratic forms applied in the study of analysis of variance problems, I",
Annals of Mathematical Statistics 25 (1954), theorem 3.1.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from formats.arrays import Floats

BY_CHANCE = 2.0  # times what chance leaves at a lag; among the axes of three points one lag in a million exceeds it


def independent(takes: Sequence[Floats]) -> float:
    """Return how many of residuals are independent: N, summed over the takes.

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
    frames, series = take.shape
    at_once = is_seen.sum(1).astype(float)
    pairs = np.correlate(at_once, at_once, "full")[frames - 1 :] / series**2
    chance = float(((whole**2).sum(0) / is_seen.sum(0)).sum()) ** 2
    has_pairs = pairs > 0
    squares = _squares(whole)[has_pairs] / pairs[has_pairs]
    later = squares[1:]
    together = squares[0] - chance + 2 * float(later[later > BY_CHANCE * chance].sum())
    return min(total**2 / together, count) if together > 0 else count


def _squares(whole: Floats) -> Floats:
    """Return sum_ij A_ij(l)^2 at each lag l, (frames,), of a take without gaps, (frames, series).

    It is the sum over t and u of G(t, u) G(t + l, u + l), with G(t, u) = sum_i r_i(t) r_i(u). Each diagonal of G is
    correlated with itself, by its spectrum.
    """
    frames = len(whole)
    alike = whole @ whole.T
    length = 2 ** math.ceil(math.log2(2 * frames))
    power = np.zeros(length // 2 + 1)
    for apart in range(frames):
        spectrum = np.fft.rfft(np.diagonal(alike, apart), length)
        power += (1 if apart == 0 else 2) * (spectrum.real**2 + spectrum.imag**2)
    return np.asarray(np.fft.irfft(power, length)[:frames])

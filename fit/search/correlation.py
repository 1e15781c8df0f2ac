"""The number of independent residuals of a recording: their count over the time that errors stay correlated.

The integrated autocorrelation time tau of residuals r is in frames. The correlation over k frames is rho_k, taken about
zero, since a remaining mean is an error as well. All points and axes of a take count together:

    tau = 1 + 2 sum_k rho_k,    N = n / tau

The sum ends before the first pair rho_2j + rho_2j+1 that is not positive (Geyer's initial positive sequence). Beyond
that pair little but noise is left. tau is at least 1. White noise has tau = 1, so every number counts. A model-form
error lasts for a swing or more, so such a take counts little.

Source: C. J. Geyer, "Practical Markov chain Monte Carlo", Statistical Science 7 (1992), section 3.3.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from formats.arrays import Floats


def independent(takes: Sequence[Floats]) -> float:
    """Return how many of residuals are independent: N, summed over the takes.

    takes: of each (frames, ...), nan where nothing is seen
    """
    count = 0.0
    for take in takes:
        rows = take.reshape(len(take), -1).T
        seen = np.flatnonzero(np.isfinite(rows).any(0))
        if len(seen):
            count += np.isfinite(rows).sum() / correlation_time(rows[:, seen[0] : seen[-1] + 1])
    return count


def correlation_time(rows: Floats) -> float:
    """Return tau [frames] of series, (series, frames), where nan is not seen."""
    is_seen = np.isfinite(rows)
    whole = np.where(is_seen, rows, 0.0)
    frames = rows.shape[1]

    def covariance(lag: int) -> float:
        pairs = (is_seen[:, : frames - lag] & is_seen[:, lag:]).sum()
        return float((whole[:, : frames - lag] * whole[:, lag:]).sum()) / pairs if pairs else 0.0

    variance = covariance(0)
    if variance == 0.0:
        return 1.0
    total = 0.0
    for lag in range(0, frames // 2, 2):
        pair = (covariance(lag) + covariance(lag + 1)) / variance
        if pair <= 0:
            break
        total += pair
    return max(2 * total - 1, 1.0)

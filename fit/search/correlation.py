"""How many of a recording's residuals are independent: their number over the time that errors go together.

The integrated autocorrelation time of residuals r, in frames, with rho_k their correlation over k frames about nothing
(a mean that is left is an error as well), pooled over the points and axes of a take,

    tau = 1 + 2 sum_k rho_k,    N = n / tau

The sum ends before the first pair rho_2j + rho_2j+1 that is not positive (Geyer's initial positive sequence), where
little but noise is left; tau is at least 1. White noise has tau = 1 and makes every number count; what a model cannot
follow lasts for a swing and more, and makes a take count little.

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

"""Autocorrelation of a model's errors in time, and the resulting correlation of half-second block sums.

The error of a wrong model swings with the cloth: its residual is a damped oscillation plus white noise, with the
autocorrelation

    rho(t) = a exp(-|t| / T) cos(2 pi f t),   t != 0,

fitted by least squares to the residual's own, pooled over points and takes. Squares and products of two residuals of
this kind are correlated as rho^2. Their sums over blocks b and b' of one take are correlated as

    K_bb' = w k(b - b') / k(0),   k(m) = sum of exp(-2 |t - t'| / T) cos^2(2 pi f (t - t')) over t in 0, t' in m

and K_bb = 1. The share w of the oscillation in the variance of a block's sum follows from a. Coherent errors have about
FREE_DIRECTIONS degrees of freedom in space. White noise has as many as a frame has numbers. Blocks of different takes,
and means over a take, are independent. Blocks of weights w count as n_eff = (sum of w)^2 / (w' K w) independent ones.
Sources: M. S. Bartlett, J. Royal Stat. Soc. Suppl. 8 (1946) (variance of quadratic sums of a correlated series);
G. E. P. Box & G. M. Jenkins, "Time Series Analysis" (1976), section 3.2 (autocorrelation of a damped oscillator).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fit.observer.residuals import Layout, Observer
from fit.observer.simulation_error import FREE_DIRECTIONS
from formats.arrays import Floats
from formats.sights import BLOCK_SECONDS

LONGEST_LAG = 3.0  # s: a take of a few seconds shows no autocorrelation beyond this lag
# s, of the oscillations tried, each a sixth longer; our choice: from one period at 10 Hz to beyond `LONGEST_LAG`.
DECAYS = np.geomspace(0.1, 4.0, 24)
# Instants per block in the sum of the correlation. Our choice: 42 ms apart, four to a period of the squared cosine at
# the fastest tried frequency. Half would be two, the least there is; twice costs four times the sum.
SAMPLES_A_BLOCK = 12
TRIED_FREQUENCIES = np.arange(0.0, 3.01, 0.1)  # Hz, of the oscillations tried: hanging cloth swings below 2 Hz


@dataclass(frozen=True)
class Ringing:
    """A damped oscillation: decay time [s], frequency [Hz], and its share of the variance of block sums, 0 to 1."""

    decay: float
    hertz: float
    share: float

    def between_blocks(self, count: int) -> Floats:
        """Return the correlation of the sums over blocks 0, 1, 2, ... of one take with the first sum, (count,)."""
        within = (np.arange(SAMPLES_A_BLOCK) + 0.5) * BLOCK_SECONDS / SAMPLES_A_BLOCK
        apart = BLOCK_SECONDS * np.arange(count)[:, None, None] + within[:, None] - within
        summed = (np.exp(-2 * np.abs(apart) / self.decay) * np.cos(2 * np.pi * self.hertz * apart) ** 2).sum((1, 2))
        return np.append(1.0, self.share * summed[1:] / summed[0])


NO_RINGING = Ringing(decay=float(DECAYS[0]), hertz=0.0, share=0.0)


def autocorrelation(grids: list[Floats], lags: int) -> Floats:
    """Return the autocorrelation at 0, 1, 2, ... frames, (lags,), of takes, (frames, points, 3), nan where unseen."""
    products, counts = np.zeros(lags), np.zeros(lags)
    for grid in grids:
        seen = np.isfinite(grid).reshape(len(grid), -1)
        values = np.where(seen, grid.reshape(len(grid), -1), 0.0)
        shown = min(lags, len(grid))
        for found, columns in ((products, values), (counts, seen.astype(float))):
            # Padding to twice the length prevents a wrap-around of the series (Wiener-Khinchin).
            power = (np.abs(np.fft.rfft(columns, 2 * len(grid), axis=0)) ** 2).sum(1)
            found[:shown] += np.fft.irfft(power, 2 * len(grid))[:shown]
    covariance = products / np.maximum(np.round(counts), 1.0)
    return np.asarray(covariance / max(float(covariance[0]), 1e-30))


def ringing_of(grids: list[Floats], rate: float) -> Ringing:
    """Fit a damped oscillation to a residual's autocorrelation.

    grids: the residual of each take, (frames, points, 3), nan where unseen; rate: frames per second
    """
    longest = max(len(grid) for grid in grids) // 2
    lags = min(int(LONGEST_LAG * rate), longest) + 1
    if lags < 3:
        return NO_RINGING
    seen = autocorrelation(grids, lags)[1:]
    time = np.arange(1, lags) / rate
    curves = np.exp(-time / DECAYS[:, None, None]) * np.cos(2 * np.pi * TRIED_FREQUENCIES[:, None] * time)
    size = np.clip((curves @ seen) / (curves**2).sum(-1), 0.0, 1.0)
    misfit = ((seen - size[..., None] * curves) ** 2).sum(-1)
    best = np.unravel_index(int(misfit.argmin()), misfit.shape)
    decay, hertz, coherent = float(DECAYS[best[0]]), float(TRIED_FREQUENCIES[best[1]]), float(size[best])
    lasting = decay / 2 * (1 + 1 / (1 + (2 * np.pi * hertz * decay) ** 2))  # s, the integral of (rho / a)^2
    numbers = np.mean([np.isfinite(grid).sum() / len(grid) for grid in grids])
    weight = coherent**2 * max(float(numbers) / FREE_DIRECTIONS, 1.0) * max(lasting * rate, 1.0)
    return Ringing(decay, hertz, share=weight / (weight + 1.0 - coherent**2))


def block_correlation(layout: Layout, ringing: Ringing) -> Floats:
    """Return the correlation of sums over the blocks of a residual's layout, (blocks, blocks)."""
    count = int(layout.block.max()) + 1
    place, take = np.arange(count), np.full(count, -1)
    moving = layout.is_judged
    take[layout.block[moving]] = layout.take[moving]
    by_lag = ringing.between_blocks(count)
    is_same = (take[:, None] == take) & (take >= 0)
    return np.where(is_same | np.eye(count, dtype=bool), by_lag[np.abs(place[:, None] - place)], 0.0)


def correlation_of(observer: Observer, residual: Floats) -> Floats:
    """Return the correlation of block sums, (blocks, blocks), that a residual, (numbers,), of the takes shows."""
    recordings = observer.recordings
    rate = float(np.median([(len(r.time) - 1) / r.duration for r in recordings]))
    grids = observer.by_place(residual[observer.layout.is_judged])
    return block_correlation(observer.layout, ringing_of(grids, rate))


def effective_count(correlation: Floats, weights: Floats) -> float:
    """Return the effective number of independent blocks for correlated blocks of these weights, (blocks,)."""
    return float(weights.sum()) ** 2 / max(float(weights @ correlation @ weights), 1e-30)

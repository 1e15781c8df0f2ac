"""How far the gap shrinks: error with and without an effect on motion that was not used to fit it.

    closure = (E_base^2 - E_effect^2) / (E_base^2 - floor^2)

with mean squared errors on the same frames. Intervals by bootstrap over blocks of half a second, both models' errors
drawn together. Where the base error is hardly above the floor the ratio means nothing and is not given.
Source: B. Efron & R. Tibshirani, "An Introduction to the Bootstrap" (1993), chapters 8 and 13.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.gap.observer import Observer

Floats = NDArray[np.float64]

REPLICAS = 1000
SMALLEST_GAP = 0.05  # of the squared floor; below, closure is not defined


@dataclass(frozen=True)
class BlockErrors:
    """Squared error per block of half a second [mm^2 per point, summed] and how many points it has."""

    sums: Floats
    counts: Floats

    @property
    def squared_mm(self) -> float:
        """Mean squared distance [mm^2]."""
        return float(self.sums.sum() / self.counts.sum())

    def draw(self, picks: NDArray[np.int64]) -> Floats:
        """Mean squared distance of bootstrap draws, (replicas,)."""
        return np.asarray(self.sums[picks].sum(1) / self.counts[picks].sum(1))


def block_errors(observer: Observer, residual: Floats) -> BlockErrors:
    """Gather a whitened residual, (numbers,), into blocks."""
    block = observer.layout.moving(observer.layout.block)
    squared = (1e3 * observer.layout.metres(residual)) ** 2
    count = np.bincount(block) / 3.0
    sums = np.asarray(np.bincount(block, squared), float)
    seen = count > 0
    return BlockErrors(sums[seen], count[seen])


def bootstrap_picks(errors: BlockErrors, rng: np.random.Generator) -> NDArray[np.int64]:
    """Blocks of every bootstrap draw, (replicas, blocks)."""
    blocks = len(errors.sums)
    return np.asarray(rng.integers(0, blocks, size=(REPLICAS, blocks)))


def closure(
    base: BlockErrors, with_effect: BlockErrors, floor_mm: float, picks: NDArray[np.int64]
) -> tuple[float, tuple[float, float]] | None:
    """Return closure and its 90 % interval, or None where there is hardly a gap."""
    gap = base.squared_mm - floor_mm**2
    if gap < SMALLEST_GAP * max(floor_mm**2, 1e-6):
        return None
    value = (base.squared_mm - with_effect.squared_mm) / gap
    drawn_gap = np.maximum(base.draw(picks) - floor_mm**2, 0.25 * gap)
    drawn = (base.draw(picks) - with_effect.draw(picks)) / drawn_gap
    low, high = np.quantile(drawn, [0.05, 0.95])
    return float(value), (float(low), float(high))


def error_interval(errors: BlockErrors, picks: NDArray[np.int64]) -> tuple[float, float]:
    """90 % interval of the root mean square error [mm]."""
    low, high = np.quantile(np.sqrt(errors.draw(picks)), [0.05, 0.95])
    return float(low), float(high)

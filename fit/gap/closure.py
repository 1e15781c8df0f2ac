"""How far the gap shrinks: error with and without an effect on motion that was not used to fit it.

    closure = (E_base^2 - E_effect^2) / (E_base^2 - floor^2)

with mean squared errors on the same frames. Intervals by bootstrap over blocks of half a second, both models' errors
drawn together. Where the base error is hardly above the floor the ratio means nothing and is not given.
Source: B. Efron & R. Tibshirani, "An Introduction to the Bootstrap" (1993), chapters 8 and 13.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fit.observer.edge import EdgeErrors
from fit.observer.residuals import Observer
from formats.arrays import Floats

REPLICAS = 1000
TIE = 1e-9  # of a sum, within which two of them are the same
FLIPS = 20000  # draws of the signs of differences
DIRECTIONS = 9  # in which mesh and solver err independently; amplitudes fitted to takes without any effect say so
SIGNIFICANT_GAP = 1.2  # base error over floor, squared: below, there is nothing to explain
SMALLEST_GAP = 0.05  # of the squared floor; below, closure is not defined


@dataclass(frozen=True)
class BlockErrors:
    """Squared error per block of half a second [mm^2 per point, summed] and how many points it has.

    residual [mm], (numbers,): the errors themselves; edge: what is left at the held edges
    """

    sums: Floats
    counts: Floats
    residual: Floats
    edge: EdgeErrors = field(default_factory=EdgeErrors)

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
    millimetres = 1e3 * observer.layout.metres(residual)
    squared = millimetres**2
    count = np.bincount(block) / 3.0
    sums = np.asarray(np.bincount(block, squared), float)
    seen = count > 0
    return BlockErrors(sums[seen], count[seen], millimetres, observer.edge_errors(residual))


def bootstrap_picks(errors: BlockErrors, rng: np.random.Generator) -> NDArray[np.int64]:
    """Blocks of every bootstrap draw, (replicas, blocks)."""
    blocks = len(errors.sums)
    return np.asarray(rng.integers(0, blocks, size=(REPLICAS, blocks)))


def solver_draws(errors: list[BlockErrors], numerics_mm: float, replicas: int) -> Floats:
    """By how much mesh and solver may have moved each mean squared error, (replicas, errors) [mm^2].

    An error d of the simulation, of mean squared size N^2 and of a random direction among DIRECTIONS that a smooth
    motion has, adds 2 d.r to the squared residual r. Over hypotheses these are normal with covariance
    4 N^2 / DIRECTIONS <r_h r_k>: two hypotheses that leave nearly the same residual are moved together.
    """
    residuals = np.stack([e.residual for e in errors])
    gram = residuals @ residuals.T / (residuals.shape[1] / 3.0)
    values, vectors = np.linalg.eigh(gram)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    normal = np.random.default_rng(0).standard_normal((replicas, len(errors)))
    return np.asarray(2.0 * numerics_mm / np.sqrt(DIRECTIONS) * normal @ root.T)


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


def gain_p_value(before: BlockErrors, after: BlockErrors) -> float:
    """p-value of one model's leaving less than another in half-seconds that neither was fitted to.

    If both were as good, each half-second's difference would be as likely to have the other sign: signs are drawn at
    random.
    Source: R. A. Fisher, "The Design of Experiments" (1935), section 21.
    """
    gains = before.sums - after.sums
    signs = np.random.default_rng(0).choice([-1.0, 1.0], size=(FLIPS, len(gains)))
    # A draw of the very signs that were seen is a tie, however the sums round.
    return float((1 + np.sum(signs @ gains >= gains.sum() - TIE * np.abs(gains).sum())) / (1 + FLIPS))


def exceeds(errors: BlockErrors, picks: NDArray[np.int64], known: float) -> bool:
    """Whether a squared error is clearly above a known one [mm^2]."""
    lowest = error_interval(errors, picks)[0]
    return bool(errors.squared_mm > SIGNIFICANT_GAP * known and lowest**2 > known)


def error_interval(errors: BlockErrors, picks: NDArray[np.int64]) -> tuple[float, float]:
    """90 % interval of the root mean square error [mm]."""
    low, high = np.quantile(np.sqrt(errors.draw(picks)), [0.05, 0.95])
    return float(low), float(high)

"""Closure, the share of the gap that an effect removes on motion that was not used to fit it.

    closure = (E_base^2 - E_effect^2) / (E_base^2 - floor^2)

with mean squared errors on the same frames. Intervals come from a bootstrap over blocks of half a second, the errors of
both models drawn together. Half-seconds of one take are correlated (`fit.gap.correlation`) and few: the ratio of each
draw to the mean is raised to the power

    sqrt(n / (n - 1)) sqrt(n / n_eff) t(n_eff - 1) / z,   t, z: 95 % quantiles of Student's and the normal distribution

With this power, 90 % intervals of a damped oscillation at 0.8 Hz hold the truth as often as a test requires. Each draw
has its own floor. If the base error is hardly above the floor, the ratio means nothing and is not given.
Source: B. Efron & R. Tibshirani, "An Introduction to the Bootstrap" (1993), chapters 8, 12.5 and 13.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm
from scipy.stats import t as student

from fit.gap.correlation import DIRECTIONS, correlation_of, decorrelated, effective_count
from fit.observer.edge import EdgeErrors
from fit.observer.residuals import Observer
from formats.arrays import Floats

REPLICAS = 1000
TIE = 1e-9  # of a sum, within which two of them are the same
FLIPS = 20000  # draws of the signs of differences
SIGNIFICANT_GAP = 1.2  # base error over floor, squared: below, there is nothing to explain
SMALLEST_GAP = 0.05  # of the squared floor; below, closure is not defined
LEAST_GAP = 0.25  # of the gap, that is left of it in a draw at least
FEWEST = 3.0  # least count of independent blocks: two degrees of freedom; the spread of fewer is unknown


@dataclass(frozen=True)
class BlockErrors:
    """Squared error per block of half a second [mm^2 per point, summed] and how many points it has.

    - `residual` [mm], (numbers,): the errors themselves
    - `edge`: the remaining errors at the held edges
    - `correlation`, (blocks, blocks): of the sums of the blocks; None if they are independent
    """

    sums: Floats
    counts: Floats
    residual: Floats
    edge: EdgeErrors = field(default_factory=EdgeErrors)
    correlation: Floats | None = None

    @property
    def squared_mm(self) -> float:
        """Mean squared distance [mm^2]."""
        return float(self.sums.sum() / self.counts.sum())

    @property
    def between_blocks(self) -> Floats:
        """Correlation of the sums of the blocks, (blocks, blocks)."""
        return np.eye(len(self.sums)) if self.correlation is None else self.correlation

    def draw(self, resampling: Resampling) -> Floats:
        """Mean squared distance of bootstrap draws, (replicas,)."""
        picks, middle = resampling.picks, self.squared_mm
        drawn = self.sums[picks].sum(1) / self.counts[picks].sum(1)
        return np.asarray(middle * (drawn / max(middle, 1e-30)) ** resampling.spread)


@dataclass(frozen=True)
class Resampling:
    """Bootstrap draws, the same for every model: of blocks, (replicas, blocks), and of the floor's error.

    - `spread`: a draw's distance from the mean over the bootstrap's, in logarithms, since errors are positive
    - `deviates`, (replicas,): of the floor, in its standard errors
    """

    picks: NDArray[np.int64]
    spread: float
    deviates: Floats


def block_errors(observer: Observer, residual: Floats) -> BlockErrors:
    """Gather a whitened residual, (numbers,), into blocks."""
    block = observer.layout.moving(observer.layout.block)
    millimetres = 1e3 * observer.layout.metres(residual)
    squared = millimetres**2
    count = np.bincount(block) / 3.0
    sums = np.asarray(np.bincount(block, squared), float)
    seen = np.flatnonzero(count > 0)
    correlation = correlation_of(observer, residual)[np.ix_(seen, seen)]
    return BlockErrors(sums[seen], count[seen], millimetres, observer.edge_errors(residual), correlation)


def resample(errors: BlockErrors, rng: np.random.Generator, floor_replicas: int) -> Resampling:
    """Draw blocks, as correlated as a model's errors show, and errors of a floor that is the mean of some replicas."""
    blocks = len(errors.sums)
    effective = max(effective_count(errors.between_blocks), FEWEST)
    wider = float(student.ppf(0.95, effective - 1) / norm.ppf(0.95))
    spread = wider * float(np.sqrt(blocks / max(blocks - 1, 1) * max(blocks / effective, 1.0)))
    picks = rng.integers(0, blocks, size=(REPLICAS, blocks))
    return Resampling(picks, spread, rng.standard_t(floor_replicas - 1, REPLICAS))


def solver_draws(errors: list[BlockErrors], numerics_mm: float, replicas: int) -> Floats:
    """By how much mesh and solver may have moved each mean squared error, (replicas, errors) [mm^2].

    An error d of the simulation adds 2 d.r to the squared residual r. It has the mean squared size N^2 and a random
    direction among DIRECTIONS of a smooth motion. Over hypotheses these are normal with covariance 4 N^2 / DIRECTIONS
    <r_h r_k>. So two hypotheses with nearly the same residual are moved together.
    """
    residuals = np.stack([e.residual for e in errors])
    gram = residuals @ residuals.T / (residuals.shape[1] / 3.0)
    values, vectors = np.linalg.eigh(gram)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    normal = np.random.default_rng(0).standard_normal((replicas, len(errors)))
    return np.asarray(2.0 * numerics_mm / np.sqrt(DIRECTIONS) * normal @ root.T)


def closure(
    base: BlockErrors, with_effect: BlockErrors, floor_mm: float, resampling: Resampling, floor_error_mm: float = 0.0
) -> tuple[float, tuple[float, float]] | None:
    """Return closure and its 90 % interval, or None where there is hardly a gap.

    floor_error_mm: standard error of the floor
    """
    gap = base.squared_mm - floor_mm**2
    if gap < SMALLEST_GAP * max(floor_mm**2, 1e-6):
        return None
    value = (base.squared_mm - with_effect.squared_mm) / gap
    floors = np.maximum(floor_mm + floor_error_mm * resampling.deviates, 0.0)
    base_drawn = base.draw(resampling)
    drawn = (base_drawn - with_effect.draw(resampling)) / np.maximum(base_drawn - floors**2, LEAST_GAP * gap)
    low, high = np.quantile(drawn, [0.05, 0.95])
    return float(value), (float(low), float(high))


def gain_p_value(before: BlockErrors, after: BlockErrors) -> float:
    """p-value of one model's leaving less than another in half-seconds that neither was fitted to.

    The signs are drawn at random. For equally good models, each half-second's difference has either sign with equal
    probability, once free of correlation with the others.
    Source: R. A. Fisher, "The Design of Experiments" (1935), section 21.
    """
    gains = decorrelated((before.sums - after.sums)[:, None], before.between_blocks)[:, 0]
    signs = np.random.default_rng(0).choice([-1.0, 1.0], size=(FLIPS, len(gains)))
    # A draw of the very signs that were seen is a tie, however the sums round.
    return float((1 + np.sum(signs @ gains >= gains.sum() - TIE * np.abs(gains).sum())) / (1 + FLIPS))


def exceeds(errors: BlockErrors, resampling: Resampling, known: float) -> bool:
    """Return whether a squared error is clearly above a known one [mm^2], of noise or of mesh and solver.

    Noise alone would make half-seconds independent. So their correlation is no reason to doubt a gap.
    """
    lowest = error_interval(errors, replace(resampling, spread=1.0))[0]
    return bool(errors.squared_mm > SIGNIFICANT_GAP * known and lowest**2 > known)


def error_interval(errors: BlockErrors, resampling: Resampling) -> tuple[float, float]:
    """90 % interval of the root mean square error [mm]."""
    low, high = np.quantile(np.sqrt(errors.draw(resampling)), [0.05, 0.95])
    return float(low), float(high)

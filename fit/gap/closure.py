"""Closure: the share of the gap that an effect removes on held-out motion.

    closure = (E_base^2 - E_effect^2) / (E_base^2 - floor^2) = D / G

with mean squared errors on the same frames. It is a ratio of sums over blocks of half a second, D = sum d_b and
G = sum g_b. The variance of such a ratio is

    Var = (n - 1) / n sum ((d_b - closure g_b) / (G - g_b))^2 n_w / n_eff,   n_w = G^2 / sum g_b^2,
    n_eff = G^2 / (g' K g)

the jackknife over n blocks, in which G - g_b is at least 1e-6 G. A block below the noise takes nothing out: in
G - g_b, and in n_w and n_eff with their G, it counts as g_b = 0. The closure of an effect that removes the same share
in every block is certain, whatever the motion of the blocks. If one block holds most of the gap, no closure is
certain. Blocks of one take are correlated by K (`fit.gap.correlation`). They count as n_eff, and Student's t has
n_eff - 1 degrees of freedom. The same t tests whether an effect closes anything. A floor of its own standard error
widens the interval. If the base error is hardly above the floor, the ratio means nothing and is not given.

Probabilities draw blocks at random (bootstrap), the errors of all models together. The ratio of each draw to the mean
is raised to the power

    sqrt(n / (n - 1)) sqrt(n / n_eff) t(n_eff - 1) / z,   t, z: 95 % quantiles of Student's and the normal distribution

Sources: W. G. Cochran, "Sampling Techniques" (1977), section 6.17 (jackknife of a ratio); L. Kish, "Survey Sampling"
(1965), section 11.7 (n of unequal weights); B. Efron & R. Tibshirani, "An Introduction to the Bootstrap" (1993),
chapters 8 and 12.5.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import ndtri, stdtr, stdtrit

from fit.gap.correlation import correlation_of, effective_count
from fit.observer.edge import EdgeErrors
from fit.observer.residuals import Observer
from fit.observer.simulation_error import FREE_DIRECTIONS
from formats.arrays import Floats, Integers

INTERVAL_REPLICAS = 1000  # draws of blocks; our choice: a share of them has a deviation of 0.016 at most
SIGNIFICANT_GAP = 1.2  # squared ratio of base error to floor, below which no gap exists; our choice: a tenth, in mm
SMALLEST_GAP = 0.05  # of the squared floor; our choice: below, closure would divide by nearly nothing
LEAST_REMAINDER = 1e-6  # share of the gap that must remain without any one block; our choice: closure divides by it
LEAST_BLOCKS = 3.0  # independent blocks at least: two degrees of freedom, since the spread of fewer is unknown


@dataclass(frozen=True)
class BlockErrors:
    """Sum of squared errors per half-second block [mm^2], and the number of points in each block.

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
        """Correlation matrix of the block sums, (blocks, blocks)."""
        return np.eye(len(self.sums)) if self.correlation is None else self.correlation

    def draw(self, resampling: Resampling) -> Floats:
        """Mean squared distance of bootstrap draws, (replicas,)."""
        picks, middle = resampling.picks, self.squared_mm
        drawn = self.sums[picks].sum(1) / self.counts[picks].sum(1)
        return np.asarray(middle * (drawn / max(middle, 1e-30)) ** resampling.spread)


@dataclass(frozen=True)
class Resampling:
    """Bootstrap draws of blocks, (replicas, blocks), the same for every model.

    spread: a draw's distance from the mean over the bootstrap's, in logarithms, since errors are positive
    """

    picks: Integers
    spread: float


def block_errors(observer: Observer, residual: Floats) -> BlockErrors:
    """Sum a whitened residual, (numbers,), into half-second blocks."""
    block = observer.layout.moving(observer.layout.block)
    millimetres = 1e3 * observer.layout.metres(residual)
    squared = millimetres**2
    count = np.bincount(block) / 3.0
    sums = np.bincount(block, squared).astype(float)
    seen = np.flatnonzero(count > 0)
    correlation = correlation_of(observer, residual)[np.ix_(seen, seen)]
    return BlockErrors(sums[seen], count[seen], millimetres, observer.edge_errors(residual), correlation)


def resample(errors: BlockErrors, rng: np.random.Generator) -> Resampling:
    """Draw bootstrap samples of blocks, with the correlation that a model's errors show."""
    blocks = len(errors.sums)
    effective = max(effective_count(errors.between_blocks, np.ones(blocks)), LEAST_BLOCKS)
    wider = float(stdtrit(effective - 1, 0.95) / ndtri(0.95))
    spread = wider * float(np.sqrt(blocks / max(blocks - 1, 1) * max(blocks / effective, 1.0)))
    return Resampling(rng.integers(0, blocks, size=(INTERVAL_REPLICAS, blocks)), spread)


def solver_draws(errors: list[BlockErrors], numerics_mm: float, replicas: int) -> Floats:
    """Draw the changes of each mean squared error by mesh and solver, (replicas, errors) [mm^2].

    An error d of the simulation adds 2 d.r to the squared residual r. It has the mean squared size N^2 and a random
    direction among FREE_DIRECTIONS of a smooth motion. Over hypotheses these are normal with covariance
    4 N^2 / FREE_DIRECTIONS <r_h r_k>. So the errors of two hypotheses with nearly the same residual change together.
    """
    residuals = np.stack([e.residual for e in errors])
    gram = residuals @ residuals.T / (residuals.shape[1] / 3.0)
    values, vectors = np.linalg.eigh(gram)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    normal = np.random.default_rng(0).standard_normal((replicas, len(errors)))
    return np.asarray(2.0 * numerics_mm / np.sqrt(FREE_DIRECTIONS) * normal @ root.T)


@dataclass(frozen=True)
class Share:
    """Share of an error that one model closes, with its standard error and degrees of freedom."""

    value: float
    error: float
    freedom: float

    @property
    def p_value(self) -> float:
        """Return the probability of this share or a larger one if nothing is closed."""
        return float(stdtr(self.freedom, -self.value / max(self.error, 1e-12)))


def share_of(before: BlockErrors, after: BlockErrors, known: float) -> Share:
    """Return the share of a model's error beyond a known error [mm^2] that another model closes."""
    gains, gaps = before.sums - after.sums, before.sums - known * before.counts
    value = float(gains.sum() / gaps.sum())
    whole, blocks, weights = float(gaps.sum()), len(gaps), np.maximum(gaps, 0.0)
    alike = max(effective_count(np.eye(blocks), weights), 1.0)
    effective = max(effective_count(before.between_blocks, weights), LEAST_BLOCKS)
    rest = np.maximum(whole - weights, LEAST_REMAINDER * whole)
    squares = float((((gains - value * gaps) / rest) ** 2).sum()) * max(blocks - 1, 1) / blocks
    return Share(value, float(np.sqrt(squares * max(alike / effective, 1.0))), effective - 1)


def closure(
    base: BlockErrors,
    with_effect: BlockErrors,
    floor_mm: float,
    floor_error_mm: float = 0.0,
    replicas: int = 2,  # the fewest draws that have a deviation
) -> tuple[float, tuple[float, float]] | None:
    """Return closure and its 90 % interval, or None if there is hardly a gap.

    floor_error_mm: standard error of the floor, a mean over `replicas` draws
    """
    if not has_share(base, floor_mm):
        return None
    found = share_of(base, with_effect, floor_mm**2)
    by_blocks = float(stdtrit(found.freedom, 0.95)) * found.error
    # d closure / d floor = 2 floor closure / gap
    moved = 2 * floor_mm * floor_error_mm * found.value / (base.squared_mm - floor_mm**2)
    half = float(np.hypot(by_blocks, stdtrit(replicas - 1, 0.95) * moved))
    return found.value, (found.value - half, found.value + half)


def has_share(errors: BlockErrors, floor_mm: float) -> bool:
    """Return whether an error exceeds the noise by enough for a share of the excess to be defined."""
    return errors.squared_mm - floor_mm**2 >= SMALLEST_GAP * max(floor_mm**2, 1e-6)


def gain_p_value(before: BlockErrors, after: BlockErrors, floor_mm: float) -> float:
    """Return the p-value that one model's held-out error is no smaller than another's.

    The share refers to the error beyond the noise, or to the whole error if hardly any exceeds the noise.
    """
    return share_of(before, after, floor_mm**2 if has_share(before, floor_mm) else 0.0).p_value


def exceeds(errors: BlockErrors, resampling: Resampling, known: float) -> bool:
    """Return whether a squared error is clearly above a known one [mm^2], of noise or of mesh and solver.

    Noise alone would leave half-seconds independent, so their correlation does not weaken the evidence for a gap.
    """
    lowest = error_interval(errors, replace(resampling, spread=1.0))[0]
    return bool(errors.squared_mm > SIGNIFICANT_GAP * known and lowest**2 > known)


def error_interval(errors: BlockErrors, resampling: Resampling) -> tuple[float, float]:
    """Return the 90 % interval of the root mean square error [mm]."""
    low, high = np.quantile(np.sqrt(errors.draw(resampling)), [0.05, 0.95])
    return float(low), float(high)

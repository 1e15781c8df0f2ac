"""90 % interval of each parameter: the jackknife over half-second blocks of the recording, on the linearised model.

The residuals r(u) are in units of their deviation. J is their Jacobian in working coordinates, and P the precision of a
weak prior. A block b is half a second of the recording, left out as a whole, because errors within a block are
correlated. Then

    H = J'J + P,   s_b = J_b' r_b,   u_(b) - u = -(H - J_b'J_b)^-1 (s - s_b)
    V = (G - 1)/G sum_b d_b d_b' + H^-1 P H^-1,   d_b = u_(b) - mean of u_(b)

The prior alone supplies the second term. A direction that no block determines keeps the prior's spread. A search may
stop before the minimum. The remaining step, H^-1 s, then counts as well:

    half width = sqrt(t^2 V + (H^-1 s)^2),   t: 95 % of Student's distribution with G - 1 degrees of freedom

A parameter is identified when its deviation is less than half of the prior's, and when it is not at its bound.

A parameter within a hundredth of its range of an end is at its bound. Its interval is one-sided and reaches the bound.
Rounding decides on which side of the bound the linear model has its minimum, so the verdict ignores the side. If the
minimum lies beyond the bound, the slope is a poor measure of the uncertainty. The half width is then at least that of a
parameter at the limit of being identified.

Source: J. G. MacKinnon, M. O. Nielsen, M. D. Webb, "Fast and reliable jackknife and bootstrap methods for
cluster-robust inference", J. Appl. Econometrics 38 (2023), their CV3J. The prior's term is that of a linear estimate
whose prior mean has the prior's variance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fit.errors import FitError
from fit.search.least_squares import BoundedSpace
from formats.arrays import Booleans, Floats, Integers
from formats.nature import NORMAL_90
from formats.sights import too_few_halves

# Of the prior's deviation; our choice: at 1, a parameter without any evidence would be identified.
SHARE_IDENTIFIED = 0.5
PRIOR_SD = 1 / np.sqrt(12)  # of a flat prior over the unit box
NEAR_BOUND = 0.01  # of the box; our choice: fits end a little short of a bound


@dataclass(frozen=True)
class Intervals:
    """90 % intervals, (parameters, 2), and marks for parameters that are identified and at a bound, (parameters,).

    `covariance`, (parameters, parameters), belongs to the linearised model or to draws. `way`, (parameters,), is the
    remaining step to the minimum. All are in the parameters' own units. `spread` is half a 90 % interval in deviations,
    for a `way` of zero.
    """

    ends: Floats
    is_identified: Booleans
    covariance: Floats
    way: Floats
    spread: float
    is_at_bound: Booleans


def check_blocks(block: Integers) -> None:
    """Refuse a recording with too few half-second blocks for intervals, from the block of each number, (m,).

    Raises:
        FitError: fewer than three blocks.
    """
    if lack := too_few_halves(len(np.unique(block))):
        raise FitError(f"the takes are too short: {lack}", where=None, advice="record a longer take")


@dataclass(frozen=True, kw_only=True)
class LinearModel:
    """The linearised model about the end of a search.

    - `parameters`, (p,): the end
    - `residuals`, (m,), in units of their deviation
    - `jacobian`, (m, p): d residual / d u, u from 0 to 1 between the bounds
    - `block`, (m,): the half second to which each number belongs
    """

    parameters: Floats
    residuals: Floats
    jacobian: Floats
    block: Integers


def block_intervals(
    space: BoundedSpace, model: LinearModel, *, between: Floats | float = 0.0, spread: Floats | float = 0.0
) -> Intervals:
    """Return 90 % intervals about the parameters of a linearised model.

    - `between`, (p, p): covariance that is added, in squared shares of the box
    - `spread`, (p,): a lower limit of the deviations, in shares of the box, known from elsewhere

    Raises:
        FitError: fewer than three blocks.
    """
    from scipy.special import stdtrit

    check_blocks(model.block)
    names, number = np.unique(model.block, return_inverse=True)
    variance, way = jackknife(model.residuals, model.jacobian, number)
    variance = variance + between
    wider = np.maximum(1.0, spread / np.sqrt(np.diag(variance)))
    variance = variance * np.outer(wider, wider)
    deviation = np.sqrt(np.diag(variance))
    reach = float(stdtrit(len(names) - 1, 0.95))
    half = np.sqrt((reach * deviation) ** 2 + way**2)
    unit = space.to_unit(model.parameters)
    low, high = at_bounds(unit)
    held = (low & (unit + way < 0)) | (high & (unit + way > 1))
    half = np.where(held, np.maximum(half, reach * SHARE_IDENTIFIED * PRIOR_SD), half)
    lower, upper = np.where(low, 0.0, unit - half), np.where(high, 1.0, unit + half)
    ends = np.stack([space.from_unit(lower), space.from_unit(upper)], axis=1)
    slope = space.slope(model.parameters)
    covariance = variance * np.outer(slope, slope)
    is_identified = (deviation < SHARE_IDENTIFIED * PRIOR_SD) & ~low & ~high
    return Intervals(ends, is_identified, covariance, way * slope, reach, low | high)


def at_bounds(unit: Floats) -> tuple[Booleans, Booleans]:
    """Return which parameters lie at their lower and at their upper bound, (p,) each, from shares of the box, (p,)."""
    return unit <= NEAR_BOUND, unit >= 1 - NEAR_BOUND


def widened(space: BoundedSpace, intervals: Intervals, best: Floats, more: Floats) -> Intervals:
    """Return intervals with independent errors added in squares.

    - best, (parameters,): the search's result, which may lie outside an interval of draws
    - more, (parameters,): half widths of the errors' own 90 % intervals, in the parameters' units; 0 changes nothing
    """
    more = np.minimum(more, space.maximum - space.minimum)
    below, above = np.maximum([best - intervals.ends[:, 0], intervals.ends[:, 1] - best], 0.0)
    ends = np.stack([best - np.hypot(below, more), best + np.hypot(above, more)], axis=1)
    ends = np.clip(ends, space.minimum[:, None], space.maximum[:, None])
    ends = np.where(more[:, None] > 0.0, ends, intervals.ends)
    covariance = intervals.covariance + np.diag((more / intervals.spread) ** 2)
    most = SHARE_IDENTIFIED * PRIOR_SD * space.slope(best)
    is_identified = intervals.is_identified & ((more == 0.0) | (np.sqrt(np.diag(covariance)) < most))
    return replace(intervals, ends=ends, covariance=covariance, is_identified=is_identified)


def draw_intervals(space: BoundedSpace, draws: Floats, best: Floats) -> Intervals:
    """Return intervals from draws of the posterior, (draws, parameters): their 5 % and 95 % quantiles.

    best, (parameters,): the search's result
    """
    ends = np.quantile(draws, [0.05, 0.95], axis=0).T
    low, high = at_bounds(space.to_unit(best))
    ends[low, 0], ends[high, 1] = space.minimum[low], space.maximum[high]
    is_identified = (space.to_unit(draws).std(axis=0) < SHARE_IDENTIFIED * PRIOR_SD) & ~low & ~high
    covariance, way = np.atleast_2d(np.cov(draws.T)), np.zeros(draws.shape[1])
    return Intervals(ends, is_identified, covariance, way, NORMAL_90, low | high)


def jackknife(
    residuals: Floats, jacobian: Floats, number: Integers, prior: Floats | None = None
) -> tuple[Floats, Floats]:
    """Return the jackknife covariance, (p, p), and the remaining step to the minimum, (p,), in working coordinates.

    - `number`, (m,): of each residual's block, counted from 0
    - `prior`, (p, p): its precision; None is flat over a box, in whose shares the results are
    """
    count = int(number.max()) + 1
    prior = np.eye(jacobian.shape[1]) / PRIOR_SD**2 if prior is None else prior
    own = [jacobian[number == b] for b in range(count)]
    slopes = np.stack([own[b].T @ residuals[number == b] for b in range(count)])
    whole = jacobian.T @ jacobian + prior
    slope = slopes.sum(0)
    without = np.stack([-np.linalg.solve(whole - own[b].T @ own[b], slope - slopes[b]) for b in range(count)])
    apart = without - without.mean(0)
    inverse = np.linalg.inv(whole)
    variance = (count - 1) / count * (apart.T @ apart) + inverse @ prior @ inverse
    return variance, -inverse @ slope

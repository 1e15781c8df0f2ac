"""Bayesian evidence of every subset of up to three effects, from their signatures, without simulation.

About a fit with residual r and Jacobian J, an effect's signatures S (columns per typical size) make the residual
r + J b + S a. Its covariance is C (`fit.gap.likelihood`). The priors are Gaussian, b ~ N(m, Lambda^-1) and a ~ N(0, T),
the second one cut to the effect's range. The parameters b and the amplitudes a of a subset M are integrated in closed
form. In the metric of C, with the base parameters projected out,

    Q = C^-1 - C^-1 J (J' C^-1 J + Lambda)^-1 J' C^-1,    g = -S' Q r,  G = S' Q S
    log p(r | M, s) = base(s) + 1/2 g_M' A^-1 g_M - 1/2 log |I + T_M G_M| + log B(A^-1 g_M, A^-1) - log B(0, T_M)
    A = G_M + T_M^-1,   base(s) = -1/2 r' Q r - 1/2 log |C| - 1/2 log |I + Lambda^-1 J' C^-1 J|

where B(mu, V) is the share of a normal distribution that lies within the ranges (signs among them). For several
components it is the product of conditional shares, one component after another. Each has the mean and variance that the
truncation of those before it leaves (Mendell & Elston). The size s of the discrepancy has a log-normal prior. Its
median is the possible error of mesh, solver and the effects' laws; a sum over a grid marginalises the size. Each effect
is present with odds CHANCE, independently of the others. Sources: E. I. George & R. E. McCulloch, JASA 88 (1993)
(evidence of every subset); D. J. C. MacKay, "Information Theory, Inference, and Learning Algorithms" (2003), chapter
28; N. R. Mendell & R. C. Elston, Biometrics 30 (1974).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.special import log_ndtr, logsumexp

from fit.gap.likelihood import Sums
from formats.arrays import Floats, Integers

MOST_EFFECTS = 3  # present together; our choice: of 29 effects that makes 4090 subsets, four at most make 27,841
CHANCE = 1 / 24  # odds that one effect is present: about two dozen effects give an even chance that one is present
# Standard deviation of an amplitude, in typical sizes, before its range cuts it; our choice: a typical size is then
# within half a deviation. At twice, the log evidence of an effect that is found falls by log 2; at half it rises by
# that.
SIZES = 2.0
TOGETHER = 256  # subsets evaluated in one batch; our choice: their matrices stay small, and no result depends on it
LOG_ROOT = 0.5 * float(np.log(2 * np.pi))  # of the normal density's constant, sqrt(2 pi)


@dataclass(frozen=True)
class Columns:
    """Components of the candidate effects, in the order of the rows of `Sums` after residual and Jacobian.

    effects: names, one per column; low, high, (columns,): ranges in typical sizes, less the fit's own sizes
    """

    effects: tuple[str, ...]
    low: Floats
    high: Floats


@dataclass(frozen=True)
class Reduced:
    """Sums with the base parameters projected out, per scale.

    base, (scales,): log evidence without an effect; pull, (scales, columns): g; normal, (scales, columns, columns): G
    """

    base: Floats
    pull: Floats
    normal: Floats


def reduced(sums: Sums, precision: Floats, offset: Floats) -> Reduced:
    """Project nuisance parameters out of sums over rows: residual, nuisance parameters, signatures, in this order.

    Nuisance parameters may imitate an effect; the base parameters come first.

    - precision, (parameters,) or (scales, parameters): of the priors of the nuisance parameters
    - offset, (parameters,): place of the fit less the priors' means
    """
    inner = sums.inner
    precision = np.broadcast_to(precision, (len(inner), len(offset)))
    aside = slice(1, 1 + len(offset))
    hessian = inner[:, aside, aside] + precision[:, :, None] * np.eye(len(offset))
    cross = np.delete(inner[:, aside], np.s_[aside], axis=2)  # with the residual, then with signatures
    cross[:, :, 0] += precision * offset
    rest = np.delete(np.delete(inner, np.s_[aside], axis=1), np.s_[aside], axis=2)
    rest = rest - np.swapaxes(cross, 1, 2) @ np.linalg.solve(hessian, cross)
    squares = rest[:, 0, 0] + precision @ offset**2
    volume = np.linalg.slogdet(hessian)[1] - np.log(precision).sum(1)
    base = -0.5 * (squares + sums.log_det + volume)
    return Reduced(base, -rest[:, 0, 1:], rest[:, 1:, 1:])


def log_evidence(found: Reduced, columns: Columns, among: Sequence[Sequence[str]]) -> Floats:
    """Return the log evidence of each subset of effects, (subsets, scales), without their prior odds."""
    places = {name: [n for n, other in enumerate(columns.effects) if other == name] for name in columns.effects}
    at = [[n for name in subset for n in places[name]] for subset in among]
    gained = np.zeros((len(among), len(found.base)))
    for size in {len(one) for one in at} - {0}:
        chosen = [n for n, one in enumerate(at) if len(one) == size]
        for first in range(0, len(chosen), TOGETHER):
            some = chosen[first : first + TOGETHER]
            gained[some] = _gained(found, columns, np.array([at[n] for n in some]))
    return np.asarray(found.base + gained)


def _gained(found: Reduced, columns: Columns, at: Integers) -> Floats:
    """Return the gain in log evidence, (subsets, scales), by columns, (subsets, k)."""
    pull = np.moveaxis(found.pull[:, at], 0, 1)  # (subsets, scales, k)
    normal = np.moveaxis(found.normal[:, at[:, :, None], at[:, None, :]], 0, 1)
    low, high, count = columns.low[at], columns.high[at], at.shape[1]
    posterior = normal + np.eye(count) / SIZES**2
    covariance = np.asarray(np.linalg.inv(posterior))
    mean = (covariance @ pull[..., None])[..., 0]
    volume = 0.5 * np.linalg.slogdet(posterior)[1] + count * np.log(SIZES)
    within = log_share(mean, covariance, low[:, None], high[:, None])
    prior = np.tile(np.eye(count) * SIZES**2, (len(at), 1, 1))
    before = log_share(np.zeros((len(at), count)), prior, low, high)
    return np.asarray(0.5 * (pull * mean).sum(-1) - volume + within - before[:, None])


def log_share(mean: Floats, covariance: Floats, low: Floats, high: Floats) -> Floats:
    """Return the log probability that normals, (..., k) and (..., k, k), lie within ranges, (..., k) -> (...,)."""
    mean, covariance = mean.copy(), covariance.copy()
    total = np.zeros(mean.shape[:-1])
    for n in range(mean.shape[-1]):
        sd = np.sqrt(covariance[..., n, n])
        below, above = (low[..., n] - mean[..., n]) / sd, (high[..., n] - mean[..., n]) / sd
        share = _log_between(below, above)
        total += share
        # Mean and variance of a standard normal distribution cut off at two ends.
        at_low, at_high = (np.exp(-0.5 * end**2 - LOG_ROOT - share) for end in (below, above))
        moved = at_low - at_high
        ends = [np.where(np.isinf(end), 0.0, end) for end in (below, above)]
        kept = np.clip(1 + ends[0] * at_low - ends[1] * at_high - moved**2, 0.0, 1.0)
        gain = covariance[..., n] / sd[..., None]
        mean = mean + gain * moved[..., None]
        covariance = covariance - gain[..., :, None] * gain[..., None, :] * (1 - kept)[..., None, None]
    return total


def _log_between(below: Floats, above: Floats) -> Floats:
    """Return the log probability of a standard normal variable between two ends, stable far out in the tails."""
    flip = below > 0
    low, high = np.where(flip, -above, below), np.where(flip, -below, above)
    top, bottom = log_ndtr(high), log_ndtr(low)
    return np.asarray(top + np.log1p(-np.exp(np.minimum(bottom - top, -1e-12))))


def subsets(effects: Sequence[str], *, beside: Mapping[str, bool] | None = None) -> list[tuple[str, ...]]:
    """Return every subset of up to MOST_EFFECTS effects, the empty one first.

    beside: whether an effect may be combined with others
    """
    able = [name for name in effects if beside is None or beside[name]]
    found = [(), *((name,) for name in effects)]
    return found + [pair for count in range(2, MOST_EFFECTS + 1) for pair in combinations(able, count)]


def log_prior(count: int) -> float:
    """Return the logarithm of the prior odds of this number of effects against none."""
    return count * float(np.log(CHANCE))


def summed_out(log_evidences: Floats, log_scales: Floats, middle: Floats | float, width: float) -> Floats:
    """Marginalise log evidences, (..., scales), over the discrepancy's size, with a log-normal prior about `middle`."""
    apart = (log_scales - np.log(np.asarray(middle))[..., None]) / width
    weight = -0.5 * apart**2
    return np.asarray(logsumexp(log_evidences + weight - logsumexp(weight, axis=-1, keepdims=True), axis=-1))

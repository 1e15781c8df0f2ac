"""Predict residuals at parameters that were not simulated: Kriging of whole residual vectors at once.

All numbers of a residual vector r(u), (m,), share one correlation k over the unit box, a constant mean and their own
variance. The best linear unbiased prediction is then one set of weights for all of them,

    r(u) ~ sum_i w_i(u) r_i,    w = K^-1 (k + 1 (1 - 1'K^-1 k) / 1'K^-1 1),    sum_i w_i = 1

    k(u, v) = (1 + d + d^2/3) exp(-d),   d^2 = 5 sum_j (u_j - v_j)^2 / l_j^2,     K = k(u_i, u_j) + nugget

The expected sum of squares then needs only the residuals' Gram matrix G = R R', (samples, samples):

    E |r(u)|^2 = w' G w + s^2 v(u),    s^2 = tr(P G) / (n - 1),    P = K^-1 - K^-1 11' K^-1 / 1'K^-1 1

with v the variance of the prediction in units of s^2. The nugget stands for the ripples that folds make. The ranges l
and the nugget maximise the restricted likelihood under a weak prior. The likelihood counts the residuals as few
independent numbers.

Sources: S. Conti & A. O'Hagan, "Bayesian emulation of complex multi-output and dynamic computer models", J. Stat.
Planning and Inference 140 (2010), section 2, for one correlation of all outputs. R. Astudillo & P. Frazier, "Bayesian
optimization of composite functions", ICML 2019, for the sum of squares of a predicted vector.
"""

from __future__ import annotations

import numpy as np

from formats.arrays import Floats

# Numbers of a residual vector that count as independent: neighbours in time are correlated. Our choice: it weighs the
# simulations against the two priors below, and nothing else depends on it. Half and double change the error of a fit to
# the demo's takes by 0.01 mm of 3.67.
INDEPENDENT = 60.0
# Prior of a range, shares of the box, and of its logarithm. Our choice: two deviations reach from a quarter of the box
# to four boxes, over which a parameter hardly acts. Half and double of the range change that error by as little.
RANGE, RANGE_SD = 1.0, 0.7
# The same, of the variance that is not correlated; our choice: two deviations reach from 2e-5 to 5 %, so that the
# simulations decide. Half and double of the variance change that error by as little.
NUGGET, NUGGET_SD = 1e-3, 2.0
RANGE_BOUNDS, NUGGET_BOUNDS = (0.3, 10.0), (1e-6, 0.3)  # our choice: 1.7 to 3.5 deviations from the middle


class Emulator:
    """Kriging model of residual vectors that were simulated at samples of the unit box."""

    def __init__(self, units: Floats, gram: Floats) -> None:
        """Fit the correlation to two or more samples.

        units, (samples, parameters); gram, (samples, samples): products of their residual vectors.
        """
        from scipy.optimize import minimize

        self.units, self.gram = units, gram
        count = units.shape[1]
        self._prior = np.log([*[RANGE] * count, NUGGET])
        self._prior_sd = np.array([*[RANGE_SD] * count, NUGGET_SD])
        self._apart = (units[:, None] - units[None]) ** 2
        found = minimize(
            self._negative_log_posterior, self._prior, jac=True,
            bounds=[*[tuple(np.log(RANGE_BOUNDS))] * count, tuple(np.log(NUGGET_BOUNDS))], options={"maxiter": 40},
        )  # fmt: skip
        self._logs: Floats = found.x  # of the ranges and the nugget
        self._inverse, self._sums, self._projected, _ = self._invert(self._logs)
        self._variance = float((self._projected * gram).sum()) / (len(units) - 1)

    def _invert(self, logs: Floats) -> tuple[Floats, Floats, Floats, float]:
        """Return K^-1, K^-1 1, P and log |K| + log 1'K^-1 1."""
        scaled = np.sqrt(5 * (self._apart / np.exp(2 * logs[:-1])).sum(-1))
        whole = (1 + scaled + scaled**2 / 3) * np.exp(-scaled) + np.exp(logs[-1]) * np.eye(len(scaled))
        inverse = np.linalg.inv(whole)
        sums = inverse.sum(0)
        projected = inverse - np.outer(sums, sums) / sums.sum()
        return inverse, sums, projected, float(np.linalg.slogdet(whole)[1] + np.log(sums.sum()))

    def _negative_log_posterior(self, logs: Floats) -> tuple[float, Floats]:
        """Return the negative logarithm of likelihood times prior, and its gradient."""
        inverse, _, projected, volume = self._invert(logs)
        free = len(inverse) - 1
        floor = max(1e-12 * float(np.trace(self.gram)), 1e-300)  # where all residuals are alike
        squares = max(float((projected * self.gram).sum()), floor)
        off = (logs - self._prior) / self._prior_sd
        value = 0.5 * INDEPENDENT * (volume + free * np.log(squares / free)) + 0.5 * float(off @ off)
        shares = self._apart / np.exp(2 * logs[:-1])
        scaled = np.sqrt(5 * shares.sum(-1))
        # d k / d log l_j is this times the share of j in d^2 / 5; that of the nugget is the nugget itself.
        by_range = (5 / 3) * (1 + scaled) * np.exp(-scaled)
        outer = projected - free / squares * (projected @ self.gram @ projected)
        slope = np.array([*np.einsum("ab,abj->j", outer * by_range, shares), np.exp(logs[-1]) * np.trace(outer)])
        return value, 0.5 * INDEPENDENT * slope + off / self._prior_sd

    def costs(self, units: Floats, caution: float) -> tuple[Floats, Floats]:
        """Return w' G w + caution s^2 v, (candidates,), and its gradients, (candidates, parameters).

        units, (candidates, parameters); caution: 1 is the expected cost, less trusts the prediction more.
        """
        ranges = np.exp(self._logs[:-1])
        apart = units[:, None] - self.units[None]
        scaled = np.sqrt(5 * ((apart / ranges) ** 2).sum(-1))
        decay = np.exp(-scaled)
        near = (1 + scaled + scaled**2 / 3) * decay
        slopes = -(5 / 3) * ((1 + scaled) * decay)[..., None] * apart / ranges**2
        total = self._sums.sum()
        missing = (1 - near @ self._sums) / total
        weights = near @ self._inverse + missing[:, None] * self._sums
        left = weights @ self.gram
        variance = 1 - (near * (weights - missing[:, None] * self._sums)).sum(1) + missing**2 * total
        values = (left * weights).sum(1) + caution * self._variance * np.maximum(variance, 0.0)
        # dw = P dk, and dv = -2 w' dk
        by_near = 2 * left @ self._projected - 2 * caution * self._variance * weights
        return values, np.einsum("ca,caj->cj", by_near, slopes)

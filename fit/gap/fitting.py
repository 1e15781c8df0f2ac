"""Least squares fits of base parameters, alone or jointly with effects, to the observer's residuals.

The unknowns are base parameters, on a log scale where they have one, and amplitudes in units of their typical size.
Weak Gaussian priors (a factor of e^1.5 on log parameters) hold unidentifiable parameters near their initial values.
Covariance of the estimate, robust against correlation inside blocks of half a second (the sandwich):

    V = H^-1 (sum_b s_b s_b^T) H^-1,    H = J^T J + prior,   s_b = J_b^T r_b

Base parameters have the jackknife's covariance instead, and Student's t (`fit.search.intervals`). It allows for the
share of each block's residual that the fit took away, and includes the prior's share. So a parameter without influence
on the data has the spread of its prior. In linear cloth 88 % of such 90 % intervals hold the truth, and 85 % of the
sandwich's (`benchmarks/base_intervals.py`).

Source: K.-Y. Liang & S. L. Zeger, Biometrika 73 (1986), eq. 7 (cluster-robust covariance).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from fit.cloth.effect import size_of
from fit.observer.residuals import Observer
from fit.search.intervals import jackknife
from fit.search.least_squares import (
    BoundedSpace,
    LeastSquaresResult,
    LeastSquaresSettings,
    Prior,
    search,
    side_by_side,
)
from formats.arrays import Floats, Integers
from formats.nature import NORMAL_90

# Standard deviation of log parameters about their initial values. Our choice: two deviations, a factor of 20, reach
# from 300 N/m beyond the 37 to 1000 N/m of fabrics in stretch.
PRIOR_LOG = 1.5
# Of amplitudes, in typical sizes, about zero; our choice: a typical size lowers the log prior by 0.02 alone.
PRIOR_AMPLITUDE = 5.0
# Relative fall of the cost at which a fit ends; our choice: a thousandth of the error, whose square it is.
COST_TOLERANCE = 2e-3
# Candidates that cost hardly more than one: with 16 lanes on one core 1 took 0.16 s, 8 0.21 s and 12 0.26 s (measured).
CANDIDATE_LANES = 12
# Damping values that one fit tries in a batch; our choice: three or four fits side by side fill `CANDIDATE_LANES`.
FEWEST_RUNGS, MOST_RUNGS = 3, 4


@dataclass(frozen=True)
class Pinned:
    """Amplitudes known from the held edge instead of the cloth, (components,) of all effects, in the effects' units.

    sd: their deviations, infinite for unknown ones; trust: factor by which the cloth's residuals are overconfident
    """

    amplitudes: Floats
    sd: Floats
    trust: float


@dataclass(frozen=True)
class Fitted:
    """A least-squares fit.

    - `vector`, (parameters,): base parameters
    - `amplitudes`, (components,) of all effects, zero where not active
    - `active`: names of the effects that were fitted, in the order of their columns in the jacobian
    - `residual`, (numbers,)
    - `jacobian`, (numbers, parameters + components), and deviation, (parameters + components,): of logs, plain values
      and typical sizes; NORMAL_90 deviations are half of a 90 % interval
    - `pinned`: amplitudes that the held edge decided
    """

    vector: Floats
    amplitudes: Floats
    active: tuple[str, ...]
    residual: Floats
    jacobian: Floats
    deviation: Floats
    is_converged: bool
    pinned: Pinned | None = None

    @property
    def cost(self) -> float:
        """Sum of squared whitened residuals."""
        return float(self.residual @ self.residual)


class Problem:
    """Map between the fitted numbers (base parameters, amplitudes in typical sizes) and the observer's arguments."""

    def __init__(self, observer: Observer, active: tuple[str, ...] = (), pinned: Pinned | None = None) -> None:
        self.observer, self.active, self.pinned = observer, active, pinned
        method = observer.parameterisation
        effects = [observer.library[name] for name in active for _ in observer.library[name].components]
        self.columns = np.concatenate(
            [np.zeros(0, int), *(np.arange(len(observer.off))[observer.columns[name]] for name in active)]
        )
        self.typical = np.array([e.typical for e in effects])
        low, high = np.array([e.low for e in effects]), np.array([e.high for e in effects])
        self.space = BoundedSpace(
            minimum=np.concatenate([method.minimum, low / self.typical]),
            maximum=np.concatenate([method.maximum, high / self.typical]),
            is_log=np.concatenate([method.is_log, np.zeros(len(effects), bool)]),
        )
        self.prior_sd = np.concatenate(
            [
                np.where(method.is_log, PRIOR_LOG, method.maximum - method.minimum),
                np.full(len(effects), PRIOR_AMPLITUDE),
            ]
        )
        mean = np.concatenate([method.initial, np.zeros(len(effects))])
        if pinned is not None:
            known = pinned.sd[self.columns] / np.sqrt(pinned.trust) / self.typical
            is_precise = known < PRIOR_AMPLITUDE
            is_known = np.append(np.zeros(len(method.initial), bool), is_precise)
            self.prior_sd[is_known] = known[is_precise]
            mean[is_known] = (pinned.amplitudes[self.columns] / self.typical)[is_precise]
        self.prior = Prior(mean=mean, precision=np.diag(self.prior_sd**-2))

    def pack(self, vector: Floats, amplitudes: Floats) -> Floats:
        """Return the fitted numbers for base parameters, (parameters,), and amplitudes, (effects,), within bounds."""
        numbers = np.concatenate([vector, amplitudes[self.columns] / self.typical])
        return np.asarray(np.clip(numbers, self.space.minimum, self.space.maximum))

    def unpack(self, numbers: Floats) -> tuple[Floats, Floats]:
        """Return base parameters, (candidates, parameters), and amplitudes, (candidates, effects)."""
        count = numbers.shape[1] - len(self.columns)
        amplitudes = np.zeros((len(numbers), len(self.observer.off)))
        amplitudes[:, self.columns] = numbers[:, count:] * self.typical
        return numbers[:, :count], amplitudes

    def residuals(self, numbers: Floats) -> Floats:
        """Whitened residuals, (candidates, numbers)."""
        return self.observer.residuals(*self.unpack(numbers))


@dataclass(frozen=True)
class Task:
    """Specification of a fit: base parameters and amplitudes of the active effects, with their start values.

    - `vector`, (parameters,)
    - `amplitudes`, (components,) of all effects
    - `renewals`: how often an outdated Jacobian is recomputed before the fit may stop
    - `is_rough`: whether the Jacobian at the end is not needed
    - `known_cost`: cost of another fit of the same model; this fit stops if it will not fall below
    - `jacobian`, (numbers, parameters + components): a known one near the start, which chords update
    - `pinned`: amplitudes that are known from elsewhere
    """

    vector: Floats
    amplitudes: Floats
    active: tuple[str, ...] = ()
    iterations: int = 12  # our choice: a limit on the cost of one fit
    renewals: int = 2  # our choice: a limit, as above
    jacobian: Floats | None = None
    is_rough: bool = False
    known_cost: float = np.inf
    pinned: Pinned | None = None


def fit(observer: Observer, tasks: Sequence[Task]) -> list[Fitted]:
    """Run several fits together: each batch simulates the next candidates of all fits."""
    problems = [Problem(observer, task.active, task.pinned) for task in tasks]
    width = int(np.clip(CANDIDATE_LANES / len(tasks), FEWEST_RUNGS, MOST_RUNGS))
    searches = [
        search(
            problem.pack(task.vector, task.amplitudes),
            problem.space,
            prior=problem.prior,
            settings=LeastSquaresSettings(
                width=width, max_iterations=task.iterations, cost_tolerance=COST_TOLERANCE, step_tolerance=1e-3,
                is_chord=True, renewals=task.renewals, is_exact=not task.is_rough, known_cost=task.known_cost,
            ),
            jacobian=task.jacobian,
        )
        for problem, task in zip(problems, tasks, strict=True)
    ]  # fmt: skip

    def evaluate(asked: list[Floats]) -> list[Floats]:
        rows = [problem.unpack(numbers) for problem, numbers in zip(problems, asked, strict=True)]
        vectors, amplitudes = (np.concatenate(column) for column in zip(*rows, strict=True))
        return np.split(observer.residuals(vectors, amplitudes), np.cumsum([len(numbers) for numbers in asked])[:-1])

    found = side_by_side(searches, evaluate)
    return [_fitted(observer, *each) for each in zip(problems, tasks, found, strict=True)]


def _fitted(observer: Observer, problem: Problem, task: Task, found: LeastSquaresResult) -> Fitted:
    vectors, amplitudes = problem.unpack(found.parameters[None])
    deviation = sandwich(found.jacobian, found.residuals, observer.layout.block, problem.prior_sd)
    own = np.arange(len(deviation)) < len(task.vector)
    deviation = np.where(
        own, by_jackknife(found.jacobian, found.residuals, observer.layout.block, problem.prior_sd), deviation
    )
    if task.pinned is not None:
        known = task.pinned.sd[problem.columns] / problem.typical
        deviation[len(task.vector) :] = np.where(np.isfinite(known), known, deviation[len(task.vector) :])
    return Fitted(
        vectors[0], amplitudes[0], task.active, found.residuals, found.jacobian, deviation, found.is_converged,
        pinned=task.pinned,
    )  # fmt: skip


def excludes_zero(interval: tuple[float, float]) -> bool:
    """Return whether an interval lies on one side of zero, without touching it."""
    low, high = interval
    return low * high > 0


def from_prior(jacobian: Floats, prior_sd: Floats) -> Floats:
    """Return the prior's part of the deviations, (parameters,)."""
    inverse = np.linalg.inv(jacobian.T @ jacobian + np.diag(prior_sd**-2))
    return np.asarray(np.sqrt(((inverse / prior_sd) ** 2).sum(1)))


def by_jackknife(jacobian: Floats, residual: Floats, block: Integers, prior_sd: Floats) -> Floats:
    """Return the jackknife's deviations, (parameters,), of which NORMAL_90 reach as far as Student's t of the data."""
    names, number = np.unique(block, return_inverse=True)
    own = from_prior(jacobian, prior_sd)
    whole = np.diag(jackknife(residual, jacobian, number, np.diag(prior_sd**-2))[0])
    wider = float(stdtrit(max(len(names) - 1, 1), 0.95)) / NORMAL_90
    return np.asarray(np.hypot(wider * np.sqrt(np.maximum(whole - own**2, 0.0)), own))


def sandwich(jacobian: Floats, residual: Floats, block: Integers, prior_sd: Floats) -> Floats:
    """Return cluster-robust standard deviations, (parameters,), of a least squares estimate."""
    hessian = jacobian.T @ jacobian + np.diag(prior_sd**-2)
    scores = np.zeros((int(block.max()) + 1, jacobian.shape[1]))
    np.add.at(scores, block, jacobian * residual[:, None])
    inverse = np.linalg.inv(hessian)
    blocks = len(np.unique(block))
    meat = scores.T @ scores * blocks / max(blocks - 1, 1)
    return np.asarray(np.sqrt(np.maximum(np.diag(inverse @ meat @ inverse), 0.0)))


def amplitude_of(fitted: Fitted, observer: Observer, effect: str) -> tuple[float, tuple[float, float]]:
    """Return the size of an active effect's amplitude and its 90 % interval, in its own unit.

    Noise lengthens an estimated vector on average, so the size is the root of |a|^2 - sum sd^2. Its interval is that of
    the component along the vector (delta method). A vector of length 0 may have any direction, so its interval is that
    of the least certain component.
    """
    before = fitted.active[: fitted.active.index(effect)]
    place = len(fitted.vector) + sum(len(observer.library[name].components) for name in before)
    amplitude = fitted.amplitudes[observer.columns[effect]]
    deviation = fitted.deviation[place : place + len(amplitude)] * observer.library[effect].typical
    if len(amplitude) == 1:
        middle, half = float(amplitude[0]), NORMAL_90 * float(deviation[0])
        return middle, (middle - half, middle + half)
    # A component's deviation is at most its prior's, so that an unidentified component does not dominate the sum.
    spread = np.minimum(deviation, np.abs(amplitude))
    length = size_of(amplitude)
    middle = float(np.sqrt(max(float((amplitude**2 - spread**2).sum()), 0.0)))
    along = float(np.sqrt(((amplitude / length * deviation) ** 2).sum())) if length > 0.0 else float(deviation.max())
    half = NORMAL_90 * along
    return middle, (middle - half, middle + half)

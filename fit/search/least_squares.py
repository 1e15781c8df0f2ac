"""Levenberg-Marquardt least squares within bounds, for a simulator that evaluates many candidates in one batch.

    cost(u) = sum_j r_j(u)^2 + (z(u) - z0)' P (z(u) - z0)
    (J' J + P_u + lambda diag(J' J + P_u)) s = -(J' r + P_u (u - u0))

The working coordinate z is the logarithm of a parameter with a log scale, else the parameter itself. The coordinate u
is z scaled to [0, 1] between its bounds.

One batch gives all columns of J by finite differences. The next batch tries a ladder of dampings lambda side by side
and keeps the best. The projected gradient leaves parameters at a bound out of the step. So the search reaches an
optimum on a bound exactly, and leaves the bound when the slope turns. A ladder is tried even if the linear model
predicts little gain. The cost of cloth has small ripples, and long steps cross the ripples that trap finite
differences.

Source: Marquardt 1963, "An algorithm for least-squares estimation of nonlinear parameters", section 3. The projection:
Kanzow, Yamashita and Fukushima 2004, "Levenberg-Marquardt methods with strong local convergence properties for solving
nonlinear equations with convex constraints". Chords: Broyden 1965, "A class of methods for solving nonlinear
simultaneous equations", method 1.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass

import numpy as np

from fit.errors import BlowUpError, FitError
from formats.arrays import Booleans, Floats

# Share of the box; our choice: wider than the ripples that folds make. A last descent uses a fiftieth (decision 31).
DIFFERENCE = 0.05
# Iterations after which a search stops if its cost is this many times the known cost. Our choice: 1.1 times is 5 % in
# the error, whose square it is. 1.05 and 1.2 change nothing in a fit to the demo's takes.
UNJUDGED, HOPELESS = 4, 1.1
# Relative fall of the cost in one iteration, below which a search above the known cost stops. Our choice: most steps
# across valleys return, and need many iterations for the last thousandths (decision 19).
SLOW_FALL = 0.01

Residuals = Callable[[Floats], Floats]


@dataclass(frozen=True, kw_only=True)
class BoundedSpace:
    """The box of parameters, and which of them are searched on a log scale; each (parameters,)."""

    minimum: Floats
    maximum: Floats
    is_log: Booleans

    def __post_init__(self) -> None:
        if not (self.minimum < self.maximum).all():
            raise FitError(
                "a lower bound is not below its upper bound", where="least squares", advice="check minimum, maximum"
            )
        if (self.is_log & (self.minimum <= 0)).any():
            raise FitError(
                "a parameter on a log scale needs a lower bound above zero", where="least squares",
                advice="raise its minimum, or search it on a linear scale",
            )  # fmt: skip

    @property
    def scale(self) -> Floats:
        """Width of the box in working coordinates, (parameters,)."""
        return self.to_working(self.maximum) - self.to_working(self.minimum)

    def to_working(self, parameters: Floats) -> Floats:
        """Return z(theta), (..., parameters)."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(self.is_log, np.log(np.where(self.is_log, parameters, 1.0)), parameters)

    def to_unit(self, parameters: Floats) -> Floats:
        """Return u(theta) in [0, 1], (..., parameters)."""
        return np.clip((self.to_working(parameters) - self.to_working(self.minimum)) / self.scale, 0.0, 1.0)

    def from_unit(self, unit: Floats) -> Floats:
        """Return theta(u), exactly within the bounds, (..., parameters)."""
        working = self.to_working(self.minimum) + unit * self.scale
        with np.errstate(over="ignore"):  # an interval's end far outside of the box becomes its bound
            parameters = np.where(self.is_log, np.exp(np.where(self.is_log, working, 0.0)), working)
        return np.clip(parameters, self.minimum, self.maximum)

    def slope(self, parameters: Floats) -> Floats:
        """Return d theta / d u at theta, (parameters,): a logarithm's is the width of the box times theta itself."""
        return self.scale * np.where(self.is_log, parameters, 1.0)


@dataclass(frozen=True, kw_only=True)
class Prior:
    """Gaussian prior: mean in the parameters' units, (p,); precision in working coordinates, (p, p)."""

    mean: Floats
    precision: Floats


@dataclass(frozen=True, kw_only=True)
class LeastSquaresSettings:
    """Stopping rules, step sizes and batch width of a least squares search."""

    width: int = 8  # our choice: candidates in one batch, and rungs of a ladder
    max_iterations: int = 30  # our choice: a limit on the cost of one search
    step: float = DIFFERENCE  # finite difference, share of the box
    is_chord: bool = False  # Broyden's update of J instead of new differences until it no longer helps
    renewals: int = 2  # of the Jacobian, when chords find no further step; our choice: a limit, as above
    is_exact: bool = True  # the returned Jacobian is made of differences, at any cost
    damping: float = 1e-2  # first lambda; our choice: the first ladder tries 3e-4 to 0.3
    cost_tolerance: float = 1e-6  # relative fall of the cost; our choice: a deviation of a parameter is 1 / numbers
    step_tolerance: float = 1e-6  # longest step, share of the box; our choice: it moves the end by nothing that shows
    known_cost: float = math.inf  # of a rival fit: a search that will hardly fall below this cost stops


@dataclass(frozen=True, kw_only=True)
class LeastSquaresResult:
    """Result of a least squares search.

    - `parameters`, (p,); `residuals`, (m,)
    - `jacobian`, (m, p): d residual / d working coordinate, the logarithm for log parameters
    - `cost_history`, (iterations + 1,)
    - `slopes_at`, (p,): parameters about which the Jacobian's differences were made, at most a short step away if exact
    """

    parameters: Floats
    residuals: Floats
    jacobian: Floats
    slopes_at: Floats
    prior_precision: Floats
    cost: float
    cost_history: tuple[float, ...]
    simulations: int
    batches: int
    is_converged: bool
    reason: str

    @property
    def precision(self) -> Floats:
        """J' W J + P in working coordinates, (p, p): inverse covariance if residuals are in sigmas."""
        return np.asarray(self.jacobian.T @ self.jacobian + self.prior_precision)

    def covariance(self, variance: float = 1.0) -> Floats:
        """Covariance in working coordinates, (p, p), for residuals of this variance."""
        return np.asarray(variance * np.linalg.pinv(self.precision, hermitian=True))


Search = Generator[Floats, Floats, LeastSquaresResult]  # yields candidates, is sent their residuals


def minimise(
    residuals: Residuals,
    start: Floats,
    space: BoundedSpace,
    *,
    prior: Prior | None = None,
    settings: LeastSquaresSettings | None = None,
    jacobian: Floats | None = None,
) -> LeastSquaresResult:
    """Return the parameters of least cost found from `start`, (p,).

    `residuals(candidates (lanes, p)) -> (lanes, m)` is called with up to `settings.width` candidates; a lane
    with a value that is not finite is never chosen. A known `jacobian`, (m, p), of working coordinates near the start
    saves the differences. A search by chords then returns this Jacobian updated instead of made anew.

    Raises:
        FitError: the start lies outside the bounds.
        BlowUpError: the start itself has no finite residuals.
    """
    settings = settings or LeastSquaresSettings()

    def evaluate(asked: list[Floats]) -> list[Floats]:
        batches = [asked[0][k : k + settings.width] for k in range(0, len(asked[0]), settings.width)]
        return [np.concatenate([residuals(batch) for batch in batches])]

    return side_by_side([search(start, space, prior=prior, settings=settings, jacobian=jacobian)], evaluate)[0]


def search(
    start: Floats,
    space: BoundedSpace,
    *,
    prior: Prior | None = None,
    settings: LeastSquaresSettings | None = None,
    jacobian: Floats | None = None,
) -> Search:
    """Return the search of `minimise` as a generator, so that its caller evaluates the residuals.

    The generator yields candidates, (lanes, p), receives their residuals, (lanes, m), and returns its result.
    """
    return _Search(space, prior, settings or LeastSquaresSettings()).run(start, jacobian)


def side_by_side(
    searches: Sequence[Search], evaluate: Callable[[list[Floats]], list[Floats]]
) -> list[LeastSquaresResult]:
    """Advance several searches together, so that one batch evaluates the candidates of all; return each result.

    evaluate: receives the candidates of each search, (lanes, p), with 0 lanes for a finished search. It returns their
    residuals in the same order.
    """
    ended: list[LeastSquaresResult | None] = [None] * len(searches)
    asked = [next(one) for one in searches]
    while any(result is None for result in ended):
        answers = evaluate(asked)
        for k, one in enumerate(searches):
            if ended[k] is None:
                try:
                    asked[k] = one.send(answers[k])
                except StopIteration as stop:
                    ended[k], asked[k] = stop.value, asked[k][:0]
    return [result for result in ended if result is not None]


@dataclass(frozen=True)
class _Step:
    unit: Floats
    residuals: Floats
    cost: float
    damping: float


class _Search:
    def __init__(self, space: BoundedSpace, prior: Prior | None, settings: LeastSquaresSettings) -> None:
        self.space, self.settings = space, settings
        count = len(space.minimum)
        working_precision = np.zeros((count, count)) if prior is None else prior.precision
        self.working_precision = working_precision
        self.precision = working_precision * np.outer(space.scale, space.scale)
        mean = space.minimum if prior is None else prior.mean
        self.mean = (space.to_working(mean) - space.to_working(space.minimum)) / space.scale
        self.simulations = self.batches = 0

    def run(self, start: Floats, known: Floats | None) -> Search:
        settings = self.settings
        if not ((self.space.minimum <= start) & (start <= self.space.maximum)).all():
            raise FitError("the start lies outside the bounds", where="least squares", advice="move it inside")
        u = self.space.to_unit(start)
        r = (yield from self._evaluate(u[None]))[0]
        if not np.isfinite(r).all():
            raise BlowUpError(
                "the simulation at the start is not finite",
                where="least squares",
                advice="start nearer to typical fabric",
            )
        cost, damping = self._cost(u, r), settings.damping
        history = [cost]
        jacobian = (yield from self._jacobian(u, r)) if known is None else known * self.space.scale
        is_fresh, made_at = True, u  # the Jacobian belongs to u, or is all that the caller pays for
        renewals, is_hopeless, is_far = 0, False, False
        for _ in range(settings.max_iterations):
            normal, slope = self._normal_equations(u, r, jacobian)
            free = ~(((u <= 0) & (slope > 0)) | ((u >= 1) & (slope < 0)))
            moved, reason = None, "no slope is left within the bounds"
            if free.any() and np.abs(slope[free]).max() > 1e-12 * max(1.0, cost):
                # An inexact Jacobian may be the only cause, so new finite differences come before short steps.
                is_outdated = not is_fresh and renewals < settings.renewals
                moved = yield from self._try_dampings(
                    u, cost, normal, slope, free, damping, ladders=1 if is_outdated else 3
                )
                reason = "no step lowers the cost"
            if moved is not None:
                reason = self._reason_to_stop(u, cost, moved)
                step, change = moved.unit - u, moved.residuals - r
                u, r, cost, damping = moved.unit, moved.residuals, moved.cost, moved.damping
                history.append(cost)
                if not settings.is_chord:
                    jacobian, made_at = (yield from self._jacobian(u, r)), u
                elif reason and is_fresh:  # converged: new differences after a short step would be the same
                    shortest = max(settings.step / 2, settings.step_tolerance)
                    is_far = known is None and float(np.abs(step).max()) > shortest
                else:
                    jacobian = jacobian + np.outer(change - jacobian @ step, step) / max(float(step @ step), 1e-30)
                    is_fresh = known is not None
            if reason and (is_fresh or renewals == settings.renewals):
                break
            if self._is_hopeless(history, has_moved=moved is not None):
                is_hopeless, reason = True, "the cost will hardly fall below the known one"
                break
            if reason:  # the updated Jacobian may be the only cause
                jacobian, made_at = (yield from self._jacobian(u, r)), u
                is_fresh, renewals = True, renewals + 1
        else:
            reason = ""
        if (is_far or not is_fresh) and settings.is_exact and not is_hopeless:
            jacobian, made_at = (yield from self._jacobian(u, r)), u
        return LeastSquaresResult(
            parameters=self.space.from_unit(u),
            residuals=r,
            jacobian=jacobian / self.space.scale,
            slopes_at=self.space.from_unit(made_at),
            prior_precision=self.working_precision,
            cost=cost,
            cost_history=tuple(history),
            simulations=self.simulations,
            batches=self.batches,
            is_converged=bool(reason) and not is_hopeless,
            reason=reason or f"stopped after {settings.max_iterations} iterations",
        )

    def _is_hopeless(self, history: list[float], *, has_moved: bool) -> bool:
        """Return whether a search is far above the known cost after a few iterations, or above it without falling."""
        cost, known = history[-1], self.settings.known_cost
        is_slow = not has_moved or cost > (1 - SLOW_FALL) * history[-2]
        return cost > known and (is_slow or (len(history) > UNJUDGED and cost > HOPELESS * known))

    def _reason_to_stop(self, u: Floats, cost: float, moved: _Step) -> str:
        if (cost - moved.cost) / max(cost, 1e-300) < self.settings.cost_tolerance:
            return "the cost has stopped falling"
        if float(np.abs(moved.unit - u).max()) < self.settings.step_tolerance:
            return "the steps have become short"
        return ""

    def _evaluate(self, units: Floats) -> Generator[Floats, Floats, Floats]:
        self.simulations += len(units)
        self.batches += math.ceil(len(units) / self.settings.width)
        return np.asarray((yield self.space.from_unit(units)), dtype=float)

    def _cost(self, u: Floats, r: Floats) -> float:
        if not np.isfinite(r).all():
            return math.inf
        return float((r**2).sum() + (u - self.mean) @ self.precision @ (u - self.mean))

    def _normal_equations(self, u: Floats, r: Floats, jacobian: Floats) -> tuple[Floats, Floats]:
        return jacobian.T @ jacobian + self.precision, jacobian.T @ r + self.precision @ (u - self.mean)

    def _jacobian(self, u: Floats, r: Floats) -> Generator[Floats, Floats, Floats]:
        """Return d residual / d u, (m, p); a column that blew up uses the opposite difference, or is zero."""
        h = self.settings.step
        inward = np.where(u + h <= 1, h, -h)
        aside = u + np.diag(inward)
        columns = ((yield from self._evaluate(aside)) - r) / inward[:, None]
        broken = ~np.isfinite(columns).all(1)
        if broken.any():
            back = np.clip(u - np.diag(inward), 0, 1)[broken]
            step = (back - u).sum(1)
            found = yield from self._evaluate(back)
            with np.errstate(invalid="ignore", divide="ignore"):
                columns[broken] = (found - r) / step[:, None]
            columns[~np.isfinite(columns).all(1)] = 0.0
        return columns.T

    def _try_dampings(
        self,
        u: Floats,
        cost: float,
        normal: Floats,
        slope: Floats,
        free: Booleans,
        damping: float,
        ladders: int,
    ) -> Generator[Floats, Floats, _Step | None]:
        """Return the best improvement from up to three ladders of damping values, or None."""
        rungs = self.settings.width
        # One ladder spans lambda/30 to 30 lambda and more; three reach from Gauss-Newton to short steps downhill.
        factors = 10.0 ** np.linspace(-1.5, 1.5, rungs) if rungs > 1 else np.array([0.1])
        for _ in range(ladders if rungs > 1 else 4 * ladders):
            ladder = np.clip(damping * factors, 1e-12, 1e12)
            tries = np.stack([self._trial(u, normal, slope, free, rung) for rung in ladder])
            found = yield from self._evaluate(tries)
            costs = np.array([self._cost(a, b) for a, b in zip(tries, found, strict=True)])
            best = int(np.argmin(costs))
            if costs[best] < cost:
                return _Step(tries[best], found[best], float(costs[best]), float(ladder[best]))
            damping *= 10.0 ** (3.0 if rungs > 1 else 1.0)
        return None

    def _trial(self, u: Floats, normal: Floats, slope: Floats, free: Booleans, damping: float) -> Floats:
        reduced = normal[np.ix_(free, free)]
        diagonal = np.diag(reduced)
        # A zero column would make the system singular; a small share of the largest diagonal prevents this.
        floor = 1e-9 * max(float(diagonal.max()), 1e-300)
        step = np.zeros_like(u)
        step[free] = np.linalg.solve(reduced + np.diag(damping * diagonal + floor), -slope[free])
        return np.clip(u + step, 0.0, 1.0)

"""One least squares search on the points' residuals: several independent trials, and a comparison of their ends.

A trial simulates many candidates: the start, scattered candidates, then the proposals of an emulator of the residuals
(`fit.search.sampling`). From the best candidate Levenberg-Marquardt descends by chords (`fit.search.least_squares`).
Its differences are wide enough to step over the ripples that folds make. More descents begin at the best candidates
across the valleys about the end (`fit.search.valleys`).

Another trial then begins from other scattered candidates. Trials stop when two of them agree in their cost, or at
their largest number. The first emulator may have chosen a wrong local minimum, and two independent trials seldom choose
the same wrong one. A cost that noise explains is no sign of the right minimum. Chi square of n numbers varies by
sqrt(2 n), and one deviation of a parameter changes it by 1 (decision 38). The best end then descends with finer
differences to its local minimum, because wide differences stop on the slope above it.

Without samples there is one trial, without a finer last descent. Its descents begin at the start and at scattered
candidates.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from fit.errors import BlowUpError
from fit.identification.problem import ObservedProblem
from fit.search import sampling, valleys
from fit.search.correlation import independent
from fit.search.emulator import Emulator
from fit.search.intervals import PRIOR_SD, Intervals, LinearModel, block_intervals
from fit.search.least_squares import LeastSquaresResult, LeastSquaresSettings, Prior, minimise
from fit.search.posterior import draw
from fit.search.steps import Step
from formats.arrays import Floats

RIPPLE_TIME = 2.0  # s: duration of the ripples in which descents end
# Descents under each pull without samples, the first from the start itself; our choice: a limit on the cost.
STARTS_A_PULL = 4
SCANS_ACROSS = 3  # at most: scans across the valleys about an end
WORTH = 0.005  # of the cost: least gain for a further scan across, and largest difference between two trials that agree
# Logarithm of an end's cost over the least one, that chance makes at most: an end beyond it stopped on a slope. Our
# choice: ten times `WORTH`. Without a limit one wild descent would leave nothing identified. Without it the values held
# on the default mesh (decision 40) are 90 in place of 88 % of the demo's takes.
MOST_BY_CHANCE = 0.05
NEXT_SEED = 7919  # added to the seed of each further trial, far from seeds that a user would choose in turn
# Of descents before the last one. Our choice: a thousandth of the error, whose square is the cost, is less than `WORTH`
# tells apart. A fit to the demo's takes has the same end with half and double of the cost's tolerance. Half takes 396
# simulations in place of 388.
FIRST_SETTINGS = LeastSquaresSettings(is_chord=True, renewals=0, cost_tolerance=2e-3, step_tolerance=1e-3)
LAST_SETTINGS = LeastSquaresSettings(
    is_chord=True, renewals=1, cost_tolerance=1e-4, step_tolerance=1e-3, step=0.02, max_iterations=8
)


@dataclass(frozen=True, kw_only=True)
class ObservedSettings:
    """The settings of a search.

    - `samples`: candidates before one descent from the best of them, 0 or at least SCATTERED
    - `trials`: largest number of trials, while no two ends agree
    - `pulls`: [Hz] of each descent in turn
    - `iterations`: under each pull
    - `width`: of a batch
    - `seed`: of the scattered candidates
    """

    samples: int = 0
    trials: int = 1
    pulls: tuple[float, ...] = (0.0,)
    iterations: int = 6  # our choice: a limit on the cost of one descent
    width: int = 4  # our choice: candidates that one batch simulates
    seed: int = 0

    @property
    def steps(self) -> int:
        """Return the largest possible number of batches of samples and of descents, together."""
        if not self.samples:
            return STARTS_A_PULL * len(self.pulls)
        proposed = math.ceil(max(self.samples - sampling.SCATTERED, 0) / len(sampling.CAUTIONS))
        return self.trials * (1 + proposed + len(self.pulls) + SCANS_ACROSS * (1 + valleys.HOPPED)) + 1


@dataclass(frozen=True, kw_only=True)
class Observed:
    """Result of a search.

    - `vector`, (parameters,)
    - `ends`: cost and vector of each descent
    - `path`: batches of samples and descents, in turn
    - `simulations`: of all recordings, with those for the intervals
    """

    vector: Floats
    intervals: Intervals
    ends: list[tuple[float, Floats]]
    simulations: int
    path: list[Step] = field(repr=False)


Progress = Callable[[Step], None]


def is_settled(costs: Sequence[float]) -> bool:
    """Return whether no further trial is needed: the two least costs agree."""
    best, *others = sorted(costs)
    return bool(others) and others[0] <= (1 + WORTH) * best


def scatter_of(costs: Sequence[float]) -> float:
    """Return the root mean square of ln(cost / least cost) over the trials, from their costs, (trials,)."""
    best, *others = sorted(cost for cost in costs if math.isfinite(cost))
    return math.sqrt(sum(math.log(other / best) ** 2 for other in others) / len(others)) if others else 0.0


def between_ends(apart: Floats, rise: Floats, pieces: float) -> Floats:
    """Return the likelihood-weighted mean square of ends about the best one, (parameters, parameters).

    - `apart`, (ends, parameters): from the best end
    - `rise`, (ends,): logarithm of each cost over the least cost
    - `pieces`: N, independent numbers
    """
    weights = np.exp(-0.5 * pieces * rise)
    return np.asarray((weights[:, None] * apart).T @ apart / weights.sum())


class Run:
    """State of a running search: the simulated candidates, their residuals, and the best candidate."""

    def __init__(
        self, search: ObservedProblem, start: Floats, settings: ObservedSettings, progress: Progress,
        known: Sequence[Step],
    ) -> None:  # fmt: skip
        self.search, self.start, self.settings, self.progress = search, start, settings, progress
        self.waiting, self.path = list(known), list[Step]()
        self.prior = Prior(mean=start, precision=np.diag((PRIOR_SD * search.space.scale) ** -2))
        self.unit = search.space.to_unit(start)
        self.units = np.zeros((0, len(start)))  # simulated as samples
        self.first = 0  # index of this trial's first candidate
        self.residuals: Floats | None = None
        self.costs = np.zeros(0)
        self.best: tuple[float, float] = (np.inf, np.inf)  # least cost, and D there
        self.least: list[float] = []  # final cost of each trial
        self.distances: list[float] = []  # since the last step
        self.before = search.free.simulations

    def run(self) -> Observed:
        """Run trials until they agree, descend from the best end, and return its final parameters with intervals."""
        ends = self._try()
        while len(self.least) < self.settings.trials and not is_settled(self.least):
            self.first = len(self.units)
            ends += self._try()
        end, best = min(ends, key=lambda pair: pair[0].cost)
        manner = LAST_SETTINGS if self.settings.samples else FIRST_SETTINGS
        if manner is LAST_SETTINGS:
            end, best = self._descend(self.settings.pulls[-1], end.vector, manner)
            ends.append((end, best))
        best = best or self._again(end, manner)
        return Observed(
            vector=best.parameters, intervals=self._intervals(best, [one for one, _ in ends]),
            ends=[(one.cost, one.vector) for one, _ in ends], simulations=self._simulations(), path=self.path,
        )  # fmt: skip

    def _try(self) -> list[tuple[Step, LeastSquaresResult | None]]:
        """Run one trial: samples, descents from the best candidate and across valleys; return the ends."""
        if self.settings.samples:
            self._sample()
        ends: list[tuple[Step, LeastSquaresResult | None]] = []
        for number, start in enumerate(self._starts()):
            for pull in self.settings.pulls:
                descent, found = self._descend(pull, start)
                if not (number or self.least) and not np.isfinite(descent.cost):
                    raise self._blown_up()
                start = descent.vector
                if not np.isfinite(descent.cost):
                    break  # a scattered start that cannot be simulated is skipped
            else:
                ends.append((descent, found))
        for _ in range(SCANS_ACROSS if self.settings.samples and ends else 0):
            before, found = min(ends, key=lambda pair: pair[0].cost)
            ends += (beyond := self._across(before, found))
            if all(end.cost > (1 - WORTH) * before.cost for end, _ in beyond):
                break
        self.least.append(min((end.cost for end, _ in ends), default=np.inf))
        return ends

    def _sample(self) -> None:
        """Simulate scattered candidates, then the emulator's proposals, up to the number of samples in the settings."""
        space, samples = self.search.space, self.settings.samples
        while len(self.units) - self.first < samples:
            if self.waiting and self.waiting[0].is_sampling:
                vectors, known = self.waiting[0].vectors, self.waiting.pop(0)
            else:
                known = None
                units = self._next_units()[: samples - (len(self.units) - self.first)]
                if not len(units):
                    break
                vectors = space.from_unit(units)
            self._evaluate(vectors)
            self._record_samples(vectors, known)

    def _evaluate(self, vectors: Floats) -> Floats:
        """Simulate candidates, (candidates, parameters), keep them and return their costs, (candidates,)."""
        residuals = self._simulate(vectors, 0.0)
        if self.residuals is None and not np.isfinite(residuals[0]).all():
            raise self._blown_up()
        costs = self._costs(vectors, residuals)
        self.units = np.concatenate([self.units, self.search.space.to_unit(vectors)])
        self.residuals = residuals if self.residuals is None else np.concatenate([self.residuals, residuals])
        self.costs = np.append(self.costs, costs)
        return costs

    def _record_samples(self, vectors: Floats, known: Step | None) -> None:
        least = int(np.argmin(self.costs))
        best = self.search.space.from_unit(self.units[least])
        self._take(
            known
            or Step(
                is_sampling=True, vector=best, cost=float(self.costs[least]), vectors=vectors,
                simulations=self._simulations(), distances=tuple(self.distances), slopes_at=best,
            ),
            is_known=known is not None,
        )  # fmt: skip

    def _across(self, step: Step, found: LeastSquaresResult | None) -> list[tuple[Step, LeastSquaresResult | None]]:
        """Simulate candidates across the valleys about an end, and descend from the best of them."""
        space, pull = self.search.space, self.settings.pulls[-1]
        found = found or self._again(step, FIRST_SETTINGS)
        judged: list[Floats] = []

        def judge(units: Floats) -> Floats:
            judged.append(space.from_unit(units))
            return self._evaluate(judged[-1])

        precision = np.eye(len(self.unit)) / PRIOR_SD**2
        end, slopes = space.to_unit(found.parameters), found.jacobian * space.scale
        units = valleys.across(end, slopes, precision, found.cost, self.search.count, judge)
        if not judged:
            return []
        self._record_samples(judged[0], self.waiting.pop(0) if self.waiting else None)
        ends = [self._descend(pull, start) for start in space.from_unit(units)]
        return [end for end in ends if np.isfinite(end[0].cost)]

    def _next_units(self) -> Floats:
        seed = self.settings.seed + len(self.least) * NEXT_SEED
        if self.residuals is None:
            return sampling.scatter(self.unit, seed)
        if len(self.units) == self.first:
            return sampling.spread(len(self.unit), sampling.SCATTERED, seed)
        return sampling.propose(self.units[self.first :], self.residuals[self.first :], self.unit, seed)

    def _starts(self) -> list[Floats]:
        """Return the starts of descents: the best candidate so far, or the start and scattered candidates."""
        space = self.search.space
        if self.settings.samples:
            return [space.from_unit(self.units[self.first + int(np.argmin(self.costs[self.first :]))])]
        return [self.start, *space.from_unit(sampling.scatter(self.unit, self.settings.seed)[1:STARTS_A_PULL])]

    def _descend(
        self, pull: float, start: Floats, manner: LeastSquaresSettings | None = None
    ) -> tuple[Step, LeastSquaresResult | None]:
        """Descend from a start with the given settings, or return the known descent; the caller stores the result."""
        if self.waiting:
            known = self.waiting.pop(0)
            self.best = min(self.best, (known.cost, known.distances[-1] if known.distances else np.inf))
            self._take(known, is_known=True)
            return known, None
        found = None
        with suppress(BlowUpError):
            found = self._minimise(
                pull, start, manner or replace(FIRST_SETTINGS, max_iterations=self.settings.iterations)
            )
        step = Step(
            is_sampling=False, vector=found.parameters if found else start, cost=found.cost if found else np.inf,
            vectors=np.zeros((0, len(start))), simulations=self._simulations(), distances=tuple(self.distances),
            slopes_at=found.slopes_at if found else start,
        )  # fmt: skip
        self._take(step, is_known=False)
        return step, found

    def _again(self, end: Step, manner: LeastSquaresSettings) -> LeastSquaresResult:
        """Return the end of a descent of an interrupted search; its repeated simulations do not count."""
        counted, pull = self.search.free.simulations, self.settings.pulls[-1]
        manner = replace(manner, max_iterations=0)
        found = self._minimise(pull, end.vector, manner)
        if not np.array_equal(end.slopes_at, end.vector):
            slopes = self._minimise(pull, end.slopes_at, manner).jacobian
            found = replace(found, jacobian=slopes, slopes_at=end.slopes_at)
        self.before += self.search.free.simulations - counted
        self.distances = []
        return found

    def _minimise(self, pull: float, start: Floats, manner: LeastSquaresSettings) -> LeastSquaresResult:
        return minimise(
            lambda vectors: self._simulate(vectors, pull), start, self.search.space, prior=self.prior,
            settings=replace(manner, width=self.settings.width),
        )  # fmt: skip

    def _simulate(self, vectors: Floats, pull: float) -> Floats:
        """Return residuals, (candidates, numbers), and record the values of D."""
        residuals, distances = self.search.simulate(vectors, pull)
        for cost, distance in zip(self._costs(vectors, residuals), distances, strict=False):
            self.best = min(self.best, (float(cost), float(distance)))
            self.distances.append(self.best[1])
        return residuals

    def _costs(self, vectors: Floats, residuals: Floats) -> Floats:
        costs = (residuals**2).sum(1) + sampling.prior_cost(self.search.space.to_unit(vectors), self.unit)
        return np.where(np.isfinite(costs), costs, np.inf)

    def _take(self, step: Step, *, is_known: bool) -> None:
        self.path.append(step)
        self.distances = []
        if is_known:  # the saved count holds; repeated simulations are not added
            self.before = self.search.free.simulations - step.simulations
        else:
            self.progress(step)

    def _simulations(self) -> int:
        return self.search.free.simulations - self.before

    def _blown_up(self) -> BlowUpError:
        return BlowUpError(
            "the simulation of the initial parameters blew up",
            where=self.search.free.recordings[0].take_id,
            advice="use a coarser mesh (a larger spacing) or check the garment's weight",
        )

    def _intervals(self, best: LeastSquaresResult, ends: list[Step]) -> Intervals:
        """Return intervals about the best end, at least as wide as the spread of other parameters that fit as well."""
        space, observer = self.search.space, self.search.free
        unit = space.to_unit(best.parameters)
        between, spread = np.zeros((len(unit), len(unit))), np.zeros(len(unit))
        apart = np.stack([space.to_unit(end.vector) for end in ends]) - unit
        rise = np.log(np.array([end.cost for end in ends]) / best.cost)
        is_sound = np.isfinite(self.costs)
        if self.residuals is not None and is_sound.sum() > sampling.fewest(len(unit)):
            finite = self.residuals[is_sound]
            emulator = Emulator(self.units[is_sound], finite @ finite.T)
            starts = self.units[np.argsort(self.costs, kind="stable")][: is_sound.sum() // 2]

            def cost(units: Floats) -> Floats:
                return emulator.costs(units, 1.0)[0] + sampling.prior_cost(units, self.unit)

            pieces = independent(observer.by_place(best.residuals[observer.layout.is_judged]))
            by_chance = np.minimum(rise, MOST_BY_CHANCE)
            of_ends = float(np.sqrt((by_chance**2).sum() / max(len(ends) - 1, 1)))
            pieces = 2 / max(scatter_of(self.least), of_ends, 2 / pieces)
            drawn = draw(cost, starts, pieces, self.settings.seed) - unit
            spread = np.sqrt(np.maximum((drawn**2).mean(0), np.diag(between_ends(apart, rise, pieces))))
        else:
            duration = sum(recording.duration for recording in observer.recordings)
            between = between_ends(apart, rise, duration / RIPPLE_TIME)
        model = LinearModel(
            parameters=best.parameters,
            residuals=best.residuals,
            jacobian=best.jacobian * space.scale,
            block=observer.layout.block,
        )
        return block_intervals(space, model, between=between, spread=spread)

"""Least squares on the points' residuals from several starts, free or weakly pulled to the measured points.

The first start is the initial parameters, the others are scattered over the box. From each, Levenberg-Marquardt goes
down by chords (`fit.search.least_squares`), with differences wide enough to step over the ripples that folds make. A
weak prior, the box's own spread about the initial parameters, holds what the data cannot tell. With a pull (of the
observer, `fit.gap.observer`) each start goes down under it first and then free.

Ripples leave many small valleys, so one valley's curvature says too little of how far a parameter can be trusted.
The deviation of a parameter is that of `fit.search.intervals` in the best valley and what the starts' ends differ by:

    V = V_jackknife + sum_k w_k (u_k - u) (u_k - u)' / sum_k w_k,      w_k = (cost_k / cost)^(-N/2)

with u in shares of the box and N the independent pieces of the recording, taken to last two seconds here, because a
ripple goes on for a swing or two: ends that fit much worse count little. That is the likelihood of Gaussian errors
whose deviation is not known, at its maximum over the deviation.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fit.cloth.simulator import Resolution
from fit.effects.base import Effect
from fit.errors import BlowUpError
from fit.gap.observer import Observer
from fit.parameterisations import Parameterisation
from fit.recording import Recording, Windows
from fit.search.intervals import PRIOR_SD, Intervals, block_intervals, check_blocks
from fit.search.least_squares import BoundedSpace, LeastSquaresResult, LeastSquaresSettings, Prior, minimise

Floats = NDArray[np.float64]

RIPPLE_TIME = 2.0  # s that a ripple lasts
SHORT_WINDOWS = Windows(free=2.0, caught=0.5)  # a swing or two
CATCHING = 3.0  # Hz of the pull between short windows
MARGIN = 0.15  # of the box that scattered starts leave out at each end: rarely true, often costly


@dataclass(frozen=True, kw_only=True)
class ObservedSettings:
    """Starts, pulls [Hz] that each goes down under in turn, iterations under each, batch width, seed of the starts."""

    starts: int = 4
    pulls: tuple[float, ...] = (0.0,)
    iterations: int = 6
    width: int = 4
    seed: int = 0


@dataclass(frozen=True, kw_only=True)
class Descent:
    """Where one descent ended: vector, (parameters,), and its cost, infinite where its start blew up.

    simulations: of all recordings since the search began
    """

    vector: Floats
    cost: float
    simulations: int

    def state(self) -> dict[str, Any]:
        """Return it as JSON can hold it."""
        cost = self.cost if np.isfinite(self.cost) else None
        return {"vector": self.vector.tolist(), "cost": cost, "simulations": self.simulations}

    @classmethod
    def from_state(cls, state: Mapping[str, Any]) -> Descent:
        """Return the descent that was saved."""
        cost = np.inf if state["cost"] is None else float(state["cost"])
        return cls(vector=np.array(state["vector"], float), cost=cost, simulations=int(state["simulations"]))


@dataclass(frozen=True, kw_only=True)
class Observed:
    """Where it ended.

    vector, (parameters,); ends: per start its cost and vector, the given start first; path: the descents, in turn.
    """

    vector: Floats
    intervals: Intervals
    ends: list[tuple[float, Floats]]
    simulations: int
    path: list[Descent] = field(repr=False)


Progress = Callable[[Descent], None]


class ObservedSearch:
    """The search on some recordings for the parameters of a method and the amplitudes of some effects."""

    def __init__(
        self,
        recordings: list[Recording],
        method: Parameterisation,
        effects: tuple[Effect, ...],
        space: BoundedSpace,
        resolution: Resolution,
        *,
        windows: Windows | None = None,
    ) -> None:
        """Prepare it; with `windows` the pulls of the settings act between these only."""
        cut = [dataclasses.replace(recording, windows=windows) for recording in recordings]
        self.free = Observer(cut, method, effects, frequency=0.0, resolution=resolution)
        self.space = space
        self._count = len(method.parameters)

    def run(
        self,
        start: Floats,
        settings: ObservedSettings | None = None,
        progress: Progress = lambda descent: None,
        known: Sequence[Descent] = (),
    ) -> Observed:
        """Search from the start, (parameters,), and from scattered ones; `progress` is told of each descent.

        known: the first descents of an interrupted search of the same kind, which are not made again.

        Raises:
            FitError: the recordings are too short for intervals.
            BlowUpError: the start cannot be simulated.
        """
        check_blocks(self.free.layout.block)
        settings = settings or ObservedSettings()
        prior = Prior(mean=start, precision=np.diag((PRIOR_SD * self.space.scale) ** -2))
        earlier = known[-1].simulations - self.free.simulations if known else 0
        waiting, path, ends = list(known), [], []
        results: dict[int, LeastSquaresResult | None] = {}  # by start; those of known descents are not here
        for number, place in enumerate(self._starts(start, settings)):
            for pull in settings.pulls:
                if waiting:
                    descent = waiting.pop(0)
                else:
                    results[number] = found = self._descend(pull, place, prior, settings)
                    descent = Descent(
                        vector=found.parameters if found else place, cost=found.cost if found else np.inf,
                        simulations=self.free.simulations + earlier,
                    )  # fmt: skip
                    if not number and found is None:
                        raise BlowUpError(
                            "the simulation of the initial parameters blew up",
                            where=self.free.recordings[0].take_id,
                            advice="use a coarser mesh (--spacing) or check the garment's weight",
                        )
                    progress(descent)
                path.append(descent)
                place = descent.vector
                if not np.isfinite(descent.cost):
                    break  # a scattered start that cannot be simulated is no loss
            else:
                ends.append((number, descent))
        number, end = min(ends, key=lambda pair: pair[1].cost)
        best = results.get(number) or self._descend(
            settings.pulls[-1], end.vector, prior, dataclasses.replace(settings, iterations=0)
        )
        assert best is not None, "what was simulated once does not blow up again"
        return Observed(
            vector=best.parameters, intervals=self._intervals(best, [end for _, end in ends]),
            ends=[(end.cost, end.vector) for _, end in ends], simulations=self.free.simulations + earlier, path=path,
        )  # fmt: skip

    def _starts(self, start: Floats, settings: ObservedSettings) -> list[Floats]:
        from scipy.stats import qmc

        if settings.starts < 2:
            return [start]
        sobol = qmc.Sobol(len(start), rng=np.random.default_rng(settings.seed))
        units = MARGIN + (1 - 2 * MARGIN) * np.stack([sobol.random(1)[0] for _ in range(settings.starts - 1)])
        return [start, *self.space.from_unit(units)]

    def _descend(
        self, pull: float, start: Floats, prior: Prior, settings: ObservedSettings
    ) -> LeastSquaresResult | None:
        """Where the descent from a start ends; None where the start blows up."""
        observer = self.free.with_frequency(pull)
        least = LeastSquaresSettings(
            width=settings.width, max_iterations=settings.iterations, cost_tolerance=2e-3, step_tolerance=1e-3,
            is_chord=True, renewals=0,
        )  # fmt: skip
        count = self._count
        try:
            return minimise(
                lambda vectors: observer.residuals(vectors[:, :count], vectors[:, count:]), start, self.space,
                prior=prior, settings=least,
            )  # fmt: skip
        except BlowUpError:
            return None

    def _intervals(self, best: LeastSquaresResult, ends: list[Descent]) -> Intervals:
        block = self.free.layout.block
        units = np.stack([self.space.to_unit(end.vector) for end in ends])
        costs = np.array([end.cost for end in ends])
        pieces = sum(recording.duration for recording in self.free.recordings) / RIPPLE_TIME
        weights = (costs / best.cost) ** (-0.5 * pieces)
        apart = units - self.space.to_unit(best.parameters)
        between = (weights[:, None] * apart).T @ apart / weights.sum()
        return block_intervals(
            self.space, best.parameters, best.residuals, best.jacobian * self.space.scale, block, between=between
        )


def begin_observed(
    name: str, recordings: list[Recording], method: Parameterisation, effects: tuple[Effect, ...],
    space: BoundedSpace, resolution: Resolution, seed: int,
) -> tuple[ObservedSearch, ObservedSettings]:  # fmt: skip
    """Return the search of this name, one of `fit.search.choice.OBSERVED`, and how it is run."""
    windows, pull = (SHORT_WINDOWS, CATCHING) if name == "short-windows" else (None, 0.0)
    search = ObservedSearch(recordings, method, effects, space, resolution, windows=windows)
    return search, ObservedSettings(pulls=(pull,), seed=seed)

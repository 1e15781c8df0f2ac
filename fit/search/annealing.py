"""Simulated annealing by the published formulas, with several proposals evaluated in one batch.

    v_i    = theta_si tan(pi (p1 - 1/2)) mu T_t^sigma                        (2)
    T_t    = T_(t-1) / (1 + beta t)^alpha                                    (3)
    change = D(theta_t) - D(theta_t + v)                                     (4)
    A      = min(1, exp(change gamma / T_t)); theta_t + v if p2 <= A         (5)

Source: "Estimating the clothes characteristics with the image and depth sensors for developing virtual fitting room",
equations 2 to 5. Its settings: T_0 = 1000, 350 iterations, alpha = 0.003, beta = 1, mu = 0.1, sigma = 0.6, theta_s from
its Table 2.

The paper leaves five things open. We chose the following. `AnnealingSettings` holds gamma and the rule at a bound:

- gamma is 1e5 per metre. T falls from 1000 to 5.9. At the start, a step that makes D 10 mm worse passes with
  probability 1/e. At the end, 0.06 mm has the same probability. We chose gamma on two stand-ins for D
  (`benchmarks/annealing_gamma.py`, 30 seeds, 350 iterations). With 1e1 to 1e3 the chain keeps wandering and ends 8 to
  16 mm worse. From 1e4 on, one local minimum is found equally well. But 1e4 settles more often in the wrong one of two
  local minima (median 48 mm against 38). Beyond 1e5 nothing more is gained.
- A proposal beyond a bound is reflected back. Early steps are 6 intervals wide, wider than most ranges. Clipping puts
  these steps on several bounds at once and ends 3 to 20 mm worse on the stand-ins. Redrawing is as good as reflecting.
- Iteration t = 1 uses T_1 in both (2) and (5): the temperature is lowered first.
- p1 is drawn anew for each parameter, p2 once per iteration, in this order, also where (5) does not need it.
- theta_0 is evaluated before the first iteration and is not counted as one.

Every iteration uses up the same number of random numbers, accepted or not. So the numbers of later iterations are known
in advance. `ask(width)` returns the tree of the `width` proposals that are most likely to be reached
(`fit.search.speculation`). `tell` walks the branch that the distances choose. The chain is the same, bit for bit, for
every width. Wider batches need fewer calls.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from fit.errors import FitError
from fit.search import PRINTED_ITERATIONS, bounds
from fit.search.speculation import Branch, grow
from formats.arrays import Floats

OUTCOMES_KEPT = 64  # last proposals that estimate the next acceptance probability; changes speed only, never the chain
SMALLEST_CHANCE = 1e-300  # of p2, so that its logarithm is finite; a drawn p2 is 0 or above 1e-16


@dataclass(frozen=True, kw_only=True)
class AnnealingSettings:
    """The factors of equations 2 to 5, and what the paper leaves open."""

    iterations: int = PRINTED_ITERATIONS
    # The paper's, like the next four.
    start_temperature: float = 1000.0  # T_0
    alpha: float = 0.003  # 1, equation 3
    beta: float = 1.0  # 1, equation 3
    mu: float = 0.1  # 1, equation 2
    sigma: float = 0.6  # 1, equation 2
    gamma: float = 1e5  # 1/m; our choice: the paper gives none
    beyond_bounds: Literal["reflect", "clip", "redraw"] = "reflect"

    def cooled(self, temperature: float, iteration: int) -> float:
        """Return T_t of equation 3 from T_(t-1), for iteration t counted from 1."""
        cooling: float = (1 + self.beta * iteration) ** self.alpha
        return temperature / cooling  # (3)

    def temperature(self, iteration: int) -> float:
        """Return T_t for iteration t counted from 1."""
        temperature = self.start_temperature
        for t in range(1, iteration + 1):
            temperature = self.cooled(temperature, t)
        return temperature

    def lasting(self, iterations: int) -> AnnealingSettings:
        """Return settings that cool to the same last temperature within this number of iterations.

        A shortened published schedule would stay hot: of its first 40 proposals hardly one improves on the start.
        """
        if iterations == self.iterations:
            return self
        return dataclasses.replace(
            self,
            iterations=iterations,
            alpha=self.alpha * self._cooling(self.iterations) / self._cooling(iterations),
        )

    def _cooling(self, iterations: int) -> float:
        return sum(math.log1p(self.beta * t) for t in range(1, iterations + 1))


@dataclass(frozen=True)
class AnnealingStep:
    """The record of one iteration; iteration 0 is the start.

    - `temperature` [1]: T_t of equation 3
    - `proposed`, `current`, `best` [m]: distances of the proposal, of the chain's candidate and of the best so far
    """

    iteration: int
    temperature: float
    proposed: float
    current: float
    best: float
    is_accepted: bool


@dataclass(frozen=True)
class SearchBox:
    """Bounds and standard steps of the parameters, each (parameters,), in the parameters' own units."""

    minimum: Floats
    maximum: Floats
    interval: Floats

    def __post_init__(self) -> None:
        if not (self.minimum.shape == self.maximum.shape == self.interval.shape):
            raise FitError(
                "bounds and intervals differ in number", where="search box", advice="give each parameter all three"
            )
        if not (np.isfinite(self.interval).all() and (self.minimum < self.maximum).all()):
            raise FitError(
                "a lower bound is not below its upper bound",
                where="search box",
                advice="check minimum, maximum, interval",
            )


class Annealing:
    """One annealing chain: `ask` returns candidates and `tell` receives their distances, until `is_finished`."""

    def __init__(
        self, start: Floats, box: SearchBox, settings: AnnealingSettings, generator: np.random.Generator
    ) -> None:
        """Start a chain at `start`, (parameters,), in the parameters' own units.

        Raises:
            FitError: the start lies outside the bounds.
        """
        if not ((box.minimum <= start) & (start <= box.maximum)).all():
            raise FitError(
                "the start of the search lies outside the bounds", where="annealing", advice="move it inside"
            )
        self.settings, self.box = settings, box
        self._generator = generator
        self._draws: list[Floats] = []  # [p1 of each parameter, p2] of the future iterations
        self._temperature = settings.start_temperature
        self._asked: list[Branch] = []
        self._changes: list[float] = []
        self.iteration = 0
        self.is_started = False
        self.current, self.current_distance = start.copy(), math.inf
        self.best, self.best_distance = start.copy(), math.inf
        self.steps: list[AnnealingStep] = []
        self.evaluations = 0
        self.non_finite = 0

    @property
    def is_finished(self) -> bool:
        """Return whether all iterations are done."""
        return self.is_started and self.iteration >= self.settings.iterations

    @property
    def best_history(self) -> Floats:
        """Best distance so far [m], (iterations + 1,), the start first."""
        return np.array([step.best for step in self.steps])

    def ask(self, width: int = 1) -> Floats:
        """Return the next 1 to `width` proposals, (candidates, parameters), or none if the search is finished."""
        if width < 1:
            raise ValueError("a batch needs at least one candidate")
        self._asked = grow(
            self.current,
            width,
            depth=self.settings.iterations - self.iteration,
            is_started=self.is_started,
            propose=self._propose,
            acceptance=self._guess_acceptance,
        )
        if not self._asked:
            return np.empty((0, len(self.current)))
        return np.stack([branch.candidate for branch in self._asked])

    def tell(self, candidates: Floats, distances: Floats) -> int:
        """Receive the distances [m], (candidates,), of the last `ask`; return the iterations done.

        A distance that is not finite counts as infinitely far: it is rejected and counted in `non_finite`.
        """
        asked = self._asked
        if len(asked) != len(candidates) or len(distances) != len(candidates):
            raise ValueError("tell() wants one distance for each candidate of the last ask()")
        if any(not np.array_equal(b.candidate, c) for b, c in zip(asked, candidates, strict=True)):
            raise ValueError("tell() wants the candidates of the last ask(), unchanged and in order")
        self._asked = []
        self.evaluations += len(asked)
        done, at = 0, 0 if asked else None
        while at is not None:
            branch, distance = asked[at], float(distances[at])
            if not math.isfinite(distance):
                self.non_finite += 1
                distance = math.inf
            if branch.is_start:
                is_accepted = True
                self._start(distance)
            else:
                is_accepted = self._step(branch.candidate, distance)
                done += 1
            at = branch.if_accepted if is_accepted else branch.if_rejected
        return done

    def state(self) -> dict[str, Any]:
        """Return the state as plain values for JSON; call `ask` again after `restore`."""
        return {
            "settings": dataclasses.asdict(self.settings),
            "generator": _plain(self._generator.bit_generator.state),
            "draws": [draw.tolist() for draw in self._draws],
            "iteration": self.iteration,
            "temperature": self._temperature,
            "is_started": self.is_started,
            "current": self.current.tolist(),
            "current_distance": _number(self.current_distance),
            "best": self.best.tolist(),
            "best_distance": _number(self.best_distance),
            "changes": [_number(change) for change in self._changes],
            "steps": [[_number(value) for value in dataclasses.astuple(step)] for step in self.steps],
            "evaluations": self.evaluations,
            "non_finite": self.non_finite,
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from a state that `state()` returned, with the same settings and kind of random generator.

        Raises:
            FitError: the state is of a search with other settings.
        """
        if dict(state["settings"]) != dataclasses.asdict(self.settings):
            raise FitError(
                "the saved search has other settings",
                where="annealing",
                advice="start anew or use the settings it was saved with",
            )
        self._generator.bit_generator.state = state["generator"]
        self._draws = [np.array(draw) for draw in state["draws"]]
        self._temperature = state["temperature"]
        self._changes = [_distance(change) for change in state["changes"]]
        self._asked = []
        self.iteration, self.is_started = state["iteration"], state["is_started"]
        self.current, self.best = np.array(state["current"]), np.array(state["best"])
        self.current_distance = _distance(state["current_distance"])
        self.best_distance = _distance(state["best_distance"])
        self.steps = [
            AnnealingStep(t, temperature, _distance(a), _distance(b), _distance(c), is_accepted)
            for t, temperature, a, b, c, is_accepted in state["steps"]
        ]
        self.evaluations, self.non_finite = state["evaluations"], state["non_finite"]

    def _ahead(self, offset: int) -> tuple[Floats, float]:
        """Return random numbers and temperature of the iteration `offset` after the next one."""
        while len(self._draws) <= offset:
            self._draws.append(self._generator.random(len(self.current) + 1))
        temperature = self._temperature
        for t in range(self.iteration + 1, self.iteration + offset + 2):
            temperature = self.settings.cooled(temperature, t)
        return self._draws[offset], temperature

    def _propose(self, theta: Floats, offset: int) -> Floats:
        draws, temperature = self._ahead(offset)
        spread = self.box.interval * (self.settings.mu * temperature**self.settings.sigma)
        low, high = self.box.minimum, self.box.maximum
        if self.settings.beyond_bounds == "redraw":
            return bounds.redraw(theta, draws[:-1], spread, low, high)
        moved: Floats = theta + np.tan(np.pi * (draws[:-1] - 0.5)) * spread  # (2)
        if self.settings.beyond_bounds == "clip":
            return np.asarray(np.clip(moved, low, high))
        return bounds.reflect(moved, low, high)

    def _guess_acceptance(self, offset: int) -> float:
        """Estimate the probability that the iteration is accepted, from its p2 and recent proposals."""
        draws, temperature = self._ahead(offset)
        p2 = max(draws[-1], SMALLEST_CHANCE)
        worst = -temperature / self.settings.gamma * math.log(p2)  # largest rise that passes (5)
        passed = sum(change <= worst for change in self._changes)
        return (passed + 1.0) / (len(self._changes) + 2.0)

    def _start(self, distance: float) -> None:
        self.is_started = True
        self.current_distance = self.best_distance = distance
        self.steps.append(AnnealingStep(0, self.settings.start_temperature, distance, distance, distance, True))

    def _step(self, candidate: Floats, distance: float) -> bool:
        draws, temperature = self._ahead(0)
        change = self.current_distance - distance  # (4)
        if math.isfinite(distance):
            probability = math.exp(min(0.0, change * self.settings.gamma / temperature))  # (5)
            is_accepted = bool(draws[-1] <= probability)
        else:
            is_accepted = False
        self._changes = [*self._changes, -change if math.isfinite(change) else math.inf][-OUTCOMES_KEPT:]
        self._draws.pop(0)
        self.iteration += 1
        self._temperature = temperature
        if is_accepted:
            self.current, self.current_distance = candidate.copy(), distance
        if distance < self.best_distance:
            self.best, self.best_distance = candidate.copy(), distance
        self.steps.append(
            AnnealingStep(self.iteration, temperature, distance, self.current_distance, self.best_distance, is_accepted)
        )
        return is_accepted


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _distance(value: float | None) -> float:
    return math.inf if value is None else float(value)


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return value.tolist()
    return value

"""Search that records every evaluated candidate and its distance, so that an interrupted search can be resumed.

A search draws every random number from its own generator. The same answers therefore lead to the same proposals. So the
search's state is its record: the candidates and their distances, in batches. `restore` asks and tells its way through
the record, which costs no simulation. This also works with a library whose internal state is unknown.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any

import numpy as np

from fit.errors import FitError
from fit.search.least_squares import BoundedSpace
from formats.arrays import Floats


class RecordedSearch(ABC):
    """A bounded search with a budget of evaluations; subclasses propose and learn in the unit box."""

    name = "search"

    def __init__(self, start: Floats, space: BoundedSpace, budget: int, seed: int) -> None:
        if not ((space.minimum <= start) & (start <= space.maximum)).all():
            raise FitError("the start of the search lies outside the bounds", where=self.name, advice="move it inside")
        self.space, self.budget, self.seed = space, budget, seed
        self.start = space.to_unit(start)
        self.best, self.best_distance = start.copy(), math.inf
        self.evaluations = self.non_finite = 0
        self._batches: list[tuple[Floats, Floats]] = []
        self._history: list[float] = []
        self._asked: Floats | None = None

    @abstractmethod
    def _propose(self, width: int) -> Floats:
        """Return the next 1 to `width` candidates in the unit box, (candidates, parameters)."""

    @abstractmethod
    def _learn(self, units: Floats, distances: Floats) -> None:
        """Learn the candidates' distances [m]; a distance is infinite where a simulation blew up."""

    @property
    def is_started(self) -> bool:
        """Return whether any distance is known."""
        return bool(self._batches)

    @property
    def is_finished(self) -> bool:
        """Return whether the budget of evaluations is spent."""
        return self.evaluations >= self.budget

    @property
    def iteration(self) -> int:
        """Evaluations so far."""
        return self.evaluations

    @property
    def best_history(self) -> Floats:
        """Best distance so far [m] after each evaluation, (evaluations,)."""
        return np.array(self._history)

    def ask(self, width: int = 1) -> Floats:
        """Return the next 1 to `width` candidates, (candidates, parameters); none when finished."""
        if width < 1:
            raise ValueError("a batch needs at least one candidate")
        room = min(width, self.budget - self.evaluations)
        if room <= 0:
            return np.empty((0, len(self.start)))
        # The initial candidate is evaluated alone, so that its blow-up is known before the budget is spent.
        self._asked = self.start[None] if not self.is_started else self._propose(room)
        return self.space.from_unit(self._asked)

    def tell(self, candidates: Floats, distances: Floats) -> int:
        """Take the distances [m], (candidates,), of the last `ask`; return how many there were."""
        if self._asked is None or len(candidates) != len(self._asked) or len(distances) != len(candidates):
            raise ValueError("tell() wants one distance for each candidate of the last ask()")
        if not np.array_equal(candidates, self.space.from_unit(self._asked)):
            raise ValueError("tell() wants the candidates of the last ask(), unchanged and in order")
        units, self._asked = self._asked, None
        finite = np.where(np.isfinite(distances), distances, np.inf)
        self._learn(units, finite)
        for candidate, distance in zip(candidates, finite, strict=True):
            if distance < self.best_distance:
                self.best, self.best_distance = candidate.copy(), float(distance)
            self._history.append(self.best_distance)
        self.evaluations += len(candidates)
        self.non_finite += int(np.isinf(finite).sum())
        self._batches.append((candidates.copy(), finite))
        return len(candidates)

    def state(self) -> dict[str, Any]:
        """Return the search's state as plain values for JSON, from which `restore` continues."""
        return {
            "name": self.name, "seed": self.seed, "budget": self.budget,
            "batches": [
                [c.tolist(), [float(d) if math.isfinite(d) else None for d in found]] for c, found in self._batches
            ],
        }  # fmt: skip

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from the state of a search with the same start, bounds, budget and seed.

        Raises:
            FitError: the state is of another search.
        """
        other = FitError(
            "the saved search has other settings", where=self.name,
            advice="start anew or use the settings it was saved with",
        )  # fmt: skip
        if (state.get("name"), state.get("seed"), state.get("budget")) != (self.name, self.seed, self.budget):
            raise other
        for saved, distances in state["batches"]:
            candidates = self.ask(len(saved))
            if not np.array_equal(candidates, np.array(saved)):
                raise other
            self.tell(candidates, np.array([math.inf if d is None else d for d in distances]))

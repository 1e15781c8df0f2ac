"""Registry of the search algorithms that minimise the distance D of free rollouts, and the construction of each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from fit.errors import FitError, unknown_name
from fit.search.annealing import Annealing, AnnealingSettings, SearchBox
from fit.search.chains import ParallelChains
from fit.search.least_squares import BoundedSpace
from formats.arrays import Floats

RESTARTED_CHAINS = 4  # of `restarts`: each still has 87 of the printed 350 iterations

SEARCHES = {
    "annealing": "simulated annealing as in the Kinect-skirt paper, one chain",
    "restarts": "the same iterations shared out over four chains from different seeds",
    "tempering": "parallel tempering; its intervals are of the posterior",
    "cma-es": "covariance matrix adaptation with restarts",
    "least-squares": "the points' residuals, emulated between simulated parameters; then Levenberg-Marquardt",
    "short-windows": "descents from several starts, by stretches of two seconds between which a pull catches the cloth",
}
ANNEALED = ("annealing", "restarts")  # they accept steps by gamma
OBSERVED = ("least-squares", "short-windows")  # they minimise the points' residuals, not distances


class Search(Protocol):
    """Interface of a search: `ask` returns candidates, `tell` receives their distances; the caller runs the loop."""

    @property
    def best(self) -> Floats:
        """Best candidate so far, (parameters,)."""
        ...

    @property
    def best_distance(self) -> float:
        """The distance of the best candidate so far [m]."""
        ...

    @property
    def best_history(self) -> Floats:
        """Best distance so far [m] after each iteration."""
        ...

    @property
    def is_started(self) -> bool:
        """Return whether the distance of the initial candidate is known."""
        ...

    @property
    def is_finished(self) -> bool:
        """Return whether the search has no further candidates to propose."""
        ...

    @property
    def iteration(self) -> int:
        """Iterations done."""
        ...

    @property
    def evaluations(self) -> int:
        """Candidates evaluated."""
        ...

    @property
    def non_finite(self) -> int:
        """Number of candidates whose simulation did not stay finite."""
        ...

    def ask(self, width: int) -> Floats:
        """Return 1 to `width` candidates, (candidates, parameters)."""
        ...

    def tell(self, candidates: Floats, distances: Floats) -> int:
        """Take the distances [m] of the last `ask`."""
        ...

    def state(self) -> dict[str, Any]:
        """Return the state as plain values for JSON, from which `restore` continues."""
        ...

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from a saved state."""
        ...


def check_search(name: str) -> str:
    """Return the search's name if a search of this name exists.

    Raises:
        FitError: there is no such search.
    """
    if name not in SEARCHES:
        raise unknown_name("search", name, SEARCHES, where="--search", listed="known searches", titles=SEARCHES)
    return name


def has_short_intervals(name: str, iterations: int) -> bool:
    """Return whether a search's 90 % intervals are too short, because it explores one local minimum only.

        Intervals of least squares are not too short. Intervals of tempering are not where its candidates leave enough
        draws.
    See docs/reference/search.md.
    """
    from fit.search.tempering import FEWEST_DRAWS, TEMPERATURES

    has_draws = name == "tempering" and iterations > 2 * TEMPERATURES * FEWEST_DRAWS
    return name != "least-squares" and not has_draws


@dataclass(frozen=True, kw_only=True)
class Task:
    """The task of a search by distance.

    - `initial`, (parameters,): the start
    - `steps`, (parameters,): standard steps of the annealing
    - `settings`: of the annealing; every search may use `settings.iterations` evaluations
    - `numbers`: independent numbers behind a distance
    """

    initial: Floats
    steps: Floats
    space: BoundedSpace
    settings: AnnealingSettings
    seed: int
    numbers: float


def begin(name: str, task: Task) -> Search:
    """Return a new search of this name for the task.

    Raises:
        FitError: no search by distance has this name.
    """
    initial, space, settings, seed = task.initial, task.space, task.settings, task.seed
    if name == "cma-es":
        from fit.search.cma_es import Evolution

        return Evolution(initial, space, settings.iterations, seed)
    if name == "tempering":
        from fit.search.tempering import Tempering

        return Tempering(initial, space, settings.iterations, seed, numbers=task.numbers)
    box = SearchBox(minimum=space.minimum, maximum=space.maximum, interval=task.steps)
    if name == "annealing":
        return Annealing(initial, box, settings, np.random.default_rng(seed))
    if name == "restarts":
        return ParallelChains(
            np.tile(initial, (RESTARTED_CHAINS, 1)), box, settings, np.random.default_rng(seed), is_split=True
        )
    raise FitError(f"{name} does not minimise distances", where="search", advice=f"choose one of {', '.join(SEARCHES)}")

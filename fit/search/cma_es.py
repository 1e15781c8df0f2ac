"""Covariance matrix adaptation (CMA-ES) with restarts of growing populations, by the library `cmaes`.

    x_k ~ m + sigma N(0, C),   k = 1 ... lambda,   lambda_0 = 4 + floor(3 ln n)

in the unit box of the working coordinates (logarithms where a parameter has a log scale), from the initial parameters
with sigma = 0.25. A run that has converged is followed by one from a random start with twice the population.
Only the order of the distances counts, so a simulation that blew up is just the worst.

Sources: N. Hansen, "The CMA evolution strategy: a tutorial", arXiv 1604.00772, eq. 5; restarts: A. Auger &
N. Hansen, "A restart CMA evolution strategy with increasing population size", IEEE CEC 2005; the library: M. Nomura &
M. Shibata, "cmaes: a simple yet practical Python library for CMA-ES", arXiv 2402.01373.
"""

from __future__ import annotations

import math

import numpy as np
from cmaes import CMA

from fit.search.least_squares import BoundedSpace
from fit.search.record import RecordedSearch
from formats.arrays import Floats

FIRST_SIGMA = 0.25  # share of the box: a quarter reaches every bound from most starts
FLAT_BELOW = 1e-6  # m between best and worst of a generation: a thousandth of a sensor's noise is no difference
NARROW = 1e-4  # share of the box: below what finite differences of a simulation resolve
WORST = 1e6  # m, worse than any simulation; only its rank counts


class Evolution(RecordedSearch):
    """CMA-ES behind `ask` and `tell`."""

    name = "cma-es"

    def __init__(self, start: Floats, space: BoundedSpace, budget: int, seed: int) -> None:
        super().__init__(start, space, budget, seed)
        self._generator = np.random.default_rng(seed)
        self.populations: list[int] = []
        self._begin(self.start, 4 + math.floor(3 * math.log(len(start))))

    def _begin(self, mean: Floats, population: int) -> None:
        box = np.tile([0.0, 1.0], (len(mean), 1))
        # The library wants its mean inside, not on, the bounds.
        inside = np.clip(mean, 0.01, 0.99)
        seed = int(self._generator.integers(2**31))
        self._run = CMA(mean=inside, sigma=FIRST_SIGMA, bounds=box, seed=seed, population_size=population)
        self.populations.append(population)
        self._generation: list[tuple[Floats, float]] = []

    def _propose(self, width: int) -> Floats:
        count = min(width, self._run.population_size - len(self._generation))
        return np.stack([self._run.ask() for _ in range(count)])

    def _learn(self, units: Floats, distances: Floats) -> None:
        if not self.is_started:
            return  # the start is not of a generation
        known = np.where(np.isfinite(distances), distances, WORST)
        self._generation += [(unit, float(d)) for unit, d in zip(units, known, strict=True)]
        if len(self._generation) < self._run.population_size:
            return
        self._run.tell(self._generation)
        values = np.array([d for _, d in self._generation])
        spread = np.ptp(np.stack([unit for unit, _ in self._generation]), axis=0).max()
        self._generation = []
        if self._run.should_stop() or float(np.ptp(values)) < FLAT_BELOW or spread < NARROW:
            self._begin(self._generator.random(len(self.start)), 2 * self.populations[-1])

"""Parallel tempering: chains at several temperatures exchange parameters; the coldest chain samples the posterior.

If the points' errors are isotropic with an exponential length of scale b, n independent lengths r have

    -ln L = n ln(8 pi b^3) + sum r / b,   least over b at b = D / 3,   there   -ln L = 3 n ln D + constant

with D their mean: the distance of eq. 1 of the Kinect-skirt paper is what this likelihood knows of a candidate. With N
independent numbers for 3 n and a flat prior in the unit box of the working coordinates the chains have

    accept a step      min(1, exp(-N (ln D' - ln D) / T_k))
    swap k and k + 1   min(1, exp(N (ln D_k - ln D_k+1) (1/T_k - 1/T_k+1)))

T_k = T_K^(k/K). Steps are Gaussian and reflected at the bounds: symmetric, so nothing is added to the acceptance. Their
widths are adapted towards one accepted step in four while the first half of the budget lasts and then kept.
Draws are the coldest chain's parameters in the second half.

Source: R. H. Swendsen & J.-S. Wang, "Replica Monte Carlo simulation of spin-glasses", Phys. Rev. Lett. 57 (1986); D. J.
Earl & M. W. Deem, "Parallel tempering: theory, applications, and new perspectives", Phys. Chem. Chem. Phys. 7 (2005).
"""

from __future__ import annotations

import math

import numpy as np

from fit.search.bounds import reflect
from fit.search.least_squares import BoundedSpace
from fit.search.record import RecordedSearch
from formats.arrays import Floats

TEMPERATURES = 8  # chains; our choice: 30^(1/7) = 1.6 from one temperature to the next
HOTTEST = 30.0  # N ln(D'/D) between the best and a poor candidate is 10 to 50: the hottest chain walks freely
FIRST_STEP = 0.1  # share of the box; our choice: steps adapt from there, so that only the first ones depend on it
WANTED_ACCEPTANCE = 0.25  # share of proposed steps; our choice: near the 0.234 of Roberts, Gelman and Gilks (1997)
SMALLEST_STEP, LARGEST_STEP = 1e-4, 1.0  # share of the box; wider steps are reflected back into it anyway
HOT_STEP = 4.0  # times `FIRST_STEP`: largest first step; our choice: 0.4 of the box, and steps adapt from there
# Of ln(step), for an acceptance of 1 in place of `WANTED_ACCEPTANCE`. Robbins-Monro with a constant gain: a rejection
# shrinks a step by 3 %, an acceptance widens it by 10 %.
STEP_GAIN = 0.13
# Draws of the coldest chain, below which their spread is no estimate. Our choice: independent draws then know it to
# 10 %, half of them to 14 %, and searches of 350 candidates have fewer anyway.
FEWEST_DRAWS = 50


class Tempering(RecordedSearch):
    """Parallel tempering behind `ask` and `tell`."""

    name = "tempering"

    def __init__(
        self, start: Floats, space: BoundedSpace, budget: int, seed: int, *, numbers: float, chains: int = TEMPERATURES
    ) -> None:
        """Create the chains, all at `start`, (parameters,), in the parameters' own units.

        - `budget`: candidates in all
        - `numbers`: N, the number of independent numbers in the mean distance
        """
        super().__init__(start, space, budget, seed)
        self._generator = np.random.default_rng(seed)
        self.numbers = numbers
        self.temperatures = HOTTEST ** (np.arange(chains) / max(chains - 1, 1))
        self.current = np.tile(self.start, (chains, 1))
        self.logs = np.zeros(chains)  # ln D, known once the start is
        self.steps = FIRST_STEP * np.sqrt(self.temperatures).clip(max=HOT_STEP)  # share of the box, (chains,)
        self._turn: list[tuple[Floats, float]] = []
        self._proposed = np.empty((0, len(self.start)))
        self._draws: list[Floats] = []
        self._sweeps = 0

    @property
    def draws(self) -> Floats:
        """Posterior draws, (draws, parameters): the coldest chain's parameters in the second half of the budget."""
        kept = np.array(self._draws) if self._draws else np.empty((0, len(self.start)))
        return self.space.from_unit(kept)

    def _propose(self, width: int) -> Floats:
        if not len(self._proposed):
            moves = self._generator.normal(size=self.current.shape) * self.steps[:, None]
            low, high = np.zeros(len(self.start)), np.ones(len(self.start))
            self._proposed = np.stack([reflect(p + m, low, high) for p, m in zip(self.current, moves, strict=True)])
        first = len(self._turn)
        return self._proposed[first : first + width]

    def _learn(self, units: Floats, distances: Floats) -> None:
        with np.errstate(divide="ignore"):
            logs = np.log(distances)
        if not self.is_started:
            self.logs[:] = logs[0]
            return
        self._turn += [(unit, float(log)) for unit, log in zip(units, logs, strict=True)]
        if len(self._turn) < len(self.current):
            return
        # Counted in whole sweeps, because batches may end within one.
        is_settling = 1 + self._sweeps * len(self.current) < self.budget / 2
        for k, ((unit, log), chance) in enumerate(
            zip(self._turn, self._generator.random(len(self.current)), strict=True)
        ):
            rise = self.numbers * (log - self.logs[k]) / self.temperatures[k]
            is_accepted = chance < math.exp(-max(rise, 0.0))
            if is_accepted:
                self.current[k], self.logs[k] = unit, log
            if is_settling:
                gain = STEP_GAIN * ((1.0 if is_accepted else 0.0) - WANTED_ACCEPTANCE)
                self.steps[k] = float(np.clip(self.steps[k] * math.exp(gain), SMALLEST_STEP, LARGEST_STEP))
        self._swap()
        if not is_settling:
            self._draws.append(self.current[0].copy())
        self._turn, self._proposed = [], np.empty((0, len(self.start)))

    def _swap(self) -> None:
        """Propose a swap for every second pair of neighbouring chains; the next call proposes the other pairs."""
        self._sweeps += 1
        for k in range(self._sweeps % 2, len(self.current) - 1, 2):
            colder = 1 / self.temperatures[k] - 1 / self.temperatures[k + 1]
            gain = self.numbers * (self.logs[k] - self.logs[k + 1]) * colder
            if self._generator.random() < math.exp(min(gain, 0.0)):
                self.current[[k, k + 1]] = self.current[[k + 1, k]]
                self.logs[[k, k + 1]] = self.logs[[k + 1, k]]

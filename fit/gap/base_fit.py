"""The base fit: what the model can do without any effect, from several starts, under the weakest pull that does.

A Sobol sequence over the box of parameters is judged on a coarse mesh, under a pull that makes the response smooth (a
hard one would make every fabric follow); the best few are fitted roughly, side by side, and from where they end once
more under the weakest pull that keeps the takes predictable, which tells more of the cloth. The best two ends are
fitted on the fine mesh. While the best two fits do not agree, another start is spent: the next best, then the middle
between the two. Source: I. M. Sobol, USSR Comput. Math. Math. Phys. 7 (1967).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from fit.cloth.simulator import Resolution
from fit.gap import gates
from fit.gap.checkpoint import Checkpoint
from fit.gap.fitting import Fitted, Problem, Task, fit
from fit.gap.observer import Observer
from formats.results import Gate

Floats = NDArray[np.float64]
Progress = Callable[[str, float], None]

FIRST_FREQUENCY = 1.0  # Hz: fits from anywhere end alike, and stiffnesses still show
SCATTERED = 15  # Sobol starts beside the initial parameters
ROUGH_STARTS, STARTS, MOST_STARTS = 4, 2, 4
COARSER = 1.5  # spacing of the mesh on which starts are looked for
ROUGH_ITERATIONS = 4


def fit_base(
    observer: Observer, progress: Progress, kept: Checkpoint, seed: int
) -> tuple[list[Fitted], Observer, Gate]:
    """Return the base fits, best first, the observer with the pull that was chosen, and the gate that says so."""
    coarse = coarsened(observer)
    progress("looking for starts", 0.02)
    places = scattered(observer, seed)
    rough = _roughly(coarse.with_frequency(FIRST_FREQUENCY), places, kept)
    frequency, _ = gates.choose_frequency(observer, rough[0].vector)
    if frequency < FIRST_FREQUENCY:
        progress(f"rough base fits, pull {frequency:g} Hz", 0.08)
        places = [f.vector for f in rough]
        rough = _roughly(coarse.with_frequency(frequency), places, kept)
    starts, spare = [f.vector for f in rough[:STARTS]], [f.vector for f in rough[STARTS:]]
    tried: set[float] = set()
    while True:
        chosen = observer.with_frequency(frequency)
        fits: list[Fitted] = []
        while len(fits) < len(starts):
            new = range(len(fits), len(starts))
            progress(f"base fit, {len(starts)} starts, pull {frequency:g} Hz", min(0.14 + 0.05 * len(fits), 0.28))
            tasks = [Task(starts[k], observer.off) for k in new]
            fits += kept.recall([f"base-{frequency:g}-{k}" for k in new], partial(fit, chosen, tasks))
            if len(fits) < MOST_STARTS and gates.disagreement(fits) > gates.CONVERGED:
                starts.append(spare.pop(0) if spare else middle(observer, fits))
        fits.sort(key=lambda f: f.cost)
        # A take can be predictable at one fit and not at the next; no pull is tried twice.
        needed, gate = gates.choose_frequency(observer, fits[0].vector)
        tried.add(frequency)
        if needed in tried:
            return fits, chosen, gate
        frequency, starts = needed, [f.vector for f in fits[:STARTS]]


def coarsened(observer: Observer) -> Observer:
    """Return an observer on the coarse mesh on which starts are looked for."""
    old = observer.resolution
    return observer.at_resolution(Resolution(spacing=min(COARSER * old.spacing, 0.06), step_share=old.step_share))


def scattered(observer: Observer, seed: int) -> list[Floats]:
    """Return the initial parameters and places scattered over the box, each (parameters,)."""
    from scipy.stats import qmc

    problem = Problem(observer)
    sobol = qmc.Sobol(len(problem.space.minimum), rng=np.random.default_rng(seed))
    # The outer tenths of the box are rarely true and often costly to simulate.
    unit = 0.1 + 0.8 * sobol.random(SCATTERED + 1)[1:]
    return [observer.parameterisation.initial, *problem.space.from_unit(unit)]


def _roughly(observer: Observer, places: list[Floats], kept: Checkpoint) -> list[Fitted]:
    """Fits of a few iterations from the best of some places, the best first."""

    def go() -> list[Fitted]:
        residuals = observer.residuals(np.array(places), np.tile(observer.off, (len(places), 1)))
        order = np.argsort((residuals**2).sum(1))[:ROUGH_STARTS]
        rough = [Task(places[k], observer.off, iterations=ROUGH_ITERATIONS, renewals=0, is_rough=True) for k in order]
        return fit(observer, rough)

    names = [f"rough-{observer.frequency:g}-{k}" for k in range(ROUGH_STARTS)]
    return sorted(kept.recall(names, go), key=lambda f: f.cost)


def middle(observer: Observer, fits: list[Fitted]) -> Floats:
    """Parameters half way between the best two fits, (parameters,), on the scales on which they are searched."""
    problem = Problem(observer)
    best = sorted(fits, key=lambda f: f.cost)[:2]
    return np.asarray(problem.space.from_unit(np.mean([problem.space.to_unit(f.vector) for f in best], axis=0)))

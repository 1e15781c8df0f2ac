"""The base fit: what the model can do without any effect, from several starts, under the weakest pull that does.

A Sobol sequence over the box of parameters is judged on a coarse mesh under a strong pull, which makes the response
smooth; the best few are fitted there roughly, the best two of those under the weakest pull that keeps the takes
predictable. While the best two of those do not agree, another start is spent: the next best, then the middle between
the two. Source: I. M. Sobol, USSR Comput. Math. Math. Phys. 7 (1967).
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

FIRST_FREQUENCY = 3.0  # Hz: strong enough that every start finds the basin
SCATTERED = 31  # Sobol starts beside the initial parameters
ROUGH_STARTS, STARTS, MOST_STARTS = 3, 2, 4
COARSER = 1.5  # spacing of the mesh on which starts are looked for
ROUGH_ITERATIONS = 4


def fit_base(
    observer: Observer, progress: Progress, kept: Checkpoint, seed: int
) -> tuple[list[Fitted], Observer, Gate]:
    """Return the base fits, best first, the observer with the pull that was chosen, and the gate that says so."""
    old = observer.resolution
    coarse = Resolution(spacing=min(COARSER * old.spacing, 0.06), step_share=old.step_share)
    strong = observer.with_frequency(FIRST_FREQUENCY).at_resolution(coarse)
    progress("looking for starts", 0.02)
    found = find_starts(strong, seed)[:ROUGH_STARTS]
    progress(f"rough base fits from {ROUGH_STARTS} starts", 0.04)
    tasks = [Task(start, observer.off, iterations=ROUGH_ITERATIONS, renewals=0) for start in found]
    rough = kept.recall([f"rough-{k}" for k in range(len(tasks))], partial(fit, strong, tasks))
    rough.sort(key=lambda f: f.cost)
    starts, spare = [f.vector for f in rough[:STARTS]], [f.vector for f in rough[STARTS:]]
    frequency, gate = gates.choose_frequency(observer, starts[0])
    too_weak: set[float] = set()
    while True:
        chosen = observer.with_frequency(frequency)
        fits: list[Fitted] = []
        while len(fits) < len(starts):
            new = range(len(fits), len(starts))
            progress(f"base fit, {len(starts)} starts, pull {frequency:g} Hz", min(0.12 + 0.05 * len(fits), 0.28))
            tasks = [Task(starts[k], observer.off) for k in new]
            fits += kept.recall([f"base-{frequency:g}-{k}" for k in new], partial(fit, chosen, tasks))
            if len(fits) < MOST_STARTS and gates.disagreement(fits) > gates.CONVERGED:
                starts.append(spare.pop() if spare else middle(observer, fits))
        fits.sort(key=lambda f: f.cost)
        # A take can be predictable at one fit and not at the next; a pull that was too weak once is not tried again.
        needed, gate = gates.choose_frequency(observer, fits[0].vector)
        if needed > frequency:
            too_weak.add(frequency)
        if needed == frequency or needed in too_weak:
            return fits, chosen, gate
        frequency, starts = needed, [f.vector for f in fits[:STARTS]]


def middle(observer: Observer, fits: list[Fitted]) -> Floats:
    """Parameters half way between the best two fits, (parameters,), on the scales on which they are searched."""
    problem = Problem(observer)
    best = sorted(fits, key=lambda f: f.cost)[:2]
    return np.asarray(problem.space.from_unit(np.mean([problem.space.to_unit(f.vector) for f in best], axis=0)))


def find_starts(observer: Observer, seed: int) -> list[Floats]:
    """Return the initial parameters and scattered ones, each (parameters,), the best first."""
    from scipy.stats import qmc

    problem = Problem(observer)
    sobol = qmc.Sobol(len(problem.space.minimum), rng=np.random.default_rng(seed))
    # The outer tenths of the box are rarely true and often costly to simulate.
    unit = 0.1 + 0.8 * sobol.random(SCATTERED + 1)[1:]
    vectors = np.concatenate([observer.parameterisation.initial[None], problem.space.from_unit(unit)])
    residuals = observer.residuals(vectors, np.tile(observer.off, (len(vectors), 1)))
    return [vectors[k] for k in np.argsort((residuals**2).sum(1))]

"""The base fit: what the model can do without any effect, from several starts, under the weakest pull that does.

A Sobol sequence over the box of parameters is judged on a coarse mesh, under a pull that makes the response smooth (a
hard one would make every fabric follow); the best few are fitted roughly, side by side, and from where they end once
more under the weakest pull that keeps the takes predictable, which tells more of the cloth. The best two ends are
fitted on the fine mesh. While the best two fits do not agree, another start is spent: the next best, then the middle
between the two.

Stretch and shear make up for each other, and folds ripple the cost between their valleys, so that fits may agree in the
wrong one. From the best end u each parameter k is therefore moved alone by s, up to 0.45 of its range, and the others
along the valley's floor of the linear model, with H = J'J + prior:

    u_k + s,   u_o - H_oo^-1 H_ok s

Two more fits begin where that costs least. Parameters that the data hold tightly, or not at all, are not moved.
Source: I. M. Sobol, USSR Comput. Math. Math. Phys. 7 (1967).
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
from fit.search.looks import spread
from formats.results import Gate

Floats = NDArray[np.float64]
Progress = Callable[[str, float], None]

FIRST_FREQUENCY = 1.0  # Hz: fits from anywhere end alike, and stiffnesses still show
SCATTERED = 15  # Sobol starts beside the initial parameters
ROUGH_STARTS, STARTS, MOST_STARTS = 4, 2, 4
COARSER = 1.5  # spacing of the mesh on which starts are looked for
ROUGH_ITERATIONS = 4
HOPS = (-0.45, -0.3, -0.15, 0.15, 0.3, 0.45)  # of a parameter's range that it is moved by alone
HOPPED = 2  # fits that are begun beyond
LEAST_RISE, MOST_RISE = 0.002, 2.0  # of the cost, by the slope, at the nearest of these places


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
            break
        frequency, starts = needed, [f.vector for f in fits[:STARTS]]
    progress(f"base fit, across valleys, pull {frequency:g} Hz", 0.29)
    if beyond := across_valleys(chosen, fits[0]):
        names = [f"base-{frequency:g}-beyond-{k}" for k in range(len(beyond))]
        fits += kept.recall(names, partial(fit, chosen, beyond))
        fits.sort(key=lambda f: f.cost)
        gate = gates.predictability_gate(chosen, fits[0].vector, observer.off)
    return fits, chosen, gate


def across_valleys(observer: Observer, best: Fitted) -> list[Task]:
    """Return fits that begin where one parameter is moved far, the others along with it, and the cost is least."""
    problem = Problem(observer)
    unit = problem.space.to_unit(best.vector)
    jacobian = best.jacobian * problem.space.scale
    normal = jacobian.T @ jacobian + np.diag((problem.space.scale / problem.prior_sd) ** 2)
    places, moved = [], []
    for k in range(len(unit)):
        others = np.arange(len(unit)) != k
        along = np.eye(len(unit))[k]
        along[others] = -np.linalg.solve(normal[np.ix_(others, others)], normal[others, k])
        rise = min(np.abs(HOPS)) ** 2 * float(along @ normal @ along) / best.cost
        if LEAST_RISE < rise < MOST_RISE:
            hops = [step for step in HOPS if 0.0 <= unit[k] + step <= 1.0]
            places += [np.clip(unit + step * along, 0.0, 1.0) for step in hops]
            moved += [(k, step > 0) for step in hops]
    if not places:
        return []
    vectors = problem.space.from_unit(np.array(places))
    costs = (observer.residuals(vectors, np.tile(observer.off, (len(places), 1))) ** 2).sum(1)
    chosen: dict[tuple[int, bool], int] = {}
    for n in np.argsort(costs):
        chosen.setdefault(moved[n], int(n))
    return [Task(vectors[n], observer.off, known_cost=best.cost) for n in list(chosen.values())[:HOPPED]]


def coarsened(observer: Observer) -> Observer:
    """Return an observer on the coarse mesh on which starts are looked for."""
    old = observer.resolution
    return observer.at_resolution(Resolution(spacing=min(COARSER * old.spacing, 0.06), step_share=old.step_share))


def scattered(observer: Observer, seed: int) -> list[Floats]:
    """Return the initial parameters and places scattered over the box, each (parameters,)."""
    space = Problem(observer).space
    units = spread(len(space.minimum), SCATTERED + 1, seed)[1:]
    return [observer.parameterisation.initial, *space.from_unit(units)]


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

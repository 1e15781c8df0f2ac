"""Base fit: the model without any effect, fitted under the weakest pull that keeps the takes predictable.

Scattered candidates over the box of parameters come first, then those where an emulator of the residuals expects the
least cost (`fit.search.sampling`). They are simulated on a coarse mesh, under a pull that makes the response smooth. A
hard pull would force every fabric onto the points. The best candidates are simulated once more on the fine mesh, under
the weakest smooth pull, which depends more on the fabric. The model is fitted from the best two candidates that lie
apart. While the best two fits disagree, further starts follow: the next best candidate, then the middle of the two.

Fits may agree in the wrong local minimum of stretch and shear. So two more fits begin across the valley from the best
end (`fit.search.valleys`).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from fit.cloth.model import Resolution
from fit.gap import gates
from fit.gap.checkpoint import Checkpoint
from fit.gap.fitting import Fitted, Problem, Task, fit
from fit.observer.residuals import Observer
from fit.search import sampling, valleys
from formats.arrays import Floats
from formats.diagnosis_records import Gate

Progress = Callable[[str, float], None]

# Hz, of the first pull: fits from any start agree, and the residual still depends on the stiffnesses. At 3 Hz every
# fabric tracks the points (decision 15).
FIRST_FREQUENCY = 1.0
# Candidates simulated under that pull, and further ones under the chosen pull. On the take of
# `tests/fit/gap/test_diagnosis_parts.py`, two thirds of such sets begin in the truth's valley (decision 19).
FIRST_SAMPLES, SAMPLES = 32, 24
# Best candidates, simulated under both pulls; our choice: they fill a batch (`fit.gap.fitting.CANDIDATE_LANES`).
CARRIED = 12
# Share of the box, in one parameter at least, between the starts of fits. Our choice: three times the difference by
# which a fit takes its first slopes. Half and double were not tried.
STARTS_APART = 0.15
STARTS, MOST_STARTS = 2, 4  # base fits, and at most while the best two disagree; our choice: one fit shows no agreement
# Spacing of the mesh for the first search of starts, over the diagnosis' own; our choice: 3.4 times less work.
# Coarser meshes have valleys of their own (decision 19). Half and double were not tried.
COARSER = 1.5
COARSEST_FIRST = 0.06  # m, unless the mesh itself is coarser; our choice: hardly above the 50 mm by default


def fit_base(
    observer: Observer, progress: Progress, kept: Checkpoint, seed: int
) -> tuple[list[Fitted], Observer, Gate]:
    """Return the base fits, best first, the observer with the chosen pull, and the predictability gate."""

    def sample(where: Observer, first: Floats, count: int, share: float) -> Floats:
        """Return simulated candidates, (count, parameters), least cost first."""

        def tell(done: float) -> None:
            progress(f"simulating candidates {_under(where.frequency)}", share + 0.06 * done)

        return _sampled(where, first, count, seed, kept, tell)

    smooth = coarsened(observer).with_frequency(FIRST_FREQUENCY)
    candidates = sample(smooth, scattered(observer, seed), FIRST_SAMPLES, 0.02)
    frequency, _ = gates.choose_frequency(observer, candidates[0])
    candidates = sample(observer.with_frequency(frequency), candidates[:CARRIED], CARRIED + SAMPLES, 0.08)
    spare = _lying_apart(observer, candidates)
    starts, spare = spare[:STARTS], spare[STARTS:]
    tried: set[float] = set()
    has_hopped = False
    while True:
        chosen = observer.with_frequency(frequency)
        fits: list[Fitted] = []
        while len(fits) < len(starts):
            new = range(len(fits), len(starts))
            progress(f"base fit from {len(starts)} candidates {_under(frequency)}", min(0.14 + 0.05 * len(fits), 0.28))
            tasks = [Task(starts[k], observer.off) for k in new]
            fits += kept.recall([f"base-{frequency:g}-{k}" for k in new], partial(fit, chosen, tasks))
            if len(fits) < MOST_STARTS and gates.disagreement(fits) > gates.CONVERGED:
                starts.append(spare.pop(0) if spare else middle(observer, fits))
        fits.sort(key=lambda f: f.cost)
        # A take may be predictable at one fit and not at the next, so no pull is tried twice.
        tried.add(frequency)
        needed, gate = gates.choose_frequency(observer, fits[0].vector)
        if needed in tried and not has_hopped:
            has_hopped = True
            progress(f"base fit in further valleys {_under(frequency)}", 0.29)
            if beyond := across_valleys(chosen, fits[0]):
                names = [f"base-{frequency:g}-beyond-{k}" for k in range(len(beyond))]
                fits += kept.recall(names, partial(fit, chosen, beyond))
                fits.sort(key=lambda f: f.cost)
                needed, gate = gates.choose_frequency(observer, fits[0].vector)
        if needed in tried:
            break
        frequency, starts = needed, [f.vector for f in fits[:STARTS]]
    if needed != frequency:
        gate = gates.predictability_gate(chosen, fits[0].vector, observer.off)
    return fits, chosen, gate


def _under(frequency: float) -> str:
    """Return the strength of a pull [Hz] in words."""
    return f"under a pull of {frequency:g} Hz" if frequency else "without a pull"


def across_valleys(observer: Observer, best: Fitted) -> list[Task]:
    """Return fits with the same effects, started across the valleys about a fit's end (`fit.search.valleys`)."""
    problem = Problem(observer, best.active, best.pinned)

    def costs(units: Floats) -> Floats:
        return np.asarray((problem.residuals(problem.space.from_unit(units)) ** 2).sum(1))

    units = valleys.across(
        problem.space.to_unit(problem.pack(best.vector, best.amplitudes)), best.jacobian * problem.space.scale,
        np.diag((problem.space.scale / problem.prior_sd) ** 2), best.cost, len(best.vector), costs,
    )  # fmt: skip
    vectors, amplitudes = problem.unpack(problem.space.from_unit(units))
    return [
        Task(vector, row, best.active, known_cost=best.cost, pinned=best.pinned)
        for vector, row in zip(vectors, amplitudes, strict=True)
    ]


def coarsened(observer: Observer) -> Observer:
    """Return an observer on the coarse mesh of the first search of starts."""
    old = observer.resolution
    coarser = max(old.spacing, min(COARSER * old.spacing, COARSEST_FIRST))
    return observer.at_resolution(Resolution(spacing=coarser, step_share=old.step_share))


def scattered(observer: Observer, seed: int) -> Floats:
    """Return the initial parameters and candidates scattered over the box, (sampling.SCATTERED, parameters)."""
    space, initial = Problem(observer).space, observer.parameterisation.initial
    return np.concatenate([initial[None], space.from_unit(sampling.scatter(space.to_unit(initial), seed)[1:])])


def _sampled(
    observer: Observer, first: Floats, count: int, seed: int, kept: Checkpoint, tell: Callable[[float], None]
) -> Floats:
    """Return given and then proposed candidates, (candidates, parameters), least cost first.

    `tell` receives the finished share of the simulations
    """
    done = 0
    space = Problem(observer).space
    start = space.to_unit(observer.parameterisation.initial)

    def residuals(units: Floats) -> Floats:
        nonlocal done
        tell(done / count)
        done += len(units)
        vectors = space.from_unit(units)
        return observer.sound_residuals_of(observer.trajectories(vectors, np.tile(observer.off, (len(vectors), 1))))

    def go() -> Floats:
        return space.from_unit(sampling.sample(residuals, space.to_unit(first), count, start, seed))

    return kept.recall_vectors(f"looks-{observer.frequency:g}-{1e3 * observer.resolution.spacing:g}-{count}", go)


def _lying_apart(observer: Observer, candidates: Floats) -> list[Floats]:
    """Return STARTS or more candidates, (parameters,): the first, and each later one far from those chosen before."""
    units, chosen = Problem(observer).space.to_unit(candidates), [0]
    for n, unit in enumerate(units):
        if np.abs(units[chosen] - unit).max(1).min() > STARTS_APART:
            chosen.append(n)
    near = [n for n in range(len(units)) if n not in chosen]
    return [candidates[n] for n in (chosen + near[: max(STARTS - len(chosen), 0)])[:MOST_STARTS]]


def middle(observer: Observer, fits: list[Fitted]) -> Floats:
    """Return the midpoint between the best two fits, (parameters,), on the scales of the search."""
    problem = Problem(observer)
    best = sorted(fits, key=lambda f: f.cost)[:2]
    return np.asarray(problem.space.from_unit(np.mean([problem.space.to_unit(f.vector) for f in best], axis=0)))

"""Hypotheses on the cause of the gap: the base model refitted with one or several effects, judged on held-out takes.

Effects are shortlisted by two savings of a linear refit: of cost (`fit.gap.screening`), and of distance, by which
hypotheses are judged. Shortlisted effects are refitted jointly with the base parameters, from the linear solution,
along chords. Every hypothesis is judged by its error on the held-out takes. A further effect is added while it explains
remaining held-out error (forward selection). Source: Y. C. Pati, R. Rezaiifar, P. Krishnaprasad, "Orthogonal matching
pursuit" (1993), with refits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fit.gap.closure import BlockErrors, block_errors
from fit.gap.edge_fit import beside_another
from fit.gap.fitting import Fitted, Problem, Task
from fit.gap.screening import Screened, Signature, cosine, with_amplitude
from fit.observer.residuals import Observer
from formats.arrays import Floats

SHORTLIST = 5  # effects that are refitted; our choice: a limit on the cost
REFIT_ITERATIONS = 5  # of each refit, along chords; our choice: a limit on the cost, half and double untried
# Iterations of the best refits with Jacobians of their own; our choice: a limit on the cost, half and double untried.
POLISHING = 8
# Shares of the linear estimate of an amplitude, tried as starts. Our choice: a law that bends takes less than its slope
# says, and four starts are one batch. With half and double the demo's diagnosis names the same drag, 1.07, after 1358
# and 1322 simulations in place of 1328.
AMPLITUDE_STARTS = (0.3, 0.6, 1.0, 1.5)
TWIN_COSINE = 0.9  # cosine above which an effect is refitted together with its twin; our choice: as `GROUP_COSINE`
# Of the best predicted saving; our choice: an effect that saves less would need twenty times that to win.
LEAST_SAVED = 0.05
# A constant offset adds little to the cost of hundreds of noisy frames, but may be most of the error in mm.
# Effects refitted for the mm^2 that they save (decision 18), and the share of the largest saving. Our choice: limits on
# the cost, half and double untried.
MOST_SEEN, SEEN_SHARE = 2, 0.5


@dataclass(frozen=True)
class Hypothesis:
    """A refitted model, the names of its effects and its held-out errors."""

    effects: tuple[str, ...]
    fitted: Fitted
    errors: BlockErrors


def shortlist(screened: Screened) -> list[str]:
    """Return the effects to refit, largest expected improvement first."""
    order = sorted(screened, key=lambda name: -screened[name].predicted)
    best = order[0]
    chosen = _not_trifling(screened, order[:SHORTLIST])
    chosen += _seen_most(screened, chosen)
    for leader in (best, max(screened, key=lambda name: screened[name].predicted_mm2)):
        twins = [
            name for name in order if name not in chosen and abs(cosine(screened[leader], screened[name])) > TWIN_COSINE
        ]
        chosen += twins[:2] if leader in chosen else []
    return chosen


def further(screened: Screened, most: int) -> list[str]:
    """Return the effects to try in combination with others, largest expected improvement first.

    An effect that reduces the cost but not the distance is left out. Static effects reduce the cost little, as in
    `shortlist`, so the effects with the largest reduction of distance are tried as well.
    """
    nearest = max(one.predicted_mm2 for one in screened.values())
    nearer = [name for name, one in screened.items() if nearest <= 0.0 or one.predicted_mm2 >= LEAST_SAVED * nearest]
    chosen = _not_trifling(screened, sorted(nearer, key=lambda name: -screened[name].predicted)[:most])
    return chosen + _seen_most(screened, chosen, most)


def _seen_most(screened: Screened, chosen: list[str], most: int = MOST_SEEN) -> list[str]:
    """Return the few effects with the largest reduction of distance, except those chosen already."""
    by_distance = sorted(screened, key=lambda name: -screened[name].predicted_mm2)
    least = SEEN_SHARE * max(screened[by_distance[0]].predicted_mm2, 0.0)
    return [name for name in by_distance[:most] if screened[name].predicted_mm2 > least and name not in chosen]


def _not_trifling(screened: Screened, order: list[str]) -> list[str]:
    """Return the first of sorted effects and those that reduce the cost by a sizeable share of the first one's."""
    least = LEAST_SAVED * screened[order[0]].predicted
    return [name for name in order if screened[name].predicted > least or name == order[0]]


def refits(observer: Observer, start: Fitted, screened: Screened, names: list[str]) -> list[Task]:
    """Return refits of a model with one additional effect each, started from the best shares of the linear solution."""
    tries = [_starts_of_refit(observer, start, screened[name], name) for name in names]
    every = [problem.unpack(np.array(numbers)) for problem, numbers, _ in tries]
    vectors, rows = (np.concatenate(column) for column in zip(*every, strict=True))
    costs = (observer.residuals(vectors, rows) ** 2).sum(1).reshape(len(tries), -1)
    tasks = []
    for (problem, _, joint), (own, amplitudes), cost in zip(tries, every, costs, strict=True):
        best = int(np.argmin(cost))
        tasks.append(
            Task(
                own[best], amplitudes[best], problem.active, iterations=REFIT_ITERATIONS, jacobian=joint,
                pinned=problem.pinned,
            )
        )  # fmt: skip
    return tasks


def _starts_of_refit(
    observer: Observer, start: Fitted, signature: Signature, effect: str
) -> tuple[Problem, list[Floats], Floats]:
    """Return the problem with one additional effect, starts near its joint linear solution, and its Jacobian."""
    active = (*start.active, effect)
    pinned = beside_another(observer, start, effect, signature.raw)
    problem = Problem(observer, active, pinned)
    count = len(start.vector)
    joint = np.concatenate([start.jacobian, signature.raw.T], axis=1)
    # Gauss-Newton from `start`, which is a minimum of its own parameters, kept within a factor of e per parameter.
    normal = joint.T @ joint + np.diag(problem.prior_sd**-2)
    step = -np.linalg.solve(normal, joint.T @ start.residual)
    logs = observer.parameterisation.is_log
    moved = np.where(
        logs, start.vector * np.exp(np.clip(step[:count] * logs, -1, 1)), start.vector + step[:count] * ~logs
    )
    columns = observer.columns[effect]
    kind = observer.library[effect]
    guess = np.clip(signature.amplitude, 0.9 * kind.low, 0.9 * kind.high)
    if not np.abs(guess).max() > 0.1 * kind.typical:
        guess = np.full(len(guess), 0.3 * kind.typical)
    rows = [with_amplitude(start.amplitudes, columns, share * guess) for share in AMPLITUDE_STARTS]
    if pinned is not None:
        rows = [np.where(np.isfinite(pinned.sd), pinned.amplitudes, row) for row in rows]
    return problem, [problem.pack(vector, row) for vector in (moved, start.vector) for row in rows], joint


def judged(judge: Observer, fits: Sequence[Fitted]) -> list[Hypothesis]:
    """Return fits with their held-out errors, simulated together."""
    if not fits:
        return []
    residuals = judge.residuals(np.stack([f.vector for f in fits]), np.stack([f.amplitudes for f in fits]))
    return [Hypothesis(f.active, f, block_errors(judge, r)) for f, r in zip(fits, residuals, strict=True)]


def never_worse(simpler: Hypothesis, found: Hypothesis, screened: Screened) -> Hypothesis:
    """Return a refit, or the simpler model with the further effect's size 0 where that fits no worse.

    A model holds the one without its further effects. A refit that costs more has ended at a poorer local minimum. Its
    error on other motion then differs from the simpler model's by this minimum alone, and no effect closes anything.
    Sizes that the held edge decided stay, because their fit does not seek the least cost.

    screened: signatures about the simpler model or near it
    """
    fitted = found.fitted
    if fitted.pinned is not None or fitted.cost < simpler.fitted.cost:
        return found
    own = simpler.fitted
    # Where the simpler model ended, as its residual is.
    jacobian = np.concatenate([own.jacobian, screened[found.effects[-1]].raw.T], axis=1)
    there = replace(fitted, vector=own.vector, amplitudes=own.amplitudes, residual=own.residual, jacobian=jacobian)
    return Hypothesis(found.effects, there, simpler.errors)


def polishing(old: Fitted) -> Task:
    """Return the task that continues a fit with a Jacobian of finite differences, which the intervals need."""
    return Task(old.vector, old.amplitudes, old.active, iterations=POLISHING, pinned=old.pinned)

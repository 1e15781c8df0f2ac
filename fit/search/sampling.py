"""Choose parameter vectors to simulate: first a Sobol sequence, then the minima that an emulator predicts.

The start and a Sobol sequence come first. Then two candidates at a time are proposed (`fit.search.emulator`; caution 1
and 0). One has the least expected cost. The other has the least cost of the prediction alone, which explores more. Both
costs carry a weak prior, the box's own spread about the start. Each minimum is sought from the best candidate so far,
and from the best of random candidates over the box and near the best one. A proposal depends only on the seed and on
the candidates so far. So an interrupted search continues from its saved candidates.

Source of the scattered candidates: I. M. Sobol, USSR Comput. Math. Math. Phys. 7 (1967).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fit.search.emulator import Emulator
from fit.search.intervals import PRIOR_SD
from formats.arrays import Floats

# Of the box, left out at each end: rarely true, often costly. Four seeds fitted the demo's takes with drag on a mesh of
# 0.1 m. The error on them is 3.64 to 3.67 mm; with half 3.64 to 3.65, and with double 3.63 to 3.68. On a mesh of 0.05 m
# two seeds end at costs of 1992 and 2013. With half they end at 2000 and 2003, with double at 2003 and 2004. Descents
# of one search differ as much (decision 40), so no margin is better.
SCATTER_MARGIN = 0.1
# Candidates with the start: the lanes of one batch. On one core, 1 takes 0.16 s, 8 0.21, 16 0.24 and 32 0.47 s
# (measured).
SCATTERED = 16
CAUTIONS = (1.0, 0.0)  # of the prediction's variance in the cost: the expected cost, and the prediction alone
# Share of the box: least difference of two candidates in one parameter. Our choice: nearer ones differ by the ripples
# of folds, which the emulator takes for noise. Half and double change the error of those fits by at most 0.01 mm (two
# seeds).
LEAST_APART = 0.01
# the same around a blown-up candidate; our choice: as `SCATTER_MARGIN`. Half and double change nothing in one of those
# fits.
NEAR_BLOW_UP = 0.1
# Best candidates that the emulator uses at most: its work grows with their third power. Our choice: a proposal from 60
# took 1.5 s, one from 120 4.3 s (measured).
MOST_EMULATED = 60
# Drawn over the box, and about the best with these deviations; our choice: starts of descents on the emulator, which
# cost no simulation. Half and double of the numbers change the error of one of those fits by at most 0.01 mm.
DRAWN, WIDTHS = (200, 100, 50), (0.1, 0.03)
DESCENTS = 3  # on the emulator, from the best of the drawn; our choice: as many local minima as are worth a look


def scatter(start: Floats, seed: int) -> Floats:
    """Return the start, (parameters,), and scattered candidates, (SCATTERED, parameters) in all, in box shares."""
    return np.concatenate([start[None], spread(len(start), SCATTERED - 1, seed)])


def spread(parameters: int, count: int, seed: int) -> Floats:
    """Return the first parameter vectors of a Sobol sequence over the box without its margins, (count, parameters)."""
    from scipy.stats import qmc

    sobol = qmc.Sobol(parameters, rng=np.random.default_rng(seed))
    return SCATTER_MARGIN + (1 - 2 * SCATTER_MARGIN) * np.stack([sobol.random(1)[0] for _ in range(count)])


def prior_cost(units: Floats, start: Floats) -> Floats:
    """Return the prior's part of the cost of parameter vectors, (candidates, parameters) -> (candidates,)."""
    return np.asarray(((units - start) ** 2).sum(-1) / PRIOR_SD**2)


def fewest(parameters: int) -> int:
    """Return the number of simulated candidates that an emulator must exceed."""
    return parameters + 1


def sample(residuals: Callable[[Floats], Floats], first: Floats, count: int, start: Floats, seed: int) -> Floats:
    """Return the given and then proposed candidates, (candidates, parameters), `count` in all, least cost first.

    residuals: (candidates, parameters) -> (candidates, numbers), not finite after a blow-up
    """
    units, found = first, residuals(first)
    while len(units) < count:
        proposed = propose(units, found, start, seed)[: count - len(units)]
        if not len(proposed):
            break
        units, found = np.concatenate([units, proposed]), np.concatenate([found, residuals(proposed)])
    costs = (found**2).sum(1) + prior_cost(units, start)
    return np.asarray(units[np.argsort(np.where(np.isfinite(costs), costs, np.inf), kind="stable")])


def propose(units: Floats, residuals: Floats, start: Floats, seed: int) -> Floats:
    """Return the next candidates to simulate, (candidates, parameters), or none if too few simulations stayed finite.

    units, (candidates, parameters), simulated so far; residuals, (candidates, numbers), not finite after a blow-up;
    start, (parameters,): the prior's mean.
    """
    is_sound = np.isfinite(residuals).all(1)
    sound, broken = units[is_sound], units[~is_sound]
    if len(sound) <= fewest(len(start)):
        return units[:0]
    finite = residuals[is_sound]
    order = np.argsort((finite**2).sum(1) + prior_cost(sound, start), kind="stable")[:MOST_EMULATED]
    emulator = Emulator(sound[order], finite[order] @ finite[order].T)
    random = np.random.default_rng([seed, len(units)])
    chosen: list[Floats] = []
    for caution in CAUTIONS:
        for candidate in _least(emulator, caution, sound[order[0]], start, random):
            seen = np.array([*units, *chosen])
            is_apart = not len(broken) or _distance(candidate, broken) > NEAR_BLOW_UP
            if _distance(candidate, seen) > LEAST_APART and is_apart:
                chosen.append(candidate)
                break
    return np.array(chosen).reshape(-1, len(start))


def _distance(candidate: Floats, others: Floats) -> float:
    """Return the distance to the nearest other candidate: the largest difference in one parameter."""
    return float(np.abs(others - candidate).max(1).min())


def emulated_cost(candidate: Floats, emulator: Emulator, caution: float, start: Floats) -> tuple[float, Floats]:
    """Return the emulated cost with the prior's part, and its slopes, (parameters,), of one candidate in box shares."""
    values, slopes = emulator.costs(candidate[None], caution)
    return float(values[0] + prior_cost(candidate, start)), slopes[0] + 2 * (candidate - start) / PRIOR_SD**2


def _least(
    emulator: Emulator, caution: float, best: Floats, start: Floats, random: np.random.Generator
) -> list[Floats]:
    """Return candidates of least emulated cost: ends of descents on the emulator, then randomly drawn candidates."""
    from scipy.optimize import minimize

    about = zip(DRAWN[1:], WIDTHS, strict=True)
    near = [np.clip(best + width * random.normal(size=(count, len(best))), 0, 1) for count, width in about]
    drawn = np.concatenate([random.random((DRAWN[0], len(best))), *near])
    drawn = drawn[np.argsort(emulator.costs(drawn, caution)[0] + prior_cost(drawn, start), kind="stable")]
    box = [(0.0, 1.0)] * len(best)
    ends = [
        minimize(
            emulated_cost, begin, (emulator, caution, start), jac=True, bounds=box,
            options={"maxiter": 30},
        )
        for begin in (best, *drawn[:DESCENTS])
    ]  # fmt: skip
    return [*(end.x for end in sorted(ends, key=lambda end: float(end.fun))), *drawn]

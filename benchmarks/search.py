"""Compare the searches at the same number of simulated candidates: their results and their intervals' coverage.

Takes come from our own solver with known parameters. So the figures concern searches, not models. A swatch is held
along its edge and moved twice for six seconds, ending at rest. Every coordinate of its five points has 2 mm of white
noise. Truths are drawn within the ranges of `TRUTHS`. The budget counts candidates; annealing is counted by its
iterations, as if it evaluated one at a time. With --air-drag the truths hang in air of this drag coefficient, which is
a sixth parameter of the fits. With --trials 1 least squares make one trial only, which no second one confirms.
Run: python benchmarks/search.py [--truths 10] [--budget 350] [--only least-squares ...] [--spacing 0.08]
[--air-drag 1.2] [--trials 3]
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as `hangtime` does, or ends depend on the number of processors

import numpy as np
from scipy.special import erf

from formats.arrays import Booleans, Floats

sys.path.insert(0, str(Path(__file__).parents[1]))

from fit.cloth.effect import Effect
from fit.cloth.mesh import build_mesh
from fit.cloth.model import Resolution
from fit.effects import find_effects
from fit.identification.calibrate import Model, calibrate
from fit.identification.observed import TRIALS, ObservedSearch, begin_observed
from fit.identification.request import Request
from fit.methods import SI
from fit.recordings.recording import prepare
from fit.search.annealing import AnnealingSettings
from fit.search.choice import OBSERVED, RESTARTED_CHAINS, SEARCHES
from fit.search.intervals import PRIOR_SD
from formats.take import Take
from tests.fit.scenes import sheet, simulate_take, swing

SEEDS_FROM = 100  # smaller seeds were used to develop the searches
NOISE = 2e-3  # m a coordinate, between the 1.9 and 2.9 mm measured of a depth camera at rest
MOTIONS = ((0.05, 0.7), (0.03, 1.0))  # m and Hz, both with 20 mm sideways
# In the order of the `si` parameters: the middle of what fabrics have, and damping that ends a swing within seconds.
TRUTHS = np.array([[100.0, 10.0, 5e-6, 5e-4, 0.8], [800.0, 100.0, 5e-5, 5e-3, 4.0]])
SPACING = 0.1  # m, of truth and fit alike: searches are compared here, not meshes
GOOD = 0.05  # relative error of a parameter that counts as found
NEAR = 0.01  # relative change of a parameter, over which slopes at the truth are compared with those over GOOD
TWO_SIDED_95 = 1.96


@dataclass(frozen=True)
class Case:
    """Takes of one truth, (parameters,): of `si`, then the drag coefficient where there is air."""

    truth: Floats
    takes: list[Take]
    mesh: Resolution
    effects: tuple[Effect, ...]

    def request(self, **options: Any) -> Request:
        """Return the request to a search."""
        return Request(method=SI, effects=self.effects, resolution=self.mesh, **options)


@dataclass(frozen=True)
class Run:
    """One search on one case: distance [m] after each candidate, at the end the result's; its parameters.

    spent: number of candidates until its end
    """

    history: Floats
    spent: int
    fitted: Floats
    ends: Floats
    is_identified: Booleans


def make_case(seed: int, spacing: float = SPACING, air_drag: float = 0.0) -> Case:
    """Draw a truth and simulate its takes."""
    effects = find_effects(["air_drag"]) if air_drag else ()
    unit = np.random.default_rng(seed).uniform(size=TRUTHS.shape[1])
    truth = TRUTHS[0] * (TRUTHS[1] / TRUTHS[0]) ** unit
    time, garment, mesh = np.arange(0, 6, 1 / 30), sheet(), Resolution(spacing=spacing)
    density = garment.mass_kg / float(build_mesh(garment, spacing).area)
    takes = [
        simulate_take(
            garment, time, swing(time, amplitude=amplitude, hz=hz, stop=4, sideways=0.02),
            SI.to_materials(truth[None], density), effects=effects, amplitudes=np.full((1, len(effects)), air_drag),
            noise=NOISE, resolution=mesh, seed=10 * seed + k, name=f"case {seed}, motion {k}",
        )
        for k, (amplitude, hz) in enumerate(MOTIONS)
    ]  # fmt: skip
    return Case(np.concatenate([truth, [air_drag] * len(effects)]), takes, mesh, effects)


def run(case: Case, search: str, budget: int, seed: int, trials: int) -> Run:
    """Run one search within a budget."""
    if search in OBSERVED:
        return run_observed(case, search, budget, seed, trials)
    settings = AnnealingSettings().lasting(budget - 1)
    result = calibrate(case.takes, [], case.request(search=search, settings=settings, seed=seed))
    # A step of the history of `restarts` is one candidate of each chain.
    history = np.repeat(np.array(result.history), RESTARTED_CHAINS if search == "restarts" else 1)[:budget]
    padded = np.full(budget, history[-1])
    padded[: len(history)] = history
    return Run(
        padded, len(history), np.array([p.fitted for p in result.parameters]),
        np.array([[p.interval_low, p.interval_high] for p in result.parameters], float),
        np.array([bool(p.is_identified) for p in result.parameters]),
    )  # fmt: skip


def run_observed(case: Case, search: str, budget: int, seed: int, trials: int) -> Run:
    """Run least squares with its distance after each candidate; after a descent's end, with short windows."""
    recordings = [prepare(take) for take in case.takes]
    request = case.request(search=search, seed=seed)
    initial = np.array([p.initial for p in request.parameters])
    model = Model(recordings, request)
    observed, settings = begin_observed(request, recordings, model.distances_of)
    found = observed.run(initial, replace(settings, trials=min(trials, settings.trials)))
    history = np.full(budget, float(model.distances(initial[None])[0]))
    before = after = 0
    for number, step in enumerate(found.path):
        after = step.simulations // len(recordings)
        if step.distances:
            for k, distance in enumerate(step.distances, before):
                history[k:] = np.minimum(history[k:], distance)
        else:
            after += number + 1
            history[after:] = np.minimum(history[after:], float(model.distances(step.vector[None])[0]))
        before = after
    # The last distance is the result's, not the best candidate's on the way.
    history[after:] = float(model.distances(found.vector[None])[0])
    return Run(history, after, found.vector, found.intervals.ends, found.intervals.is_identified)


def spread(values: Floats, form: str = ".2f") -> str:
    """Return median and quartiles as text."""
    low, middle, high = np.percentile(values, [25, 50, 75])
    return f"{middle:{form}} ({low:{form}} to {high:{form}})"


def main(
    truths: int = 10,
    budget: int = 350,
    only: Sequence[str] = (),
    spacing: float = SPACING,
    air_drag: float = 0.0,
    trials: int = TRIALS,
) -> dict[str, list[Run]]:
    """Print the tables; return all runs by search."""
    cases = [make_case(SEEDS_FROM + k, spacing, air_drag) for k in range(truths)]
    runs: dict[str, list[Run]] = {name: [] for name in only or SEARCHES}
    for k, case in enumerate(cases):
        for name, found in runs.items():
            found.append(run(case, name, budget, k, trials))
        print(f"truth {k + 1} of {truths} done", file=sys.stderr, flush=True)
    print_distances(cases, runs)
    print_parameters(cases, runs)
    return runs


def print_distances(cases: list[Case], runs: dict[str, list[Run]]) -> None:
    """Print the distances at a tenth and all of the budget, and the candidates until annealing's distance."""
    budget = len(next(iter(runs.values()))[0].history)
    models = [Model([prepare(t) for t in case.takes], case.request()) for case in cases]
    truth = 1e3 * np.array([m.distances(c.truth[None])[0] for m, c in zip(models, cases, strict=True)])
    print(f"{len(cases)} truths, {budget} candidates; distances in mm, median (quartiles)")
    print(f"{'the truth':14} {spread(truth)}")
    for name, found in runs.items():
        early, late = (1e3 * np.array([r.history[n - 1] for r in found]) for n in (budget // 10, budget))
        spent = spread(np.array([r.spent for r in found], float), ".0f")
        print(f"{name:14} after {budget // 10}: {spread(early)}   after {budget}: {spread(late)}   spent: {spent}")
    if "annealing" not in runs:
        return
    for name, found in runs.items():
        pairs = zip(found, runs["annealing"], strict=True)
        needed = [int(np.argmax(r.history <= a.history[-1])) + 1 for r, a in pairs if r.history[-1] <= a.history[-1]]
        soon = sum(n <= budget // 10 for n in needed)
        print(f"{name:14} as good as annealing's end in {len(needed)} of {len(cases)}, within {budget // 10} in {soon}"
              f"; candidates needed there: {spread(np.array(needed), '.0f') if needed else '-'}")  # fmt: skip


def print_parameters(cases: list[Case], runs: dict[str, list[Run]]) -> None:
    """Print how often each parameter is found, identified, and covered by its interval."""
    print("parameters: found within 5 %, identified, intervals that hold the truth: all (of identified ones)")
    truth = np.array([case.truth for case in cases])
    noise, straight = (np.array(found) for found in zip(*map(known_by_noise, cases), strict=True))
    can = (noise < GOOD) & straight
    ideal = erf(TWO_SIDED_95 * GOOD / noise / np.sqrt(2.0))  # probability, if noise is the only error
    for k, parameter in enumerate(cases[0].request().parameters):
        print(
            f"the noise      {parameter.name:22} straight in {straight[:, k].sum()} of {len(cases)}; there known to "
            f"{spread(100 * noise[straight[:, k], k], '.2g') if straight[:, k].any() else '-'} %"
        )
    for name, found in runs.items():
        fitted, ends, identified = (
            np.array([getattr(r, what) for r in found]) for what in ("fitted", "ends", "is_identified")
        )
        right = np.abs(fitted / truth - 1) <= GOOD
        held = (ends[..., 0] <= truth) & (truth <= ends[..., 1])
        for k, parameter in enumerate(cases[0].request().parameters):
            print(
                f"{name:14} {parameter.name:22} {100 * right[:, k].mean():4.0f} %  "
                f"{intervals(identified[:, k], held[:, k])}"
                f"  {knowable(can[:, k], right[:, k], ideal[:, k])}"
            )
        print(f"{name:14} {'all together':22}         {intervals(identified, held)}  {knowable(can, right, ideal)}")


def knowable(can: Booleans, right: Booleans, ideal: Floats) -> str:
    """Return as text the number of parameters that are knowable, found, and findable with noise as the only error."""
    return (
        f"could be known to 5 %: {can.sum()}, of these found: {right[can].sum()}, by noise alone {ideal[can].sum():.1f}"
    )


def known_by_noise(case: Case) -> tuple[Floats, Booleans]:
    """Return the smallest possible interval of each parameter, and whether its path is straight, (parameters,) each.

    The first is half of the relative 95 % interval by Cramer and Rao's bound. It comes from the residuals' slopes at
    the truth with the search's own prior. The path is straight if the slopes over 5 % and over 1 % differ by less than
    the slope itself. If cloth folds differently after a change of 5 %, no search finds the truth.
    """
    recordings, count = [prepare(take) for take in case.takes], len(case.truth)
    space = case.request().space
    search = ObservedSearch(recordings, SI, case.effects, space, case.mesh)
    slopes = []
    for change in (NEAR, GOOD):
        moved = [case.truth * np.exp(sign * change * np.eye(count)) for sign in (1, -1)]
        up, down = np.split(search.simulate(np.concatenate(moved), 0.0)[0], 2)
        slopes.append((up - down) / (2 * change))
    near, far = slopes
    prior = np.diag((PRIOR_SD * space.scale) ** -2.0)
    deviations = [np.sqrt(np.diag(np.linalg.inv(slope @ slope.T + prior))) for slope in slopes]
    is_straight = np.linalg.norm(far - near, axis=1) < np.linalg.norm(far, axis=1)
    return TWO_SIDED_95 * np.maximum(*deviations), is_straight


def intervals(identified: Booleans, held: Booleans) -> str:
    """Return as text the number of parameters whose intervals hold the truth: all, and of the identified ones."""
    of_identified = f"{100 * held[identified].mean():.0f} %" if identified.any() else "-"
    return f"{100 * identified.mean():4.0f} %  {100 * held.mean():4.0f} % ({of_identified})"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--truths", type=int, default=10)
    parser.add_argument("--budget", type=int, default=350)
    parser.add_argument("--only", nargs="+", choices=list(SEARCHES), default=[])
    parser.add_argument("--spacing", type=float, default=SPACING, help="mesh of truths and fits [m]")
    parser.add_argument("--air-drag", type=float, default=0.0, help="drag coefficient of the truths, fitted too")
    parser.add_argument("--trials", type=int, default=TRIALS, help="largest number of trials of least squares")
    given = parser.parse_args()
    main(given.truths, given.budget, given.only, given.spacing, given.air_drag, given.trials)

"""Diagnose the same sealed cases under more noise, more gaps and other frame rates.

Run: python benchmarks/ladder.py FOLDER [--cases 12] [--nulls 2] [--seed 7] [--workers 2] [--only base n6]. Makes,
diagnoses and scores a set for every step, in FOLDER/STEP; interrupted, the same command continues. About six minutes a
step of 14 cases on two cores. "Detectable" is the detectable amplitude that a diagnosis states. It is divided by the
detectable amplitude of the same effect and case under the first step's conditions. The figure is the median
over cases and effects.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as `hangtime` does, or ends depend on the number of processors

import numpy as np

from fit.blind.foreign.engines import OWN_GENERATOR
from fit.blind.judging import answer_of
from fit.blind.making import make_set
from fit.blind.rates import rate_of
from fit.blind.running import run_set
from fit.blind.scoring import SCORE, Score, load_score, score_set

STEPS = {
    "base": {"noise": 1e-3, "away": 0.1, "rate": 60.0},
    "n03": {"noise": 3e-4, "away": 0.1, "rate": 60.0},
    "n3": {"noise": 3e-3, "away": 0.1, "rate": 60.0},
    "n6": {"noise": 6e-3, "away": 0.1, "rate": 60.0},
    "m0": {"noise": 1e-3, "away": 0.0, "rate": 60.0},
    "m30": {"noise": 1e-3, "away": 0.3, "rate": 60.0},
    "r30": {"noise": 1e-3, "away": 0.1, "rate": 30.0},
    "r120": {"noise": 1e-3, "away": 0.1, "rate": 120.0},
}
Detectable = dict[tuple[str, str], float]


def main(arguments: list[str] | None = None) -> None:
    """Make and diagnose the missing sets; print a row for every step."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--cases", type=int, default=12)
    parser.add_argument("--nulls", type=int, default=2)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--only", nargs="+", default=list(STEPS), choices=list(STEPS))
    chosen = parser.parse_args(arguments)
    print("noise   gaps   rate   right group   from twice on   wrong   on nulls   detectable   simulations")
    first: Detectable = {}
    for name in chosen.only:
        folder, sensor = chosen.folder / name, STEPS[name]
        numbers = {"single": chosen.cases, "null": chosen.nulls, "pair": 0, "unknown": 0}
        make_set(folder / "set", numbers, OWN_GENERATOR.plants([]), chosen.seed, workers=chosen.workers, sensor=sensor)
        run_set(folder / "set", folder / "answers", workers=chosen.workers)
        if not (folder / "answers" / SCORE).exists():  # every opening is recorded
            score_set(folder / "set", folder / "answers")
        score = load_score(folder / "answers")
        found = detectable(folder / "answers", score)
        first = first or found
        print(row(sensor, score, found, first), flush=True)


def detectable(answers: Path, score: Score) -> Detectable:
    """Return the detectable amplitude of every effect in every diagnosed case."""
    known: Detectable = {}
    for case in score.cases:
        said = answer_of(answers, case.id)
        findings = said.effects if said else []
        known.update({(case.id, f.id): f.minimum_detectable for f in findings if f.minimum_detectable is not None})
    return known


def row(sensor: dict[str, float], score: Score, found: Detectable, first: Detectable) -> str:
    """Return one step of the ladder as a row of text."""
    singles = [j for j in score.cases if j.kind == "single" and j.is_tested]
    large = rate_of(bool(j.right_first) for j in singles if (j.ratio or 0.0) >= 2)
    wrong = sum(bool(j.named) and not j.right_first for j in singles)
    right, large_right, alarms = (
        f"{r.k} of {r.n}" for r in (score.overall.right_first, large, score.overall.false_alarms)
    )
    times = np.median([found[key] / first[key] for key in found.keys() & first.keys()])
    given = f"{1e3 * sensor['noise']:4.1f} mm {100 * sensor['away']:3.0f} % {sensor['rate']:4.0f}/s"
    simulations = score.overall.simulations or 0
    return f"{given} {right:>13} {large_right:>15} {wrong:>7} {alarms:>10} {times:10.2f} x {simulations:13.0f}"


if __name__ == "__main__":
    main()

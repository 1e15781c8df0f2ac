"""The upper limit for pairs: the rates of an oracle that knows the planted effects and only fits them.

Run: python benchmarks/pair_oracle.py SET ANSWERS [ANSWERS ...] [--out FILE.json].
SET is a scored set of the blind check, whose seal is open. ANSWERS are folders of answers to the set.

A planted effect of a pair may be large alone and yet collinear with the other one. So the oracle fits both effects
together from their planted sizes, and each alone from the result of that fit. The held-out takes judge the three fits.
The true pair leaves a smaller error than the best true single. The conditional size k compares this gain with the
least gain for which the rules may name a second effect:

    k^2 = (E_single^2 - E_pair^2) / needed,   needed = max(share N^2, (1.2 - 1) F^2).

E are errors, F is the noise floor and N the error of mesh and solver, all in mm on held-out motion. `needed` is the
gain from which a single effect counts as detectable too (`fit.gap.detectable.resolvable`). F and N come from the first
folder of answers.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path

import numpy as np

from fit.blind.cases import Truth
from fit.blind.judging import answer_of, judge
from fit.blind.making import open_labels
from fit.blind.plants import Planted
from fit.blind.rates import rate_of
from fit.blind.scoring import LOOKS_FILE
from fit.effects import LIBRARY
from fit.gap.closure import SIGNIFICANT_GAP
from fit.gap.detectable import mesh_share
from fit.gap.diagnosis import fine_enough
from fit.gap.fitting import Task, fit
from fit.gap.hypotheses import Hypothesis, judged
from fit.methods import SI
from fit.observer.residuals import Observer
from fit.recordings.ready import ready
from fit.runtime import one_thread_of_algebra
from formats.archive import read_take
from formats.arrays import Floats
from formats.diagnosis_records import Diagnosis

ITERATIONS = 12  # bound on every fit, which begins near its minimum
BINS = (("k >= 2", 2.0, np.inf), ("1 <= k < 2", 1.0, 2.0), ("k < 1", -np.inf, 1.0))
TRUE = ("stretch_stiffness", "shear_stiffness", "bending_stiffness", "velocity_damping")


@dataclass(frozen=True)
class Known:
    """The oracle's results for one pair; errors in mm, on held-out takes."""

    case: str
    planted: tuple[str, ...]
    pair_mm: float
    singles_mm: dict[str, float]
    floor_mm: float
    numerics_mm: float
    k: float
    both_named: dict[str, bool]


def main(arguments: list[str] | None = None) -> None:
    """Print every pair and the rates by conditional size."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", metavar="SET", type=Path)
    parser.add_argument("answers", metavar="ANSWERS", type=Path, nargs="+")
    parser.add_argument("--out", type=Path, help="write the figures to this JSON file as well")
    asked = parser.parse_args(arguments)
    if not (asked.folder / LOOKS_FILE).exists():
        parser.error(f"{asked.folder} was never scored: its seal is closed. Score it first (`hangtime blind score`)")
    found: list[Known] = []
    for truth in open_labels(asked.folder).truths:
        said = answer_of(asked.answers[0], truth.id)
        if truth.kind != "pair" or said is None or said.gap is None:
            continue
        one = known_of(asked.folder, truth, said, asked.answers)
        named = ", ".join(f"{name}: {'both' if both else 'not both'}" for name, both in one.both_named.items())
        singles = ", ".join(f"{name} {mm:.2f}" for name, mm in one.singles_mm.items())
        print(f"{one.case}  k {one.k:5.2f}  pair {one.pair_mm:.2f}, {singles} mm  {named}", flush=True)
        found.append(one)
    for name in (folder.name for folder in asked.answers):
        print(f"both named by {name}:")
        for title, low, high in BINS:
            print(f"    {title:<12}", rate_of(one.both_named[name] for one in found if low <= one.k < high))
        print(f"    {'of k >= 1':<12}", rate_of(one.both_named[name] for one in found if one.k >= 1.0))
    if asked.out:
        asked.out.write_text(json.dumps([asdict(one) for one in found], indent=1) + "\n")


def known_of(folder: Path, truth: Truth, said: Diagnosis, answers: list[Path]) -> Known:
    """Fit the planted effects of a case together and alone; return their held-out errors."""
    case = folder / "cases" / truth.id
    takes = ready(*([read_take(p) for p in sorted(case.glob(f"{kind}-*.mcap"))] for kind in ("take", "held-out")))
    with one_thread_of_algebra():
        observer = Observer(takes.training, SI, LIBRARY, frequency=0.0, resolution=fine_enough(takes.training[0]))
        judging = observer.of(takes.held_out)
        names = tuple(sorted(p.id for p in truth.planted))
        start, amplitudes = nearest(observer, truth, said)
        (pair,) = fit(observer, [Task(start, amplitudes, names, iterations=ITERATIONS)])
        alone = []
        for name in names:
            row = observer.off
            row[observer.columns[name]] = pair.amplitudes[observer.columns[name]]
            alone.append(Task(pair.vector, row, (name,), iterations=ITERATIONS))
        both, *singles = judged(judging, [pair, *fit(observer, alone)])
    best = min(singles, key=lambda one: one.errors.squared_mm)
    (second,) = set(names) - set(best.effects)
    floor, numerics = said.gap.floor_mm.value, said.gap.numerics_mm or 0.0
    k = conditional_size(
        best.errors.squared_mm - both.errors.squared_mm, floor, numerics, mesh_share(observer.library[second])
    )
    return Known(
        case=truth.id, planted=names, pair_mm=_mm(both), singles_mm={one.effects[0]: _mm(one) for one in singles},
        floor_mm=floor, numerics_mm=numerics, k=k,
        both_named={folder.name: bool(judge(truth, folder).both_named) for folder in answers},
    )  # fmt: skip


def conditional_size(gain: float, floor_mm: float, numerics_mm: float, share: float) -> float:
    """Return k, from a gain [mm^2] and the share of mesh and solver error that the second effect must remove."""
    needed = max(share * numerics_mm**2, (SIGNIFICANT_GAP - 1) * floor_mm**2)
    return float(np.sqrt(max(gain, 0.0) / needed))


def nearest(observer: Observer, truth: Truth, said: Diagnosis) -> tuple[Floats, Floats]:
    """Return the true parameters and sizes as the observer's parameters, with the signs that fit best.

    The generator's signs may differ from the library's. So both values of every sign are tried, with the true
    parameters and with the answer's base parameters. The generator has no bending viscosity, so the answer's is used.
    """
    base = np.array([p.fitted for p in said.base_parameters])
    true = base.copy()
    places = {p.name: n for n, p in enumerate(SI.parameters)}
    for name, value in zip(TRUE, (truth.stretch, truth.shear, truth.bending, truth.damping), strict=True):
        true[places[name]] = np.clip(value, SI.minimum[places[name]], SI.maximum[places[name]])
    rows, vectors = [], []
    for signs, vector in product(product((1.0, -1.0), repeat=len(truth.planted)), (true, base)):
        row = observer.off
        for sign, planted in zip(signs, truth.planted, strict=True):
            row[observer.columns[planted.id]] = sizes_of(observer, planted, sign)
        rows.append(row)
        vectors.append(vector)
    cost = (observer.residuals(np.array(vectors), np.array(rows)) ** 2).sum(1)
    best = int(np.argmin(cost))
    return vectors[best], rows[best]


def sizes_of(observer: Observer, planted: Planted, sign: float) -> Floats:
    """Return a planted effect's components in the library's order, within its range."""
    effect = observer.library[planted.id]
    whole = planted.components.get("", 0.0)
    return np.clip([sign * planted.components.get(c, whole) for c in effect.components], effect.low, effect.high)


def _mm(hypothesis: Hypothesis) -> float:
    return float(np.sqrt(hypothesis.errors.squared_mm))


if __name__ == "__main__":
    main()

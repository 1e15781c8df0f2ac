"""Check for local minima: compare the diagnosis' fits with fits that begin at the truth.

Cases of the blind check's generator with one effect each (development seed: no published rate rests on it) are
diagnosed whole. Two ratios are printed per case. One is the cost of the base fit over that of a base fit begun at the
true parameters. The other is the same for the refit with the planted effect, begun at the true parameters and
amplitude. A ratio of 1 is as good, and above 1 is a worse local minimum. Below 1 is better: the generator's cloth is
not the library's, so the least cost is not at the truth.
"""

from __future__ import annotations

import os
import sys

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as `hangtime` does, or ends depend on the number of processors

import numpy as np

from fit.blind.cases import Truth, draw_truth, make_takes, rounds
from fit.blind.foreign.engines import OWN_GENERATOR
from fit.cloth.effect import amplitudes_of
from fit.effects import LIBRARY
from fit.gap.diagnosis import diagnose
from fit.gap.fitting import Task, fit
from fit.methods import SI
from fit.observer.residuals import Observer
from fit.recordings.recording import prepare
from formats.arrays import Floats

NEARLY = 1.05  # times the cost of the fit from the truth: counts as the same valley
IN_BASE = {e.name for e in LIBRARY if e.in_base in {p.name for p in SI.parameters}}


def true_vector(truth: Truth) -> Floats:
    """SI parameters of the cloth that a case was made with, (parameters,), within their bounds."""
    known = {
        "stretch_stiffness": truth.stretch, "shear_stiffness": truth.shear, "bending_stiffness": truth.bending,
        "velocity_damping": truth.damping,
    }  # fmt: skip
    return np.asarray(np.clip([known.get(p.name, p.initial) for p in SI.parameters], SI.minimum, SI.maximum))


def ratios(truth: Truth) -> tuple[float, float | None]:
    """Return both cost ratios, of the base fit and of the planted effect's refit, None where a fit is missing."""
    takes = make_takes(truth)
    (planted,) = truth.planted
    found = diagnose(takes[:3], takes[3:])
    base, one = found.base, next(e for e in found.diagnosis.effects if e.id == planted.id)
    observer = Observer(
        [prepare(take) for take in takes[:3]], SI, LIBRARY, frequency=found.frequency, resolution=found.resolution
    )
    vector = true_vector(truth)
    parts = tuple(planted.components.values())
    amplitudes = amplitudes_of(LIBRARY, **{planted.id: parts if len(parts) > 1 else parts[0]})
    without, with_it = fit(observer, [Task(vector, observer.off), Task(vector, amplitudes, (planted.id,))])
    refitted = None if one.fitted_share is None else (1 - one.fitted_share) * base.cost / with_it.cost
    return base.cost / without.cost, refitted


def main(cases: int = 8, seed: int = 991) -> None:
    """Print both ratios of every case and how many end in the truth's valley."""
    plants = [p for p in OWN_GENERATOR.plants([]) if p.id not in IN_BASE]
    drawn = rounds(np.random.default_rng(seed), tuple(plants), cases)
    both = []
    for number, plant in enumerate(drawn):
        truth = draw_truth(f"refit-{number}", "single", (plant,), (seed, 1000 + number))
        both.append(ratios(truth))
        said = "not refitted" if both[-1][1] is None else f"{both[-1][1]:.2f}"
        print(f"{plant.id:<20} base fit {both[-1][0]:.2f}, with the effect {said}", flush=True)
    for title, values in (("base fits", [b for b, _ in both]), ("refits", [r for _, r in both if r is not None])):
        print(f"{title}: {sum(v <= NEARLY for v in values)} of {len(values)} within 5 % of the fit from the truth")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))

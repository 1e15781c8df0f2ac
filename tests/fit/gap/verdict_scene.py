"""Hypotheses and evidence with made-up figures that allow hand calculation of each rule."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np

from fit.cloth.effect import amplitudes_of, columns_of
from fit.effects import LIBRARY
from fit.gap.closure import BlockErrors, Resampling
from fit.gap.evidence import Evidence
from fit.gap.fitting import Fitted
from fit.gap.hypotheses import Hypothesis
from fit.gap.screening import Signature
from fit.methods import SI
from fit.observer.edge import EdgeErrors
from formats.diagnosis_records import Gate

BLOCKS = 12
KINDS = {effect.name: effect for effect in LIBRARY}
EFFECTS = {
    "effects": LIBRARY, "library": KINDS, "columns": dict(zip(KINDS, columns_of(LIBRARY), strict=True)),
    "recordings": (),
}  # fmt: skip
RESAMPLING = Resampling(np.random.default_rng(1).integers(0, BLOCKS, (400, BLOCKS)), 1.0)
NO_EDGE = SimpleNamespace(block=np.zeros(3, int), is_edge=np.zeros(3, bool), frame=np.zeros(3, int))


def errors(mm, wobble=0.1, seed=0):
    """Held-out errors of 12 blocks of ten points, about `mm` root mean square."""
    shares = 1 + wobble * np.random.default_rng(seed).uniform(-1, 1, BLOCKS)
    return BlockErrors(10.0 * mm**2 * shares * BLOCKS / shares.sum(), np.full(BLOCKS, 10.0), np.zeros(3))


def hypothesis(names, mm, *, seed=0, sizes=1.0, deviation=0.05):
    active = tuple(names)
    row = amplitudes_of(LIBRARY, **{n: sizes * KINDS[n].typical for n in names})
    wide = sum(len(KINDS[name].components) for name in active)
    fitted = Fitted(SI.initial, row, active, np.zeros(3), np.zeros((3, 5 + wide)), np.full(5 + wide, deviation), True)
    return Hypothesis(active, fitted, errors(mm, seed=seed))


def signature(contribution=(1.0,), **changes):
    """What screening says of an effect, with figures that are all different unless they are given."""
    given = {
        "amplitude": np.zeros(1), "raw": np.ones((1, 3)), "projected": np.ones((1, 3)), "typical": 0.001,
        "predicted": 9.0, "predicted_mm2": 4.0, "explained": 0.3, "absorbed": 0.2, "correlation": 0.4,
    }  # fmt: skip
    return Signature(contribution=np.asarray(contribution, float), **(given | changes))


def like(**cosines):
    """Screened effects whose contributions have these cosines with the first one and lie in one plane."""
    return {name: signature((c, np.sqrt(1 - c**2))) for name, c in cosines.items()}


def evidence_of(
    singles,
    *,
    base=12.0,
    floor=5.0,
    gate_list=(),
    joint=(),
    joint_p=0.001,
    sizes=1.0,
    instead=(),
    floor_error=0.08,
):
    """Evidence from errors in mm: `singles` and `joint` as {names: mm}."""
    given = (hypothesis((n,), mm, seed=k, sizes=sizes) for k, (n, mm) in enumerate(singles.items()))
    found = {h.effects[0]: h for h in given}
    every = dict.fromkeys([*found, *(name for names, _ in joint for name in names)])
    rows = np.eye(len(every))
    screened = {name: signature(rows[n]) for n, name in enumerate(every)}
    observer = SimpleNamespace(**EFFECTS | {"recordings": []}, in_mm=lambda row: 2.0, layout=NO_EDGE, frequency=0.0)
    return Evidence(
        observer=observer, judge=observer,
        screened=screened, base=hypothesis((), base), singles=found,
        joint=[(hypothesis(names, mm, seed=9), joint_p) for names, mm in joint],
        floor_mm=floor, numerics_mm=1.0, resampling=RESAMPLING,
        floor_error_mm=floor_error, gates=[*PASSED, *gate_list], is_held_out=True, instead=list(instead),
    )  # fmt: skip


PASSED = [Gate(name="base fit", passed=True, figure=0.0, limit=5.0, unit="%", sentence="")]
COARSE = Gate(name="mesh and step", passed=False, figure=60.0, limit=40.0, unit="%", sentence="coarse")
CHAOTIC = Gate(name="predictability", passed=False, figure=3.0, limit=1.0, unit="mm", sentence="chaotic")
UNSETTLED = Gate(name="base fit", passed=False, figure=20.0, limit=15.0, unit="%", sentence="apart")
STILL = Gate(name="motion", passed=False, figure=3.0, limit=30.0, unit="mm", sentence="still")


def with_edge(one, squares, resting=0.0):
    """The same hypothesis where the held edge of the takes judged on is off by so many squared deviations, of 1000."""
    edge = EdgeErrors(moving=float(squares), count=1000, resting=resting, mm=0.02 * squares**0.5 + 0.01 * resting)
    return dataclasses.replace(one, errors=dataclasses.replace(one.errors, edge=edge))

"""Hypotheses and evidence with figures made up so that each rule can be worked by hand."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np

from fit.cloth.effect import amplitudes_of, columns_of
from fit.effects import LIBRARY, find_effects
from fit.gap.closure import BlockErrors
from fit.gap.evidence import Evidence
from fit.gap.fitting import Fitted
from fit.gap.hypotheses import Hypothesis
from fit.gap.screening import Screened
from fit.methods import SI
from fit.observer.edge import EdgeErrors
from formats.results import Gate

BLOCKS = 12
NO_EDGE = SimpleNamespace(block=np.zeros(3, int), is_edge=np.zeros(3, bool), frame=np.zeros(3, int))


def errors(mm, wobble=0.1, seed=0):
    """Held-out errors of 12 blocks of ten points, about `mm` root mean square."""
    shares = 1 + wobble * np.random.default_rng(seed).uniform(-1, 1, BLOCKS)
    return BlockErrors(10.0 * mm**2 * shares * BLOCKS / shares.sum(), np.full(BLOCKS, 10.0), np.zeros(3))


def hypothesis(names, mm, *, seed=0, sizes=1.0, deviation=0.05):
    index = [e.name for e in LIBRARY]
    active = tuple(index.index(n) for n in names)
    columns = columns_of(LIBRARY)
    row = amplitudes_of(LIBRARY, **{n: sizes * find_effects([n])[0].typical for n in names})
    wide = sum(columns[k].stop - columns[k].start for k in active)
    fitted = Fitted(SI.initial, row, active, np.zeros(3), np.zeros((3, 5 + wide)), np.full(5 + wide, deviation), True)
    return Hypothesis(active, fitted, errors(mm, seed=seed))


def evidence_of(
    singles, *, base=12.0, floor=5.0, p=0.001, gate_list=(), joint=(), joint_p=0.001, sizes=1.0, instead=()
):
    """Evidence from errors in mm: `singles` and `joint` as {names: mm}."""
    given = (hypothesis((n,), mm, seed=k, sizes=sizes) for k, (n, mm) in enumerate(singles.items()))
    found = {h.effects[0]: h for h in given}
    index = [e.name for e in LIBRARY]
    effects = tuple(dict.fromkeys([*found, *(index.index(n) for names, _ in joint for n in names)]))
    p_values = np.full(len(effects), p)
    screened = Screened(
        effects=effects, amplitude=[], explained=p_values, absorbed=p_values, p_value=p_values, family_p_value=p_values,
        cosines=np.eye(len(effects)), predicted=p_values, predicted_mm2=p_values, correlation=p_values, raw=[],
        projected=[np.ones((1, 3)) for _ in effects], typical=p_values,
    )  # fmt: skip
    return Evidence(
        observer=SimpleNamespace(
            effects=LIBRARY, columns=columns_of(LIBRARY), in_mm=lambda row: 2.0, layout=NO_EDGE
        ),
        screened=screened, base=hypothesis((), base), singles=found,
        joint=[(hypothesis(names, mm, seed=9), joint_p) for names, mm in joint],
        floor_mm=floor, numerics_mm=1.0, picks=np.random.default_rng(1).integers(0, BLOCKS, (400, BLOCKS)),
        gates=[*PASSED, *gate_list], is_held_out=True, instead=list(instead),
    )  # fmt: skip


PASSED = [Gate(name="base fit", passed=True, figure=0.0, limit=5.0, unit="%", sentence="")]
COARSE = Gate(name="mesh and step", passed=False, figure=60.0, limit=40.0, unit="%", sentence="coarse")
CHAOTIC = Gate(name="predictability", passed=False, figure=3.0, limit=1.0, unit="mm", sentence="chaotic")
STILL = Gate(name="motion", passed=False, figure=3.0, limit=30.0, unit="mm", sentence="still")


def with_edge(one, squares, resting=0.0):
    """The same hypothesis where the held edge of the takes judged on is off by so many squared deviations, of 1000."""
    edge = EdgeErrors(moving=float(squares), count=1000, resting=resting, mm=0.02 * squares**0.5 + 0.01 * resting)
    return dataclasses.replace(one, errors=dataclasses.replace(one.errors, edge=edge))

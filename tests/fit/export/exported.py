"""A fit with known numbers, for tests of exports."""

from __future__ import annotations

import numpy as np
import pytest

from fit.cloth.material import MATERIAL_NAMES
from fit.effects import find_effects
from fit.export.kinds import EXPORT_KINDS, Order
from fit.methods import find_method
from formats.fit_records import ErrorFigure, FitError, FitParameter, FitResult

VALUES = {
    "stretch_stiffness": 100.0, "shear_stiffness": 30.0, "bending_stiffness": 1.4e-5, "bending_damping_time": 2e-3,
    "velocity_damping": 0.5,
}  # fmt: skip


def a_fit(method="si", *, values=None, unknown=(), effects=None, density=0.2, layers=1, engine="own"):
    """A result of `method` whose intervals are from 0.8 to 1.25 times the values; `unknown` are not identified."""
    found = find_method(method)
    given = {p.name: p.initial for p in found.parameters} | (VALUES if method == "si" else {}) | (values or {})
    effects = effects or {}
    parameters = [
        FitParameter(
            name=p.name, unit=p.unit, initial=p.initial, fitted=given[p.name], minimum=p.minimum, maximum=p.maximum,
            interval_low=0.8 * given[p.name], interval_high=1.25 * given[p.name],
            is_identified=p.name not in unknown and p.name not in found.degenerate, note=p.meaning,
        )
        for p in found.parameters
    ]  # fmt: skip
    row = found.to_materials(np.array([[given[p.name] for p in found.parameters]]), density)[0]
    for name, amplitude in effects.items():
        (effect,) = find_effects([name.split(".")[0]])
        least = 0.0 if effect.low == 0 else -3.0
        parameters.append(
            FitParameter(
                name=name, unit=effect.unit, initial=0.0, fitted=amplitude, minimum=least, maximum=3.0,
                interval_low=max(least, amplitude - 0.2), interval_high=amplitude + 0.2,
                is_identified=name not in unknown,
            )
        )  # fmt: skip
    for effect in find_effects(sorted({name.split(".")[0] for name in effects})):
        row = effect.material(
            row, np.array([effects[f"{effect.name}.{c}" if c else effect.name] for c in effect.components])
        )
    error = ErrorFigure(mean_m=0.008, max_m=0.02, per_frame_m=[0.008], time_s=[0.0])
    return FitResult(
        format="hangtime-fit/1", created="2026-03-01T12:00:00+00:00", take_ids=["swing-01"], held_out_ids=[],
        method=method, search="least-squares", seed=0, parameters=parameters,
        error=FitError(train_before=error, train_after=error), effects=dict(effects), history=[0.01, 0.008],
        simulations=10, seconds=1.0, notes=[], material=dict(zip(MATERIAL_NAMES, row.tolist(), strict=True)),
        engine=engine, take_contents=["ab" * 32], layers=layers,
    )  # fmt: skip


def text_of(kind, result, **order):
    """The text of the first file that an export of a kind makes."""
    if kind == "usd-physics":
        pytest.importorskip("pxr", reason="usd-core is not installed")
    made = EXPORT_KINDS[kind].make(Order(result=result, **order))
    return next(iter(made.values())).decode()

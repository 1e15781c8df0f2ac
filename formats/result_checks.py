"""Check the consistency of the numbers in a fit or diagnosis, beyond the rules of its schema.

A person may have edited a result, or a disk may have damaged it. Later commands would simulate, export and print the
wrong numbers.
"""

from __future__ import annotations

import itertools
import math
from typing import Any, NoReturn

import msgspec
import numpy as np

from formats.diagnosis_records import Diagnosis
from formats.errors import ResultError
from formats.fit_records import TRIVIAL_NAMES, Combination, ErrorFigure, FitParameter, FitResult

POSITIVE = ("areal_density", "stretch_stiffness", "bending_stiffness")  # of every material: others are divided by them
NOT_BELOW_0 = ("shear_stiffness", "membrane_damping_time", "bending_damping_time", "velocity_damping", "viscosity_time")
LARGEST_NUMBER = 1e100  # SI: products of three such numbers are still finite in double precision
DRAWN_ENDS = "tempering"  # its ends are quantiles of draws, and its value, the best draw, may lie outside
NOMINAL = "thickness"  # where it is fitted, stiffnesses are at the nominal one, and not the material's
ROUNDING = 1e-9  # relative: a bound goes through a logarithm and back, with an error of 1e-15
SHARES = ("probability", "p_value", "share")  # fields that must be from 0 to 1
LEAST_ZERO = ("mean_m", "max_m", "per_frame_m", "seconds")  # fields, or lists, that must not be below 0


def check_result(record: FitResult | Diagnosis, where: object) -> None:
    """Check a fit or a diagnosis before it is written and after it is read.

    Raises:
        ResultError: numbers that are not finite, beyond their own bounds, or contradict each other; names the field.
    """
    again = "fit again" if isinstance(record, FitResult) else "diagnose again"

    def refuse(what: str) -> NoReturn:
        raise ResultError(what, where=where, advice=again)

    _check_numbers(msgspec.to_builtins(record, enc_hook=as_plain), refuse, "")
    if isinstance(record, FitResult):
        _check_fit(record, refuse)
    else:
        _check_diagnosis(record, refuse)


def as_plain(value: Any) -> Any:
    """Convert a numpy number to a Python number."""
    if isinstance(value, np.generic):
        return value.item()
    raise NotImplementedError(f"a result holds a {type(value).__name__}")


def _check_fit(result: FitResult, refuse: Any) -> None:
    """Check that a fit's layers, parameters, combinations and material are consistent."""
    if result.layers < 1:
        refuse(f"layers is {result.layers}, and cloth has one or more")
    if result.spacing is not None and result.spacing <= 0:
        refuse(f"spacing is {result.spacing:g} m, and a mesh has more")
    may_leave = result.search == DRAWN_ENDS
    _check_parameters(result.parameters, "parameters", refuse, may_leave=may_leave)
    for number, combination in enumerate(result.combinations):
        _check_interval(combination, f"combinations[{number}]", refuse, may_leave=may_leave)
    for number, one in enumerate(result.trivial):
        if one.name not in TRIVIAL_NAMES:
            refuse(f"trivial[{number}].name: there is no predictor named {one.name!r}")
        _check_error(one.train, f"trivial[{number}].train", refuse)
        _check_error(one.held_out, f"trivial[{number}].held_out", refuse)
    for name, value in result.material.items():
        if _has_no_cloth(name, value):
            refuse(f"no cloth has {name} = {value:g}")
    for name in result.error.__struct_fields__:
        _check_error(getattr(result.error, name), f"error.{name}", refuse)
    has_material = not (result.effects or any(p.name == NOMINAL for p in result.parameters))
    for parameter in result.parameters:
        stated = {"effects": result.effects.get(parameter.name)}
        if has_material:  # an effect on the cloth changes its material
            stated["material"] = result.material.get(parameter.name)
        for field, other in stated.items():
            if other is not None and not _is_same(other, parameter.fitted):
                refuse(f"{field}.{parameter.name} is {other:g}, and the parameter's value {parameter.fitted:g}")


def _check_diagnosis(diagnosis: Diagnosis, refuse: Any) -> None:
    """Check that named effects were tested, and that the base model is within its bounds."""
    known = {finding.id for finding in diagnosis.effects}
    for name in [*diagnosis.named, *diagnosis.alternatives, *itertools.chain(*diagnosis.alternatives.values())]:
        if name not in known:
            refuse(f"names the effect {name!r}, which is not among its findings")
    if diagnosis.verdict == "effect" and len(diagnosis.named) != 1:
        refuse("the verdict `effect` names exactly one effect")
    _check_parameters(diagnosis.base_parameters, "base_parameters", refuse)
    symmetric = {f"effects[{number}].closure": one.closure for number, one in enumerate(diagnosis.effects)}
    for at, figure in {"gap.floor_mm": diagnosis.gap.floor_mm, **symmetric}.items():
        if figure is not None and figure.interval is not None:
            check_within(figure.value, *figure.interval, f"{at}.value is", refuse)


def _check_parameters(parameters: list[FitParameter], field: str, refuse: Any, *, may_leave: bool = False) -> None:
    for number, p in enumerate(parameters):
        at = f"{field}[{number}]"
        if p.minimum > p.maximum:
            refuse(f"{at}: the bounds of {p.name} are crossed ({p.minimum:g} to {p.maximum:g})")
        room = ROUNDING * max(abs(p.minimum), abs(p.maximum))
        for kind, value in (("fitted", p.fitted), ("initial", p.initial)):
            if not p.minimum - room <= value <= p.maximum + room:
                refuse(f"{at}.{kind}: {p.name} is {value:g}, outside its own bounds of {p.minimum:g} to {p.maximum:g}")
        _check_interval(p, at, refuse, may_leave=may_leave)
        _check_least(p, at, refuse)
        if p.name in [other.name for other in parameters[:number]]:
            refuse(f"{at}: {p.name} is there twice")


def _check_error(figure: ErrorFigure | None, at: str, refuse: Any) -> None:
    """Refuse a mean error below or above those of all frames, and frames without their times."""
    if figure is None or not figure.per_frame_m:
        return
    if len(figure.per_frame_m) != len(figure.time_s):
        refuse(f"{at} has the errors of {len(figure.per_frame_m)} frames and {len(figure.time_s)} times")
    low, high = min(figure.per_frame_m), max(figure.per_frame_m)
    if not low * (1 - ROUNDING) <= figure.mean_m <= high * (1 + ROUNDING):
        refuse(f"{at}.mean_m is {figure.mean_m:g}, and its frames have {low:g} to {high:g}")


def _check_least(p: FitParameter, at: str, refuse: Any) -> None:
    """Refuse a bound or an end of an interval that no cloth has."""
    for kind, value in (("minimum", p.minimum), ("interval_low", p.interval_low)):
        if value is not None and _has_no_cloth(p.name, value):
            refuse(f"{at}.{kind}: no cloth has {p.name} = {value:g}")


def _has_no_cloth(name: str, value: float) -> bool:
    return (name in POSITIVE and value <= 0) or (name in NOT_BELOW_0 and value < 0)


def _check_interval(number: FitParameter | Combination, at: str, refuse: Any, *, may_leave: bool) -> None:
    low, high = number.interval_low, number.interval_high
    if (low is None) != (high is None) or (low is not None and high is not None and low > high):
        refuse(f"the interval of {number.name} has not a lower and an upper end")
    if low is not None and high is not None and not may_leave:
        check_within(number.fitted, low, high, f"{at}.fitted: {number.name} is", refuse)


def check_within(value: float, low: float, high: float, whose: str, refuse: Any) -> None:
    """Refuse a value outside an interval; whose: the begin of the sentence, up to the value."""
    room = ROUNDING * max(abs(low), abs(high))
    if not low - room <= value <= high + room:
        refuse(f"{whose} {value:g}, outside its own interval of {low:g} to {high:g}")


def _check_numbers(value: Any, refuse: Any, at: str) -> None:
    """Refuse numbers that are not finite or too large, shares outside 0 to 1, and intervals with exchanged ends."""
    name = at.rpartition(".")[2]
    if isinstance(value, float):
        if not math.isfinite(value):
            refuse(f"{at or 'value'} is not a finite number")
        if abs(value) > LARGEST_NUMBER:
            refuse(f"{at} is {value:g}, and no result has a number that large")
        if name.partition("[")[0] in LEAST_ZERO and value < 0:
            refuse(f"{at} is {value:g}, and must not be below 0")
        if name in SHARES and not -ROUNDING <= value <= 1 + ROUNDING:
            refuse(f"{at} is {value:g}, and must be from 0 to 1")
    elif isinstance(value, dict):
        for key, inner in value.items():
            _check_numbers(inner, refuse, f"{at}.{key}" if at else str(key))
    elif isinstance(value, list | tuple):
        for number, inner in enumerate(value):
            _check_numbers(inner, refuse, f"{at}[{number}]")
        if name in ("interval", "amplitude_interval") and value[0] > value[1]:
            refuse(f"{at} has not a lower and an upper end")


def _is_same(one: float, other: float) -> bool:
    return math.isclose(one, other, rel_tol=ROUNDING, abs_tol=1e-300)

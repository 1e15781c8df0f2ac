"""Read again what `fit` and `diagnose` wrote, and check its units and signs by the methods and effects of today.

`formats.result_checks` has checked before that the numbers agree with each other.

A diagnosis' amplitudes and errors lie within their own intervals. An amplitude is the middle of its interval. An error
is the mean over blocks, and its interval holds 90 % of 1000 draws of these blocks. At the least favourable blocks that
a search found, 40 % of the draws lie at or below that mean, and 40 % at or above.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NoReturn

import msgspec

from fit.effects import LIBRARY
from fit.errors import FitError
from fit.folders import NAMED_BESIDE, refuse_unfinished
from fit.identification.combinations import COMBINATIONS
from fit.identification.notes_on_values import named_in_words, notes_beside
from fit.methods import METHODS
from formats.diagnosis_records import Diagnosis
from formats.errors import HangtimeError, ResultError
from formats.fit_records import WARNING, FitParameter, FitResult
from formats.result_checks import check_within
from formats.results import diagnosis_from, fit_result_from, load_diagnosis, load_fit_result, load_result
from formats.system_causes import step_to_read

OF_EFFECTS = {effect.name: (effect.unit, effect.low) for effect in LIBRARY}  # unit and least size of each


def load_fit(path: Path) -> FitResult:
    """Read a fit result.

    Raises:
        ResultError: it cannot be read, contradicts itself, or has a number of another unit or sign than its method's.
    """
    return _checked_fit(load_fit_result(path), path)


def fit_from(raw: bytes, where: object) -> FitResult:
    """Read a fit result from its bytes; where: their origin, for errors, which are those of `load_fit`."""
    return _checked_fit(fit_result_from(raw, where), where)


def load_diagnosed(path: Path) -> Diagnosis:
    """Read a diagnosis; the errors are those of `load_fit`."""
    return _checked_diagnosis(load_diagnosis(path), path)


def diagnosed_from(raw: bytes, where: object) -> Diagnosis:
    """Read a diagnosis from its bytes; where: their origin, for errors, which are those of `load_fit`."""
    return _checked_diagnosis(diagnosis_from(raw, where), where)


def _checked_fit(result: FitResult, where: object) -> FitResult:
    method = METHODS.get(result.method)  # None of another version
    known = {p.name: (p.unit, p.minimum) for p in (method.parameters if method is not None else ())}
    _check(result.parameters, "parameters", known, where, "fit again")
    units = {name: unit for name, unit, *_ in COMBINATIONS}
    for number, one in enumerate(result.combinations):
        _check_unit(f"combinations[{number}].unit", one.name, one.unit, units, where, "fit again")
    return result


def _checked_diagnosis(diagnosis: Diagnosis, where: object) -> Diagnosis:
    def refuse(what: str) -> NoReturn:
        _refuse(what, where, "diagnose again")

    known = {p.name: (p.unit, p.minimum) for one in METHODS.values() for p in one.parameters}
    _check(diagnosis.base_parameters, "base_parameters", known, where, "diagnose again")
    units = {name: unit for name, (unit, _) in OF_EFFECTS.items()}
    for number, effect in enumerate(diagnosis.effects):
        _check_unit(f"effects[{number}].unit", effect.id, effect.unit, units, where, "diagnose again")
        if effect.amplitude_interval is not None:
            check_within(effect.amplitude, *effect.amplitude_interval, f"effects[{number}].amplitude is", refuse)
    gap = diagnosis.gap
    for name, figure in (("base_mm", gap.base_mm), ("with_effect_mm", gap.with_effect_mm)):
        if figure is not None and figure.interval is not None:
            check_within(figure.value, *figure.interval, f"gap.{name}.value is", refuse)
    return diagnosis


def load_either(path: Path) -> FitResult | Diagnosis:
    """Read a fit or a diagnosis; the errors are those of the kind that the file states, or else those of `load_fit`."""
    result = load_result(path)
    return _checked_fit(result, path) if isinstance(result, FitResult) else _checked_diagnosis(result, path)


def _check(
    parameters: Sequence[FitParameter], field: str, known: Mapping[str, tuple[str, float]], where: object, again: str
) -> None:
    """Check units and signs of parameters by what is known of each: its unit, and the least value of its range."""
    of_all = {**OF_EFFECTS, **known}
    units = {name: unit for name, (unit, _) in of_all.items()}
    for number, p in enumerate(parameters):
        name, at = p.name.partition(".")[0], f"{field}[{number}]"
        _check_unit(f"{at}.unit", name, p.unit, units, where, again)
        for kind, value in (("fitted", p.fitted), ("minimum", p.minimum), ("interval_low", p.interval_low)):
            if value is not None and value < 0 <= of_all.get(name, ("", value))[1]:
                _refuse(f"{at}.{kind}: {p.name} is {value:g}, and is never below 0", where, again)


def _check_unit(at: str, name: str, unit: str, units: Mapping[str, str], where: object, again: str) -> None:
    if unit != units.get(name, unit):
        _refuse(f"{at}: {name} is in {unit or 'no unit'}, and Hangtime has it in {units[name]}", where, again)


def _refuse(what: str, where: object, again: str) -> NoReturn:
    raise ResultError(what, where=where, advice=again)


def read_fit(path: Path) -> tuple[FitResult, Path]:
    """Return a fit result and its path, from the path of the file or of the folder that `hangtime fit` filled.

    A note says which effect the fit lacks by a diagnosis of the same takes beside it.

    Raises:
        HangtimeError: the file cannot be read, or is no fit.
    """
    try:
        file = path / "fit.json" if path.is_dir() else path
        refuse_unfinished(file)
        if path.is_dir() and not file.exists() and file.with_name("diagnosis.json").exists():
            raise FitError(
                "holds a diagnosis and no fit, and a diagnosis has no fabric", where=path,
                advice="run `hangtime fit` on its takes, with --out of this folder",
            )  # fmt: skip
    except OSError as error:
        raise FitError(f"cannot be read ({error.strerror})", where=path, advice=step_to_read(error)) from error
    result = load_either(file)
    if isinstance(result, Diagnosis):
        raise FitError("is a diagnosis, which has no fabric", where=file, advice="give the fit.json of `hangtime fit`")
    return _with_diagnosis(result, file.with_name("diagnosis.json")), file


def _with_diagnosis(result: FitResult, path: Path) -> FitResult:
    """Return a fit with a note if the diagnosis of the same takes names an effect that the fit lacks.

    Its other notes say what this diagnosis found, instead of the advice to diagnose.
    A diagnosis that is damaged or was changed may name one, too.
    """
    if not os.path.lexists(path):
        return result
    try:
        diagnosis = load_diagnosed(path)
    except HangtimeError as error:
        note = (
            f"{WARNING} {path.name} beside this fit cannot be used: {error.what}. It may name an effect lacking here."
        )
        return msgspec.structs.replace(result, notes=[*result.notes, note])
    fitted = {name.partition(".")[0] for name in result.effects}
    is_any = diagnosis.verdict == "ambiguous"
    lacking = [name for name in diagnosis.named if name not in fitted]
    of_same = result.take_contents and sorted(result.take_contents) == sorted(diagnosis.take_contents)
    if of_same:
        result = msgspec.structs.replace(result, notes=notes_beside(result, diagnosis))
    if not of_same or not lacking or (is_any and len(lacking) < len(diagnosis.named)):
        return result
    note = (
        f"{NAMED_BESIDE}names {named_in_words(diagnosis, lacking)}, which this fit leaves out. "
        "Fitted values may make up for that. Fit "
        f"again with --effect {lacking[0] if is_any else ' --effect '.join(lacking)}."
    )
    return msgspec.structs.replace(result, notes=[*result.notes, note])

"""Guess the unit or number that a person meant by an implausible number or by a text in a number's place."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

NEAR_A_RANGE = 2.0  # times the longest: a nearer length has the right unit; a wrong unit is off 25 times or more
UNITS = (("millimetres", 1e-3), ("centimetres", 1e-2), ("inches", 0.0254))
TIME_UNITS = (("milliseconds", 1e-3),)  # in seconds
SPEED_UNITS = (("kilometres an hour", 1 / 3.6), ("millimetres a second", 1e-3))  # in metres a second

LENGTH_UNITS = {
    "m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254, "metres": 1.0, "meters": 1.0, "inches": 0.0254,
    "centimetres": 1e-2, "centimeters": 1e-2, "millimetres": 1e-3, "millimeters": 1e-3,
}  # fmt: skip
TIMES = {
    "s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 1e-3, "us": 1e-6, "\u00b5s": 1e-6, "min": 60.0, "minutes": 60.0,
    "h": 3600.0, "hours": 3600.0, "d": 86_400.0, "days": 86_400.0,
}  # fmt: skip
OUNCE = 0.028349523125  # kg: NIST Handbook 44, appendix C, avoirdupois
WEIGHT_UNITS = {"kg": 1.0, "kilograms": 1.0, "g": 1e-3, "grams": 1e-3, "oz": OUNCE, "ounces": OUNCE}
# By the end of a field's name, the units that may stand behind a number, in the field's own unit.
UNITS_OF = {
    "m": LENGTH_UNITS, "s": TIMES, "us": {unit: 1e6 * size for unit, size in TIMES.items()}, "kg": WEIGHT_UNITS,
    "mb": {"MB": 1.0, "GB": 1e3, "kB": 1e-3}, "hz": {"Hz": 1.0}, "degrees": {"\u00b0": 1.0, "deg": 1.0, "degrees": 1.0},
    "px": {"px": 1.0, "pixels": 1.0}, "minutes": {unit: size / 60.0 for unit, size in TIMES.items()},
    "hours": {unit: size / 3600.0 for unit, size in TIMES.items()},
    "days": {unit: size / 86_400.0 for unit, size in TIMES.items()},
    "bytes": {"B": 1.0, "kB": 1e3, "MB": 1e6, "GB": 1e9, "TB": 1e12, "bytes": 1.0},
}  # fmt: skip
MINUS_SIGNS = str.maketrans("\u2212\u2013", "--")  # the minus sign, and the dash that some editors make of a hyphen
NUMBER_WITH_UNIT = re.compile(
    r"([+-]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][+-]?\d+)?)[ \t]*([A-Za-z]*|\u00b5s|\u00b0)", re.ASCII
)

THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")  # a thousand, or a decimal comma: nobody can say


def number_meant(text: str, field: str) -> str:
    """Return the number that a text such as `0,06` or `35 g` means in the unit of a field, '' if it means none.

    The unit of a field is the end of its name: kilograms of `mass_kg`, metres of `points[2].at_m[0]`.
    """
    found = NUMBER_WITH_UNIT.fullmatch(text.strip()[:100].translate(MINUS_SIGNS))
    if found is None or THOUSANDS.fullmatch(found[1]):
        return ""
    units = UNITS_OF.get(re.sub(r"\[.*", "", field.rpartition(".")[2]).rpartition("_")[2], {})
    size = 1.0 if not found[2] else units.get(found[2])
    number = float(found[1].replace(",", "."))
    return "" if size is None or not math.isfinite(number) else f"{number * size:.12g}"


def question_of(number: str, field: str) -> str:
    """Return a question that names the number meant, with its field where the number is all of the field's value."""
    if not number:
        return ""
    return f"; was {field} = {number} meant?" if field and not field.endswith("]") else f"; was {number} meant?"


def unit_of(value: float, least: float, most: float) -> str:
    """Return a question that names the unit in which a length would fit the range.

    Return '' where the length fits already, or no unit fits.
    """
    if least <= value <= NEAR_A_RANGE * most:
        return ""
    fitting = [name for name, metres in UNITS if least <= value * metres <= most]
    return f"; were {' or '.join(fitting)} meant?" if fitting else ""


def meant(value: float, least: float, most: float, units: Sequence[tuple[str, float]]) -> str:
    """Return a question that names the unit in which a number outside its range would fit, '' without one.

    A number within a factor of `NEAR_A_RANGE` of the range has the right unit, and is only too small or too large.

    units: names, and how many of the required unit each is
    """
    if value <= 0 or least / NEAR_A_RANGE <= value <= NEAR_A_RANGE * most:
        return ""
    fitting = [name for name, factor in units if least <= value * factor <= most]
    return f"; were {' or '.join(fitting)} meant?" if fitting else ""


def step_or_anyway(step: str, offers_anyway: bool) -> str:
    """Return the next step, followed by the option --anyway where the command has it."""
    return f"{step}, or --anyway to accept it" if offers_anyway else step

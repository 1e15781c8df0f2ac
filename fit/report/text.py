"""Formatting of numbers, units, intervals and names for the report."""

from __future__ import annotations

import math
import re
from datetime import UTC, datetime

from markupsafe import Markup, escape

NO_BREAK = "\u00a0"  # a space at which no line breaks: a unit stays beside its number
BEFORE_UNIT = re.compile(r"(?<=\d) (?=(?:mm|cm|m|m/s|ms|s|kg|g|kg/m\^?2|N|N/m|N m|Pa|Hz|per|%|\u2192)(?![A-Za-z]))")
POWER = re.compile(r"(?<=[a-z])\^?(-?\d)")  # of a unit: m2, s^2
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
MISSING = "–"


def words(name: str) -> Markup:
    """Return an identifier as escaped words."""
    return escape(name.replace("_", " "))


def number(value: float | None, digits: int = 3) -> str:  # our choice: no fit knows a parameter to more
    """Return a number with this many significant digits, as a page sets it; a dash for None.

    It has a minus sign, powers of ten with superscripts and no idle zeros. `formats.figures.short` is for terminals and
    for text that people copy, which must stay ASCII.
    """
    if value is None or not math.isfinite(value):
        return MISSING
    if value == 0:
        return "0"
    exponent = math.floor(math.log10(abs(value)))
    if -4 < exponent < 6:
        text = f"{value:.{max(0, digits - 1 - exponent)}f}"
        return (text.rstrip("0").rstrip(".") if "." in text else text).replace("-", "−")
    mantissa, power = f"{value:.{digits - 1}e}".split("e")
    return f"{mantissa.rstrip('0').rstrip('.')} × 10{str(int(power)).translate(SUPERSCRIPTS)}".replace("-", "−")


def instant(written: str) -> str:
    """Return an ISO 8601 instant as day and minute in UTC; any other text stays as it is."""
    try:
        found = datetime.fromisoformat(written)
    except ValueError:
        return written
    return f"{found.astimezone(UTC):%Y-%m-%d %H:%M} UTC" if found.tzinfo is not None else written


def millimetres(metres: float | None) -> str:
    """Return a length given in metres in millimetres with one decimal."""
    return MISSING if metres is None or not math.isfinite(metres) else f"{1e3 * metres:.1f} mm"


def tenths(value: float | None, unit: str = "mm") -> str:
    """Return a number with one decimal and its unit, so that a column of them lines up."""
    return MISSING if value is None or not math.isfinite(value) else f"{value:.1f} {unit}".replace("-", "−")


def tenths_interval(ends: tuple[float, float] | None, unit: str = "mm") -> str:
    """Return an interval as `low to high` with one decimal and its unit, or nothing."""
    if ends is None or not all(math.isfinite(end) for end in ends):
        return ""
    return f"{ends[0]:.1f} to {ends[1]:.1f} {unit}"


def unbroken(figure: str) -> str:
    """Return a figure of which no line begins with a unit or an arrow."""
    return BEFORE_UNIT.sub(NO_BREAK, figure)


def percent(share: float | None) -> str:
    """Return a share of one as a percentage."""
    return MISSING if share is None or not math.isfinite(share) else f"{100 * share:z.0f} %".replace("-", "−")


def interval(ends: tuple[float, float] | None, scale: float = 1.0, digits: int = 3) -> str:  # our choice: as above
    """Return an interval as `low to high`, or nothing."""
    if ends is None or not all(math.isfinite(end) for end in ends):
        return ""
    return f"{number(scale * ends[0], digits)} to {number(scale * ends[1], digits)}"


def unit_of(unit: str) -> Markup:
    """Return a unit after a thin space, as `per s` for 1/s and m\u00b2 for m2; nothing for a pure number."""
    return Markup("") if unit in ("", "1") else Markup("&#8239;{}").format(unit_words(unit))


def unit_words(unit: str) -> str:
    """Return a unit as a page sets it: `per s` for 1/s, and powers as superscripts."""
    raised = POWER.sub(lambda power: power[1].translate(SUPERSCRIPTS), unit)
    return f"per {raised.removeprefix('1/')}" if raised.startswith("1/") else raised


def probability(value: float | None) -> str:
    """Return a p-value or probability; very small ones as a bound."""
    if value is None or not math.isfinite(value):
        return MISSING
    return "< 0.001" if value < 0.001 else f"{value:.3f}" if value < 0.1 else f"{value:.2f}"


def duration(seconds: float) -> str:
    """Return a duration in seconds or minutes."""
    if not math.isfinite(seconds):
        return MISSING
    return f"{seconds:.1f} s" if seconds < 90 else f"{seconds / 60:.1f} min"

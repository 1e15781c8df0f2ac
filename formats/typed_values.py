"""Reword Typer's error about an invalid option value."""

from __future__ import annotations

import math
import re
from typing import Any

from formats.meant_units import THOUSANDS, number_meant
from formats.near_names import near_names

COMMA_FOR_POINT = re.compile(r"[+-]?\d*,\d+")
# Typer's words for a value and its choices.
NOT_ONE_OF = re.compile(r"(?:Value error, )?('(.*)' is not (?:one of )?('.*'))\.?", re.DOTALL)
QUOTED = re.compile(r"'([^']*)'")
RANGE_WORDS = {"ge": "at least", "gt": "above", "le": "at most", "lt": "below"}
NOUNS = {
    "float": "number",
    "finite": "finite number",
    "int": "whole number",
    "bool": "answer of yes or no",
    "path": "path",
}
# Of an option, by its value's word in the help or by its name: a field's name whose ending has the same unit.
UNIT_FIELDS = {
    "METRES": "_m", "KG": "_kg", "HZ": "_hz", "HERTZ": "_hz", "SECONDS": "_s", "HOURS": "_hours", "MINUTES": "_minutes",
    "seconds": "_s", "height": "_m", "keep_days": "_days",
}  # fmt: skip


def reword(error: Any) -> None:
    """Replace the text of a failed validation by the value and, where known, the intended value.

    Typer before 0.27 validates by itself and names the value; its errors stay unchanged. So do those of a choice, which
    get the question whether a near one was meant.
    """
    if chosen := NOT_ONE_OF.fullmatch(str(getattr(error, "message", ""))):
        near = near_names(chosen[2], QUOTED.findall(chosen[3]))
        error.message = chosen[1] + (f"; did you mean {near[0]!r}?" if near else ".")
        return
    found = getattr(error.__cause__, "errors", None)
    if not callable(found) or not hasattr(error, "message"):
        return
    first = found()[0]
    given, kind = str(first["input"]), str(first["type"])
    limits = [f"{RANGE_WORDS[name]} {limit:g}" for name, limit in first.get("ctx", {}).items() if name in RANGE_WORDS]
    noun = next((noun for begin, noun in NOUNS.items() if kind.startswith(begin)), None)
    if limits:
        error.message = f"{given} is outside the range: the value must be {' and '.join(limits)}"
        if math.isnan(float(given)):
            error.message = f"{given!r} is no number"
    elif noun is not None:
        error.message = f"{given!r} is no {noun}"
        if COMMA_FOR_POINT.fullmatch(given.strip()) and not THOUSANDS.fullmatch(given.strip()):
            error.message += f"; write a decimal point: {given.strip().replace(',', '.')}"
        elif kind.startswith("float") and (number := number_meant(given, _field_of(error))):
            error.message += f"; was {number} meant?"
    else:
        error.message = str(first["msg"]).removeprefix("Value error, ")


def _field_of(error: Any) -> str:
    """Return the name of a field with the unit of the option that an error names, '' if the option has none."""
    words = error.param.metavar, error.param.name
    return next((UNIT_FIELDS[word] for word in words if word in UNIT_FIELDS), "")

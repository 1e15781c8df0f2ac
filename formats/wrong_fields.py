"""Describe in one sentence the wrong field of a description, a configuration or a result, and the fault."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Any, Literal, get_args, get_origin, get_type_hints

import msgspec

from formats.meant_units import number_meant, question_of
from formats.near_names import near_names

KIND_WORDS = {
    "str": "text", "bool": "true or false", "int": "a whole number", "float": "a number", "array": "a list",
    "object": "a table", "null": "nothing", "datetime": "a date", "date": "a date", "time": "a time",
}  # fmt: skip
WRONG_VALUE = re.compile(r"Expected `([^`]+)`(?: (matching regex|of length|>=|<=|>|<) ?(.*?))?(?:, got (.*))?$")
LARGEST_WHOLE = 2.0**53  # a larger number of type float may stand for several whole numbers
BOUNDS = {">=": "at least", "<=": "at most", ">": "above", "<": "below"}


def wrong_field(error: msgspec.MsgspecError, parts: Sequence[Any], held: object = None) -> str:
    """Return the wrong field and its required value; for an unknown field, name the closest known one.

    held: the tables in which the error was found, for a number that is none of the field's, or a text in its place
    """
    message = str(error)
    place = re.search(r" - at (`key` in )?`\$\.?(.*?)`", message)
    field = f"a key of {place.group(2)}" if place and place.group(1) else place.group(2) if place else ""
    words = re.sub(r" - at (`key` in )?`.*?`", "", message).removeprefix("Object ")
    if unknown := re.search(r"(?s)unknown field `(.+?)`(?= - at `|$)", message):
        known = [f.name for part in parts for f in msgspec.structs.fields(part)]
        close = near_names(unknown.group(1), known)
        hint = f"; did you mean `{close[0]}`?" if close else ""
        return f"unknown field `{unknown.group(1)}`{' in ' + field if field else ''}{hint}"
    if missing := re.match(r"missing required field `(.+?)`", words):
        return f"the field `{missing.group(1)}` is missing{' in ' + field if field else ''}"
    if invalid := re.match(r"Invalid enum value (.+)", words):
        choices = _choices(field, parts)
        return f"{field} must be one of {choices} (got {invalid.group(1)})"
    if expected := WRONG_VALUE.match(words):
        value = _at(field, held)
        return f"{field or 'the file'} must be {_wanted(expected, value)}{_meant(expected, field, value)}"
    if not isinstance(error, msgspec.ValidationError):
        return "the file is damaged or no JSON"
    return f"{field}: {words}" if field else words  # an error of Hangtime's own check


def _at(field: str, held: object) -> Any:
    """Return the value of a field in the tables that hold it, None where it is not known."""
    value: Any = held
    for key, row in re.findall(r"([^.\[\]]+)|\[(\d+)\]", field):
        try:
            value = value[int(row) if row else key]
        except (LookupError, TypeError):  # a name with signs of a path
            return None
    return value


def _wanted(expected: re.Match[str], value: object) -> str:
    """Return the required and the actual value, from the parts of a message; a number is shown itself."""
    kinds, relation, limit, got = expected.groups()
    wanted = " or ".join(_named(kind) for kind in kinds.split(" | "))
    if relation == "of length":
        wanted += f" of {limit}" if kinds != "str" else f" of {limit} letters"
    elif relation in BOUNDS:
        wanted += f" {BOUNDS[relation]} {limit}"
    elif relation:
        wanted += " of another form"
    if got is None:
        return wanted
    is_number = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < LARGEST_WHOLE
    return f"{wanted} (got {value if is_number else _named(got.strip('`'))})"


def _meant(expected: re.Match[str], field: str, value: object) -> str:
    """Return a question that names the number or the point meant, '' where the field takes none or none is meant."""
    wanted = set(expected[1].split(" | "))
    if isinstance(value, float) and "int" in wanted and value.is_integer():
        return question_of(f"{value:.0f}" if abs(value) < LARGEST_WHOLE else "", field)
    if isinstance(value, list) and expected[2] == "of length":
        is_longer = str(expected[3]).isdigit() and len(value) > int(expected[3])
        return "; was a comma meant as a decimal point?" if is_longer and any(isinstance(p, int) for p in value) else ""
    if not isinstance(value, str) or not wanted & {"float", "int"}:
        return ""
    number = number_meant(value, field)
    return question_of(number, field) if "float" in wanted or re.fullmatch(r"[+-]?\d+", number) else ""


def _named(kind: str) -> str:
    return KIND_WORDS.get(kind, kind)


def _choices(field: str, parts: Sequence[Any]) -> str:
    """Return the values that a field may have, from the types with such a field."""
    name = re.sub(r"\[.*?\]", "", field).split(".")[-1]
    values = [str(one) for part in parts for one in _literals(get_type_hints(part).get(name))]
    return ", ".join(dict.fromkeys(values)) or "the known values"


def _literals(hint: Any) -> Iterator[object]:
    """Yield the values of a type's `Literal`, including those in unions."""
    if get_origin(hint) is Literal:
        yield from get_args(hint)
    else:
        for inner in get_args(hint):
            yield from _literals(inner)

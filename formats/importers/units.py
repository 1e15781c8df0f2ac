"""Units of length as motion capture files spell them."""

from __future__ import annotations

import math
import re
import unicodedata

from formats.errors import TakeError

METRES = {"m": 1.0, "dm": 0.1, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254, "ft": 0.3048}
USUAL = {
    "m": "metres",
    "cm": "centimetres",
    "mm": "millimetres",
    "in": "inches",
}  # units that users confuse
RATIO_WITHIN = 0.2  # natural logarithm of a ratio of lengths: inches and decimetres differ by 1.4, folds take less
SPELLINGS = {
    "metre": "m", "meter": "m", "decimetre": "dm", "decimeter": "dm", "centimetre": "cm", "centimeter": "cm",
    "millimetre": "mm", "millimeter": "mm", "micrometre": "um", "micrometer": "um", "micron": "um", "\u03bcm": "um",
    "inch": "in", "inche": "in", "foot": "ft", "feet": "ft",
    "metro": "m", "metri": "m", "mtr": "m", "mt": "m", "centimetro": "cm", "centimetri": "cm", "zentimeter": "cm",
    "millimetro": "mm", "millimetri": "mm", "milimetro": "mm", "milimeter": "mm", "milimetre": "mm", "millimiter": "mm",
}  # fmt: skip
SYMBOL_BEHIND = re.compile(r"(\w+) ?[(\[](\w+)")  # metre (m), its last bracket stripped
LONGEST_UNIT = 20  # characters of an unknown unit that an error quotes: a damaged file may hold thousands


def axes_of(unit: str) -> list[str]:
    """Return the endings of a marker's three column names, such as `_x_mm`, `_y_mm`, `_z_mm`."""
    return [f"_{axis}_{unit}" for axis in "xyz"]


def metres_of(stated: str, given: str | None, where: object) -> float:
    """Return the length of a unit [m]; `given`, the user's unit, counts where the file states none that is known.

    Raises:
        TakeError: the unit is unknown, none is stated or given, or the two differ.
    """
    word = _short(stated)
    if given is not None and _short(given) not in METRES:
        raise TakeError(f"there is no unit {given!r}", where="--unit", advice=f"give one of {', '.join(METRES)}")
    if word not in METRES and given is not None:
        return METRES[_short(given)]
    if word not in METRES:
        told = f"the unit of its points is {stated.strip()[:LONGEST_UNIT]!r}" if word else "states no unit of length"
        raise TakeError(told, where=where, advice=f"give --unit, one of {', '.join(METRES)}")
    if given is not None and _short(given) != word:
        raise TakeError(
            f"states its lengths in {word}, not {given}", where=where,
            advice="leave out --unit, or mend the unit that the file states",
        )  # fmt: skip
    return METRES[word]


def other_unit(ratio: float) -> str:
    """Return a question that names a probable wrong unit, '' where none fits.

    `ratio`: measured lengths over true lengths
    """
    for taken, its_name in USUAL.items():
        for meant, name in USUAL.items():
            if meant != taken and ratio > 0 and abs(math.log(ratio * METRES[meant] / METRES[taken])) < RATIO_WITHIN:
                return f"; are these {name} that were taken for {its_name}?"
    return ""


def _short(unit: str) -> str:
    """Return a unit's symbol, or an unknown unit's word without accents, brackets and plural."""
    letters = unicodedata.normalize("NFKD", unit)  # turns the micro sign into the Greek letter
    word = "".join(letter for letter in letters if not unicodedata.combining(letter)).lower().replace("(s)", "")
    word = word.strip(" \t[]().'\"")
    if both := SYMBOL_BEHIND.fullmatch(word):
        outer, inner = _short(both[1]), _short(both[2])
        return inner if outer == inner else word
    return SPELLINGS.get(word, SPELLINGS.get(word.rstrip("s"), word))

"""Units of length as motion capture files spell them."""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, field

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


@dataclass
class GivenUnit:
    """The unit that the user gave for the lengths of a file.

    - `word`: the unit as it was given
    - `anyway`: whether it counts where the file states another unit; None: it does not, and no error offers --anyway
    - `overridden`: the units that the file stated and that did not count, by their symbols
    - `is_alone`: whether the file states no known unit, so that this one counts by itself
    """

    word: str
    anyway: bool | None = None
    overridden: list[str] = field(default_factory=list)
    is_alone: bool = False

    def warning_of(self, longest: float) -> str:
        """Return a warning of the units that did not count, '' without any.

        longest: the longest side of the box around all positions, as they were read [m]
        """
        if not self.overridden:
            return ""
        stated, given = self.overridden[0], _short(self.word)
        as_stated = longest / METRES[given] * METRES[stated]
        return (
            f"the file states its lengths in {' and '.join(self.overridden)}, and --unit {given} counts; its markers "
            f"span {longest:.3g} m, which {stated} would make {as_stated:.3g} m"
        )


def axes_of(unit: str) -> list[str]:
    """Return the endings of a marker's three column names, such as `_x_mm`, `_y_mm`, `_z_mm`."""
    return [f"_{axis}_{unit}" for axis in "xyz"]


def metres_of(stated: str, given: GivenUnit | str | None, where: object) -> float:
    """Return the length of a unit [m]; `given`, the user's unit, counts where the file states none that is known.

    Raises:
        TakeError: the unit is unknown, none is stated or given, or the two differ.
    """
    asked = GivenUnit(given) if isinstance(given, str) else given
    word = _short(stated)
    if asked is not None and _short(asked.word) not in METRES:
        raise TakeError(f"there is no unit {asked.word!r}", where="--unit", advice=f"give one of {', '.join(METRES)}")
    if word not in METRES and asked is not None:
        asked.is_alone = True
        return METRES[_short(asked.word)]
    if word not in METRES:
        told = f"the unit of its points is {stated.strip()[:LONGEST_UNIT]!r}" if word else "states no unit of length"
        raise TakeError(told, where=where, advice=f"give --unit, one of {', '.join(METRES)}")
    if asked is not None and _short(asked.word) != word:
        return _of_two(word, asked, where)
    return METRES[word]


def _of_two(stated: str, asked: GivenUnit, where: object) -> float:
    """Return the length of the given unit [m], and note the stated one that it overrides.

    Raises:
        TakeError: the given unit may not override the one that the file states.
    """
    given = _short(asked.word)
    if asked.anyway:
        asked.overridden += [stated] * (stated not in asked.overridden)
        return METRES[given]
    step = "mend the unit that the file states"
    if asked.anyway is not None:
        step = f"give --anyway too, and {given} counts"
    raise TakeError(
        f"states its lengths in {stated}, not {asked.word}: its 1000 is {1e3 * METRES[stated]:g} m, and would be "
        f"{1e3 * METRES[given]:g} m", where=where,
        advice=f"leave out --unit, or {step}",
    )  # fmt: skip


def other_unit(ratio: float) -> str:
    """Return a question that names a probable wrong unit, '' where none fits.

    `ratio`: measured lengths over true lengths
    """
    if (found := _taken_and_meant(ratio)) is None:
        return ""
    taken, meant = found
    return f"; are these {USUAL[meant]} that were taken for {USUAL[taken]}?"


def step_of_unit(ratio: float, overridden: Sequence[str] = (), *, is_stated: bool = True) -> str:
    """Return the options with which the probable unit counts, '' where none fits.

    - `ratio`: as in `other_unit`
    - `overridden`: symbols of the units that the file states and that --unit overrides
    - `is_stated`: whether the file states a unit, which --unit overrides only with --anyway
    """
    if (found := _taken_and_meant(ratio)) is None:
        return ""
    if found[1] in overridden:
        return "; if so, leave out --unit"
    return f"; if so, give --unit {found[1]}{' --anyway' * is_stated}"


def _taken_and_meant(ratio: float) -> tuple[str, str] | None:
    """Return the symbols of the unit taken and of the one meant, None where none fit; `ratio` as in `other_unit`."""
    for taken in USUAL:
        for meant in USUAL:
            if meant != taken and ratio > 0 and abs(math.log(ratio * METRES[meant] / METRES[taken])) < RATIO_WITHIN:
                return taken, meant
    return None


def _short(unit: str) -> str:
    """Return a unit's symbol, or an unknown unit's word without accents, brackets and plural."""
    letters = unicodedata.normalize("NFKD", unit)  # turns the micro sign into the Greek letter
    word = "".join(letter for letter in letters if not unicodedata.combining(letter)).lower().replace("(s)", "")
    word = word.strip(" \t[]().'\"")
    if both := SYMBOL_BEHIND.fullmatch(word):
        outer, inner = _short(both[1]), _short(both[2])
        return inner if outer == inner else word
    return SPELLINGS.get(word, SPELLINGS.get(word.rstrip("s"), word))

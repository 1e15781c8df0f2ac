"""Parse the cells of a marker text file: numbers as programs write them, and words for a missing value."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache

import numpy as np

NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.IGNORECASE | re.ASCII)  # `float` also accepts 1_0
WITH_SIGNS = re.compile(r"[+-]?[\d.,]*[.,][\d.,]*(e[+-]?\d+)?", re.IGNORECASE | re.ASCII)
SIGNED = re.compile(r"[+-]?[\d.,]*\d[\d.,]*(e[+-]?\d+)?", re.IGNORECASE | re.ASCII)  # with or without separators
DECIMALS = {"comma": ",", "point": "."}  # decimal separators by their names in --decimal
# A space of any width or an apostrophe as the thousands separator, as in 1 500,25 and 1'500.25.
GROUP_SIGNS = " \u00a0\u2009\u202f'\u2019"
WITH_GROUPS = {sign: re.compile(rf"[+-]?[1-9]\d{{0,2}}(\{sign}\d{{3}})+", re.ASCII) for sign in DECIMALS.values()}
GROUPED = re.compile(rf"[+-]?[1-9]\d{{0,2}}([{GROUP_SIGNS}])\d{{3}}(\1\d{{3}})*([.,]\d*)?", re.ASCII)
CELL_END = "\n"  # between the cells of a line that is matched as one text; no line holds one
# characters of a cell in a message. Our choice: half a line of a terminal; a longer cell would hide the sentence.
CELL_SHOWN = 40
# Missing values of programs, spreadsheets (#N/A), R (NA), and the newer C library of Windows.
GAP_WORDS = {"", "-", "--", "nan", "null", "none", "n/a", "na", "#n/a", "#n/v", "nan(ind)", "nan(snan)"}
# The older C library pads `1.#QNAN` with zeros, or rounds its letters: to two decimals 1.#R, to three 1.#QO.
# It rounds `-1.#IND`, its result of 0/0, to -1.$, -1.#J and -1.#IO, and infinity to the same letters.
# `IND` always has a minus. Without a minus the letters mean infinity, which is no missing value.
OLD_WINDOWS_GAP = re.compile(r"([+-]?1\.#((ind|[qs]?nan)0*|[qs]nb|[qs]o|[rt])|-1\.(\$|#j|#io))(e\+0+)?")


@dataclass(frozen=True)
class Form:
    """The format of a number: count of digits behind its point, and count of characters behind its `e`."""

    digits: int
    power: int


def number_of(cell: str) -> float:
    """Return the number in a cell, NaN where the cell stands for a missing value.

    Raises:
        ValueError: the cell holds anything else; the error quotes the cell.
    """
    # 1e999 is infinite, and no position is. To read it as a missing value would hide a fault.
    if NUMBER.fullmatch(cell) and math.isfinite(number := float(cell)):  # most cells; quick
        return number
    word = cell.strip().lower()
    plain = word.replace(",", ".")
    if NUMBER.fullmatch(plain) and math.isfinite(number := float(plain)):
        return number
    if word in GAP_WORDS or word.lstrip("+-") in GAP_WORDS or OLD_WINDOWS_GAP.fullmatch(plain):
        return np.nan
    raise ValueError(f"{cell.strip()[:CELL_SHOWN]!r}, which is no number")


def with_point(cell: str, decimal: str) -> str | None:
    """Return a cell's number with a decimal point and no thousands separators, other text unchanged.

    Return None for a number that contradicts the decimal separator.

    decimal: the decimal separator, comma or point; the other one, a space or an apostrophe separates thousands
    """
    word = cell.strip()
    if grouped := GROUPED.fullmatch(word):
        word = word.replace(grouped[1], "")
        return None if word.strip("+-0123456789") not in ("", decimal) else word.replace(decimal, ".")
    if not WITH_SIGNS.fullmatch(word):
        return cell
    other = "," if decimal == "." else "."
    whole, sign, behind = word.partition(decimal)
    if other in whole and not WITH_GROUPS[other].fullmatch(whole):
        return None
    plain = whole.replace(other, "") + "." * bool(sign) + behind
    return plain if NUMBER.fullmatch(plain) else None


def sign_of_line(text: str, end: str, decimal: str) -> str | None:
    """Return the thousands separator of all cells of a line, '' without one; None if a cell needs a closer look.

    Every cell is then a number, empty, or NaN. The line is matched as one text, in a tenth of the cells' time.

    `text`: the cells with `end` between them, which no cell holds
    """
    signs = [sign for sign in (",." if decimal == "." else ".,")[:1] + GROUP_SIGNS if sign in text]
    sign = signs[0] if signs else ""
    return sign if len(signs) < 2 and _line_of(decimal, sign or GROUP_SIGNS[0], end).fullmatch(text) else None


@cache
def _line_of(decimal: str, sign: str, end: str) -> re.Pattern[str]:
    """Return the pattern of a line's cells, between which `end` stands, with these separators."""
    point, group = re.escape(decimal), re.escape(sign)
    number = rf"(?:\d{{4,}}+|[1-9]\d{{0,2}}+(?:{group}\d{{3}})*+|\d{{1,3}}+)(?:{point}\d*+)?+|{point}\d++"
    with_power = rf"(?:\d++(?:{point}\d*+)?+|{point}\d++)[eE][+-]?+\d++"  # without thousands separators, as 1.5e+03
    cell = rf"(?>[+-]?+(?:(?:{number})(?![eE])|{with_power})|(?i:nan)|)"
    return re.compile(rf"{cell}(?:{end}{cell})*+", re.ASCII)


def with_points(cells: list[str], decimal: str) -> list[str] | None:
    """Return the cells of a line as `with_point` does, None if one of them needs a closer look."""
    text = CELL_END.join(cells)
    sign = sign_of_line(text, CELL_END, decimal)
    if sign is None:
        return None
    return (text.replace(sign, "") if sign else text).replace(decimal, ".").split(CELL_END)


def may_be_grouped(cells: Iterable[str]) -> bool:
    """Return whether a cell has both a decimal and a thousands separator, such as 1.234,5."""
    signed = (cell for cell in cells if "." in cell and "," in cell)
    return any(with_point(cell, sign) not in (None, cell) for cell in signed for sign in DECIMALS.values())


def are_grouped(cells: Iterable[str]) -> bool:
    """Return whether a space or an apostrophe separates the thousands in any of the cells."""
    return any(GROUPED.fullmatch(cell.strip()) for cell in cells)


def is_number(cell: str) -> bool:
    """Return whether a cell is a number, with a decimal point or comma."""
    return NUMBER.fullmatch(cell.strip().replace(",", ".")) is not None


def is_seen(cell: str) -> bool:
    """Return whether a cell is a number other than 0, which may stand for a missing value."""
    return is_number(cell) and float(cell.strip().replace(",", ".")) != 0


def magnitude_of(cell: str) -> int:
    """Return the power of ten of the first digit of a number that is not 0."""
    return int(np.floor(np.log10(abs(number_of(cell)))))


def form_of(cell: str) -> Form:
    """Return the format of the number in a cell."""
    number, _, power = cell.strip().lower().replace(",", ".").partition("e")
    return Form(len(number.partition(".")[2]), len(power))

"""The cells of text files of marker paths: a number as programs write it, or a word for a place that was not seen."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.IGNORECASE | re.ASCII)  # `float` takes 1_0 as well
WITH_SIGNS = re.compile(r"[+-]?[\d.,]*[.,][\d.,]*(e[+-]?\d+)?", re.IGNORECASE | re.ASCII)
DECIMALS = {"comma": ",", "point": "."}  # by the words in which somebody states the sign that parts decimals
# A space of any width or an apostrophe between thousands, as in 1 500,25 and 1'500.25.
GROUPED = re.compile(r"[+-]?\d{1,3}([ \u00a0\u2009\u202f'\u2019]\d{3})+([.,]\d*)?", re.ASCII)
LONGEST_SHOWN = 40  # characters of a cell in a message
# Of programs, spreadsheets (#N/A), R (NA), and the newer C library of Windows.
GAP_WORDS = {"", "-", "--", "nan", "null", "none", "n/a", "na", "#n/a", "#n/v", "nan(ind)", "nan(snan)"}
# The older one pads `1.#QNAN` with zeros, or rounds its letters: to two places 1.#R, to three 1.#QO.
# It rounds `-1.#IND`, its sign of 0/0, to -1.$, -1.#J and -1.#IO, and infinity to the same letters.
# `IND` always has a minus: without one, they are infinite, and no gap.
OLD_WINDOWS_GAP = re.compile(r"([+-]?1\.#((ind|[qs]?nan)0*|[qs]nb|[qs]o|[rt])|-1\.(\$|#j|#io))(e\+0+)?")


@dataclass(frozen=True)
class Form:
    """How a number is written: digits behind its point, and letters behind its `e`."""

    digits: int
    power: int


def number_of(cell: str) -> float:
    """Return the number of a cell, NaN where it says that nothing was seen.

    Raises:
        ValueError: it holds anything else; says so.
    """
    word = cell.strip().lower()
    plain = word.replace(",", ".")
    # No place is infinite, as 1e999 is: to read it as a gap would hide a fault.
    if NUMBER.fullmatch(plain) and np.isfinite(number := float(plain)):
        return number
    if word in GAP_WORDS or word.lstrip("+-") in GAP_WORDS or OLD_WINDOWS_GAP.fullmatch(plain):
        return np.nan
    raise ValueError(f"{cell.strip()[:LONGEST_SHOWN]!r}, which is no number")


def with_point(cell: str, decimal: str) -> str | None:
    """Return a number with a decimal point and no other sign, other text as it is, and None for another number.

    decimal: the sign that parts decimals; the other one of comma and point parts thousands
    """
    word = cell.strip()
    if not WITH_SIGNS.fullmatch(word):
        return cell
    other = "," if decimal == "." else "."
    whole, sign, behind = word.partition(decimal)
    if other in whole and not re.fullmatch(rf"[+-]?[1-9]\d{{0,2}}(\{other}\d{{3}})+", whole, re.ASCII):
        return None
    plain = whole.replace(other, "") + "." * bool(sign) + behind
    return plain if NUMBER.fullmatch(plain) else None


def may_be_grouped(cells: Iterable[str]) -> bool:
    """Return whether one of some cells is a number with both signs, of which one parts thousands, as 1.234,5 is."""
    signed = (cell for cell in cells if "." in cell and "," in cell)
    return any(with_point(cell, sign) not in (None, cell) for cell in signed for sign in DECIMALS.values())


def are_grouped(cells: Iterable[str]) -> bool:
    """Return whether a space or an apostrophe parts the thousands of one of some cells."""
    return any(GROUPED.fullmatch(cell.strip()) for cell in cells)


def is_number(cell: str) -> bool:
    """Return whether a cell is a number, which a decimal comma may part."""
    return NUMBER.fullmatch(cell.strip().replace(",", ".")) is not None


def is_seen(cell: str) -> bool:
    """Return whether a cell is a number that stands for a place: 0 stands for a marker that was not seen."""
    return is_number(cell) and float(cell.strip().replace(",", ".")) != 0


def magnitude_of(cell: str) -> int:
    """Return the power of ten of the first digit of a number that is not 0."""
    return int(np.floor(np.log10(abs(number_of(cell)))))


def form_of(cell: str) -> Form:
    """Return how the number of a cell is written."""
    number, _, power = cell.strip().lower().replace(",", ".").partition("e")
    return Form(len(number.partition(".")[2]), len(power))

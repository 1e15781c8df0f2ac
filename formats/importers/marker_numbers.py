"""The numbers of text files of marker paths: cells of lines become times and places, some lines at a time."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from formats.arrays import Floats
from formats.errors import TakeError
from formats.importers.marker_lines import Rows
from formats.importers.marker_tracks import as_seen

NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.IGNORECASE | re.ASCII)  # `float` takes 1_0 as well
WHOLE = re.compile(r"\s*[+-]?\d*\s*", re.ASCII)
PLAIN = b"0123456789+-.eE "  # `float` makes of these letters what `NUMBER` knows, or refuses them
MOST_NUMBERS = 1 << 25  # of a file: 19 minutes of 81 markers at 120 frames a second
LINES_AT_ONCE = 64  # of which the numbers are turned into places at once
# Lines before and after one in which digits are counted: numbers without their last zeros differ in one of ten places.
LINES_AROUND = 32
SURELY_CUT = 3  # digits that are lacking
LONGEST_SHOWN = 40  # characters of a cell in a message
# Of programs, spreadsheets (#N/A), R (NA), and the C libraries of Windows (-nan(ind), 1.#QNAN).
GAP_WORDS = {
    "", "-", "--", "nan", "null", "none", "n/a", "na", "#n/a", "#n/v", "nan(ind)", "1.#ind", "1.#qnan", "1.#nan",
}  # fmt: skip


def read_frames(
    rows: Rows, width: int, markers: Sequence[int], metres: float, path: Path, *, is_exact: bool = False
) -> tuple[Floats, Floats]:
    """Return the first two numbers of each line, (rows, 2), and places [m], (rows, markers, 3), NaN where not seen.

    - `width`: cells of a line
    - `markers`: the column of each marker's x, before its y and z
    - `metres`: of the unit of places
    - `is_exact`: whether a line must have as many cells as the header has. Without it, ends of lines may be left out,
      but not of a last line that has no end itself

    Raises:
        TakeError: a line holds something else, or there are too many.
    """
    if len(rows) * width > MOST_NUMBERS:
        raise TakeError(
            f"holds {len(rows)} frames of {width} numbers", where=path, advice="export fewer markers or frames"
        )
    columns = np.add.outer(np.asarray(markers, int), np.arange(3))
    first, places = np.empty((len(rows), 2)), np.empty((len(rows), len(markers), 3))
    numbers, decimals = np.empty((LINES_AT_ONCE, max(width, 2))), _Decimals()
    for begin in range(0, len(rows), LINES_AT_ONCE):
        some = rows[begin : begin + LINES_AT_ONCE]
        for k, row in enumerate(some):
            _refuse_a_wrong_line(rows, begin + k, row, width, path, is_exact=is_exact)
            cells = row if len(row) == width else [*row[:width], *[""] * (width - len(row))]
            try:
                numbers[k, :width] = _row(cells, decimals)
            except ValueError as error:
                raise TakeError(f"line {some.numbers[k]} holds {error}", where=path, advice="mend that line") from error
        piece = slice(begin, begin + len(some))
        first[piece] = numbers[: len(some), :2]
        places[piece] = as_seen(numbers[: len(some), columns] * metres)
        lacks_z = np.isnan(numbers[len(some) - 1, width - 3 : width]).tolist() == [False, False, True]
        if some.is_cut and lacks_z and width - 1 in columns[:, 2]:
            raise TakeError(
                f"ends within line {some.numbers[-1]}, before its last number", where=path,
                advice="it is cut off: copy or export it again",
            )  # fmt: skip
    return first, places


def _refuse_a_wrong_line(rows: Rows, at: int, row: list[str], width: int, path: Path, *, is_exact: bool) -> None:
    """Refuse a line with other cells than its header promises."""
    is_last = rows.is_cut and at == len(rows) - 1
    if len(row) == width and not is_last:
        return
    number = rows.numbers[at]
    if len(row) == width:
        _refuse_a_cut_number(rows, at, row, width, path)
        return
    if is_last and len(row) < width:
        raise TakeError(
            f"ends within line {number}, after {len(row)} of its {width} cells", where=path,
            advice="it is cut off: copy or export it again",
        )  # fmt: skip
    if len(row) < width and any(rows.separator in cell for cell in row):
        raise TakeError(
            f"line {number} has {len(row)} cells, not {width}: quotation marks join some of them", where=path,
            advice="take the quotation marks out of that line",
        )  # fmt: skip
    is_longer = any(cell.strip() for cell in row[width:])
    may_be_parted = len(row) > width and rows.separator == "," and all(map(WHOLE.fullmatch, row))
    if may_be_parted and (is_longer or not _has_points_beside(rows, at, len(row))):
        raise TakeError(
            f"line {number} has {len(row)} cells, not {width}, none with a decimal point", where=path,
            advice="where commas part decimals too, export with decimal points, or with semicolons between cells",
        )  # fmt: skip
    if is_exact:
        raise TakeError(f"line {number} has {len(row)} columns, not {width}", where=path, advice="mend that line")
    if len(row) < width:
        _refuse_a_cut_number(rows, at, row, width, path)
    if is_longer:
        raise TakeError(
            f"line {number} has {len(row)} cells, the header names {width}", where=path,
            advice="the header lacks markers, or the line has cells too many: export it again",
        )  # fmt: skip


def _has_points_beside(rows: Rows, at: int, cells: int) -> bool:
    """Return whether lines around one have as many cells and decimal points, so that no comma parts decimals."""
    around = range(max(at - LINES_AROUND, 0), min(at + LINES_AROUND + 1, len(rows)))
    return any(len(line := rows[k]) == cells and any("." in cell for cell in line) for k in around)


def _refuse_a_cut_number(rows: Rows, at: int, row: list[str], width: int, path: Path) -> None:
    """Refuse a line that ends within a number, which would be another one."""
    if _is_cut(rows, at, row):
        raise TakeError(
            f"line {rows.numbers[at]} ends within a number, after {len(row)} of its {width} cells", where=path,
            advice="the line is cut off: copy or export the file again",
        )  # fmt: skip


def _is_cut(rows: Rows, at: int, row: list[str]) -> bool:
    """Return whether the last cell of a row lacks digits behind its point that its column has in all lines around.

    Most programs write as many digits in every place. A cell without some of them was cut, and its number is another
    one. Other programs leave out zeros at the end: of a thousand numbers, one lacks three digits or more. So a line
    that has its end must lack three. Where the digits of a column vary, the last line must lack two, or its point.
    The first two cells are a frame's number and time. Three cells of one text are a marker that was not seen.
    """
    last = row[-1].strip()
    if len(row) < 3 or len({cell.strip() for cell in row[-3:]}) == 1:
        return False
    if not (rows.is_cut and at == len(rows) - 1):  # it has its end, as most lines have
        return _is_number(last) and _lacks_digits(_parts(last)[0], _column_around(rows, at, len(row) - 1))
    around = [cell.strip() for cell in _column_around(rows, at, len(row) - 1)]
    if last == "-":
        return "-" not in around
    if last in around and not _is_seen(last):
        return False
    beside = row[2:-1] if not any(map(_is_seen, around)) else []
    numbers = [cell for cell in around + beside if _is_seen(cell)]
    if not _is_number(last) or not numbers:
        return False
    (digits, power), written = _parts(last), [_parts(cell) for cell in numbers]
    if power or all(of_other for _, of_other in written):
        return power < min(of_other for _, of_other in written)
    counts = {count for count, of_other in written if not of_other}
    lacking = min(counts) - digits
    return lacking > 0 and (lacking > 1 or digits == 0 or len(counts) == 1)


def _lacks_digits(digits: int, cells: Iterator[str]) -> bool:
    """Return whether all numbers have three digits more behind the point; the first that has not decides."""
    found = False
    for count, power in (_parts(cell) for cell in cells if _is_seen(cell)):
        if power or count - digits < SURELY_CUT:
            return False
        found = True
    return found


def _column_around(rows: Rows, at: int, column: int) -> Iterator[str]:
    """Yield the cells of a column in the lines around one, the nearest first."""
    for apart in range(1, LINES_AROUND + 1):
        for k in (at - apart, at + apart):
            if 0 <= k < len(rows) and len(line := rows[k]) > column:
                yield line[column]


def _is_number(cell: str) -> bool:
    return NUMBER.fullmatch(cell.strip().replace(",", ".")) is not None


def _is_seen(cell: str) -> bool:
    """Return whether a cell is a number that stands for a place: 0 stands for a marker that was not seen."""
    return _is_number(cell) and float(cell.strip().replace(",", ".")) != 0


def _parts(cell: str) -> tuple[int, int]:
    """Return how many digits stand behind the point of a number, and how many letters behind its `e`."""
    number, _, power = cell.strip().lower().replace(",", ".").partition("e")
    return len(number.partition(".")[2]), len(power)


@dataclass
class _Decimals:
    """The first number of a file with a decimal point, and the first one with a comma, '' without one."""

    point: str = ""
    comma: str = ""

    def look(self, cells: list[str], text: str) -> None:
        """Refuse a file in which some numbers have a point and some a comma: one of them parts thousands.

        Raises:
            ValueError: names one of each.
        """
        if "." in text and not self.point:
            self.point = _first_with(".", cells)
        if "," in text and not self.comma:
            self.comma = _first_with(",", cells)
        if self.point and self.comma:
            raise ValueError(f"{self.comma!r} beside {self.point!r}: which of them parts decimals?")


def _first_with(sign: str, cells: list[str]) -> str:
    return next((cell.strip()[:LONGEST_SHOWN] for cell in cells if sign in cell and _is_number(cell)), "")


def _row(cells: list[str], decimals: _Decimals) -> Floats:
    """Return the numbers of cells, as `number_of` does, five times as quickly where all of them are plain.

    Raises:
        ValueError: as `number_of` and `_Decimals.look`.
    """
    text = "".join(cells)
    decimals.look(cells, text)
    plain = cells
    if "," in text:
        text, plain = text.replace(",", "."), [cell.replace(",", ".") for cell in cells]
    if text.isascii() and not text.encode().translate(None, PLAIN):
        with contextlib.suppress(ValueError):
            numbers = np.array([float(cell) if cell else np.nan for cell in plain])
            if not np.isinf(numbers).any():
                return numbers
    return np.array([number_of(cell) for cell in cells])


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
    if word in GAP_WORDS or word.lstrip("+-") in GAP_WORDS:
        return np.nan
    raise ValueError(f"{cell.strip()[:LONGEST_SHOWN]!r}, which is no number")

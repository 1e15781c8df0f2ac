"""Decide whether the last number of a marker file is complete, or the rest of a cut number with another value.

A number is complete where a delimiter or a line end follows. So only the last number of the file can be incomplete, and
only without a line end. In a file that keeps trailing zeros (`formats.importers.number_formats`), a number in the
common format is complete, and a shorter one is cut. Elsewhere a number with the most digits of the file is complete.
Programs with a fixed number of significant digits, such as `%g`, write more decimals of smaller numbers. A shorter
number or 0 may then be complete or cut.

An editor may have added the line end after a cut. The last number of such a line is complete unless its format shows a
cut, or its position lies off its path (`formats.importers.broken_numbers`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from enum import Enum

from formats.importers.marker_lines import Rows
from formats.importers.number_cells import form_of, is_number, is_seen, magnitude_of
from formats.importers.number_formats import Writing, written_as

LINES_AROUND = 32  # on either side of a line; they show repeated numbers and the usual number of cells
DECIMAL_SIGNS = ".,"  # a number may end in one
PLUS_OR_MINUS = "+-"  # of a plane's zeros as well


class Ending(Enum):
    """Whether the last number of a line is complete, as far as the file shows."""

    WHOLE = "whole"
    CUT = "cut"
    DOUBTFUL = "doubtful"
    OPEN = "whole, unless its place is off its path"


def ending_of(rows: Rows, last: int, width: int, writing: Writing) -> Ending:
    """Return whether the last number of the last line is complete.

    A marker without a position in any cell is a gap, whatever follows in its last cell. Three equal cells may be a
    missing-value code such as -9999, and show no cut.

    - `last`: column of the last number, a marker's z
    - `width`: number of cells of a whole line, without an empty one at its end
    """
    at = len(rows) - 1
    row = rows[at]
    cells = [cell.strip() for cell in row[last - 2 : last + 1]]
    if len(row) > last + 1 or not any(map(is_seen, cells)):
        return Ending.WHOLE
    around, cell = list(lines_around(rows, at)), cells[-1]
    lacks_end = rows.is_cut or min(map(len, around), default=0) > len(row) == width
    if not is_number(cell):
        if not is_part(cell) or not all(map(is_number, cells[:-1])):
            return Ending.WHOLE
        return Ending.CUT if lacks_end else Ending.DOUBTFUL
    in_doubt = Ending.DOUBTFUL if lacks_end else Ending.WHOLE
    if len(set(cells)) == 1:
        return in_doubt
    mine, form = form_of(cell), writing.form
    if form and written_as(rows, [last], form):
        is_short = (mine.power, mine.digits) < (form.power, form.digits)
        return (in_doubt if _is_repeated(cell, around, last) else Ending.CUT) if is_short else Ending.WHOLE
    if _is_full(cell, writing):
        return Ending.WHOLE
    is_part_of_power = 0 < mine.power < min((len(power) for power in writing.powers), default=0)
    if is_part_of_power or (cell[-1] in DECIMAL_SIGNS and not writing.has_bare_points):
        return Ending.DOUBTFUL if lacks_end else Ending.CUT
    return Ending.DOUBTFUL if lacks_end else Ending.OPEN


def _is_full(cell: str, writing: Writing) -> bool:
    """Return whether a number has as many characters as the longest of its file, so that none can be missing."""
    mine = form_of(cell)
    if mine.power or writing.powers:
        return mine.power >= max(map(len, writing.powers), default=mine.power + 1)
    return mine.digits >= max(writing.most, 1) and (not is_seen(cell) or magnitude_of(cell) >= writing.smallest)


def _is_repeated(cell: str, lines: Sequence[list[str]], column: int) -> bool:
    """Return whether a cell's text recurs in its column where the marker was seen, as in a plane of markers."""
    text = cell.lstrip(PLUS_OR_MINUS)
    return any(
        len(line) > column
        and line[column].strip().lstrip(PLUS_OR_MINUS) == text
        and any(map(is_seen, line[column - 2 : column]))
        for line in lines
    )


def is_part(cell: str) -> bool:
    """Return whether a cell may be the rest of a number that was cut before its first digit."""
    return cell.strip() in ("", "-")


def lines_around(rows: Rows, at: int) -> Iterator[list[str]]:
    """Yield the cells of neighbouring lines, the nearest first."""
    for apart in range(1, LINES_AROUND + 1):
        for k in (at - apart, at + apart):
            if 0 <= k < len(rows):
                yield rows[k]

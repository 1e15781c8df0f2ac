"""Tell the last number of a marker file that is whole from one that a cut line leaves, which is another number.

A number is whole where a separator or the end of its line follows. So only the last number of a last line is in doubt,
where the file ends without an end of that line. In a file that keeps zeros (`formats.importers.cell_forms`), a number
is whole that has the form of all, and a shorter one is cut. Elsewhere one of as many digits as any is whole, for
nothing can follow it. Programs that keep so many digits in all, as `%g` does, write more of them for smaller numbers.
A shorter number or 0 is as honest as any.

A line that has its end may have been given one after the cut, by an editor. Its last number is whole unless its form
shows the cut. Elsewhere its place may lie off its path (`formats.importers.broken_numbers`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from enum import Enum

from formats.importers.cell_forms import Writing, written_as
from formats.importers.marker_lines import Rows
from formats.importers.number_cells import form_of, is_number, is_seen, magnitude_of

LINES_AROUND = 32  # before and after one, which show what its column repeats and how many cells lines have
DECIMAL_SIGNS = ".,"  # a number may end in one
SIGNS = "+-"  # of a plane's zeros as well


class Ending(Enum):
    """The state of the last number of a line, as far as it is known."""

    WHOLE = "whole"
    CUT = "cut"
    DOUBTFUL = "doubtful"
    OPEN = "whole, unless its place is off its path"


def ending_of(rows: Rows, last: int, width: int, writing: Writing) -> Ending:
    """Return what is known of the last number of the last line.

    A marker of which no cell holds a place is a gap, however its last cell goes on. Three cells of one text may be a
    program's sign of a gap, such as -9999, and do not show a cut.

    - `last`: the column of the last number, a marker's z
    - `width`: cells of a whole line, without an empty one behind them
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
    """Return whether no more letters of a number can follow those of a cell, by the longest numbers of its file."""
    mine = form_of(cell)
    if mine.power or writing.powers:
        return mine.power >= max(map(len, writing.powers), default=mine.power + 1)
    return mine.digits >= max(writing.most, 1) and (not is_seen(cell) or magnitude_of(cell) >= writing.smallest)


def _is_repeated(cell: str, lines: Sequence[list[str]], column: int) -> bool:
    """Return whether a column holds a cell in another line where its marker was seen, as in a plane of markers."""
    text = cell.lstrip(SIGNS)
    return any(
        len(line) > column
        and line[column].strip().lstrip(SIGNS) == text
        and any(map(is_seen, line[column - 2 : column]))
        for line in lines
    )


def is_part(cell: str) -> bool:
    """Return whether a cell holds as much of a number as a cut before its first digit leaves."""
    return cell.strip() in ("", "-")


def lines_around(rows: Rows, at: int) -> Iterator[list[str]]:
    """Yield the cells of the lines around one, the nearest first."""
    for apart in range(1, LINES_AROUND + 1):
        for k in (at - apart, at + apart):
            if 0 <= k < len(rows):
                yield rows[k]

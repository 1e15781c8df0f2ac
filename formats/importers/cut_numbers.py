"""Tell the last number of a marker file that is whole from one that a cut line leaves, which is another number.

A number is whole where a separator or the end of its line follows. So only the last number of a last line is in doubt,
where the file ends without an end of that line. That number is provably whole where all numbers around have one form,
the same digits behind the point, and it has them as well. Without them it is cut. Where forms vary, as in programs
that leave out zeros, or where numbers have no point, nothing proves either.

A line that has its end may have been given one after the cut, by an editor. Its last number is whole unless its form
shows the cut. Where forms vary, its place may lie off its path (`formats.importers.broken_numbers`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from enum import Enum

from formats.importers.marker_lines import Rows
from formats.importers.number_cells import Form, form_of, is_number, is_seen, magnitude_of

# Lines before and after one in which digits are counted: numbers without their last zeros differ in one of ten places.
LINES_AROUND = 32
# Different numbers of one form, from which on it is the form of all. A program that leaves out zeros writes one number
# in ten shorter. So three are all too short by chance in one case of 1000, and 44 all whole in one of 100.
FEWEST_TO_PROVE, FEWEST_TO_REFUSE = 3, 44
DECIMAL_SIGNS = ".,"  # a number may end in one
SIGNS = "+-"  # of a plane's zeros as well
SURELY_CUT = 3  # digits that are lacking: of numbers without their last zeros one in 1000


class Ending(Enum):
    """The state of the last number of a line, as far as it is known."""

    WHOLE = "whole"
    CUT = "cut"
    DOUBTFUL = "doubtful"
    SHORT = "shorter than others, as its program may write it"


@dataclass
class _Beside:
    """The numbers of places in the lines around one, and before its last cell.

    - `texts`: as many different ones as are needed
    - `forms`, `magnitudes`: of all of them
    - `has_bare_points`: some end in a point
    - `below`: the numbers of the last cell's column where its marker was seen, without their signs
    - `fewest_cells`: of a line around, 0 without any
    """

    texts: set[str] = field(default_factory=set)
    forms: set[Form] = field(default_factory=set)
    magnitudes: set[int] = field(default_factory=set)
    has_bare_points: bool = False
    below: set[str] = field(default_factory=set)
    fewest_cells: int = 0

    def look(self, cells: Iterable[str]) -> None:
        """Take in the numbers among some cells."""
        for cell in map(str.strip, cells):
            if cell not in self.texts and is_seen(cell):
                self.forms.add(form_of(cell))
                self.magnitudes.add(magnitude_of(cell))
                self.has_bare_points |= cell[-1] in DECIMAL_SIGNS
                if len(self.texts) < FEWEST_TO_REFUSE:
                    self.texts.add(cell)


def ending_of(rows: Rows, columns: Sequence[int], last: int, width: int) -> Ending:
    """Return what is known of the last number of the last line.

    A marker of which no cell holds a place is a gap, however its last cell goes on. Three cells of one text may be a
    program's sign of a gap, such as -9999, and do not show a cut.

    - `columns`: those of all places
    - `last`: the one of the last number, a marker's z
    - `width`: cells of a whole line, without an empty one behind them
    """
    at = len(rows) - 1
    row, beside = rows[at], _Beside()
    cells = [cell.strip() for cell in row[last - 2 : last + 1]]
    if len(row) > last + 1 or not any(map(is_seen, cells)):
        return Ending.WHOLE
    for line in lines_around(rows, at):
        beside.look(line[k] for k in columns if k < len(line))
        beside.fewest_cells = min(beside.fewest_cells or len(line), len(line))
        if len(line) > last and any(map(is_seen, line[last - 2 : last + 1])):
            beside.below.add(line[last].strip().lstrip(SIGNS))
    beside.look(row[k] for k in columns if k < last)
    lacks_end, cell = rows.is_cut or beside.fewest_cells > len(row) == width, cells[-1]
    if not is_number(cell):
        if not is_part(cell) or not all(map(is_number, cells[:-1])):
            return Ending.WHOLE
        return Ending.CUT if lacks_end else Ending.DOUBTFUL
    if len(set(cells)) == 1:
        return Ending.DOUBTFUL if lacks_end else Ending.WHOLE
    if len(beside.forms) == 1 and beside.forms != {Form(0, 0)}:
        return _beside_one_form(cell, beside, lacks_end=lacks_end)
    if lacks_end:
        return Ending.DOUBTFUL
    mine = form_of(cell)
    powers = [form.power for form in beside.forms if form.power]
    has_cut_sign = (cell[-1] in DECIMAL_SIGNS and not beside.has_bare_points) or 0 < mine.power < min(powers, default=0)
    if has_cut_sign or lacks_digits(rows, at, last):
        return Ending.CUT
    is_longest = mine != Form(0, 0) and all(
        mine.digits >= form.digits and mine.power >= form.power for form in beside.forms
    )
    return Ending.WHOLE if is_longest else Ending.SHORT


def is_part(cell: str) -> bool:
    """Return whether a cell holds as much of a number as a cut before its first digit leaves."""
    return cell.strip() in ("", "-")


def _beside_one_form(cell: str, beside: _Beside, *, lacks_end: bool) -> Ending:
    """Return what is known of a number beside others of one form.

    Programs that keep so many digits in all, `%g`, write one form as well while all numbers are of one magnitude.
    """
    mine, form = form_of(cell), next(iter(beside.forms))
    is_of_one = len(beside.texts) >= FEWEST_TO_PROVE
    is_short = (mine.power, mine.digits) < (form.power, form.digits)
    if is_short and beside.below == {
        cell.lstrip(SIGNS)
    }:  # a plane's markers: their program writes the same 0 in all lines
        return Ending.DOUBTFUL if lacks_end else Ending.WHOLE
    if is_short and len(beside.texts) >= FEWEST_TO_REFUSE:
        return Ending.CUT
    if not lacks_end:
        return Ending.DOUBTFUL if is_short and is_of_one else Ending.WHOLE
    is_fixed = bool(form.power) or len(beside.magnitudes) > 1
    is_proven = is_fixed or (is_seen(cell) and magnitude_of(cell) >= min(beside.magnitudes))
    return Ending.WHOLE if mine == form and is_of_one and is_proven else Ending.DOUBTFUL


def lacks_digits(rows: Rows, at: int, column: int) -> bool:
    """Return whether a number lacks three digits or more behind its point that its column has in all lines around."""
    if not is_number(rows[at][column]):
        return False
    digits, found = form_of(rows[at][column]).digits, False
    for line in lines_around(rows, at):
        if column < len(line) and is_seen(line[column]):
            form = form_of(line[column])
            if form.power or form.digits - digits < SURELY_CUT:
                return False
            found = True
    return found


def lines_around(rows: Rows, at: int) -> Iterator[list[str]]:
    """Yield the cells of the lines around one, the nearest first."""
    for apart in range(1, LINES_AROUND + 1):
        for k in (at - apart, at + apart):
            if 0 <= k < len(rows):
                yield rows[k]

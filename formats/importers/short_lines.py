"""Distinguish a line of a marker file that was cut short from a line whose last cells were left out.

Some programs leave out the empty cells at the end of every line, some spreadsheets those of a few lines. So a short
line is read, and markers without cells count as not seen. A cut line to which an editor added a line end looks the
same. Three signs show a cut:

- The line's time is missing, or is no later than the time of the line before.
- The line is the last one, and no other line has so few cells.
- The line is the last one, and the only short line that ends behind a delimiter.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from formats.arrays import Floats, Integers
from formats.errors import TakeError
from formats.importers.broken_numbers import CLOCK_WRITING, broken_of
from formats.importers.marker_lines import Rows

FEWEST_OTHERS = 3  # lines; our choice: fewer do not show whether the program leaves out cells
OF_THE_CLOCK = 2  # cells at most before the first marker: number and time of a frame


def refuse_a_cut_time(
    rows: Rows, cells: Integers, clock: Floats, time: Floats, begin: int, width: int, path: Path
) -> None:
    """Refuse a line that ends within its time or frame number, although it has a line end.

    - `cells`: number of cells of each line, (rows,); `begin`: of cells before the first marker; `width`: of a whole
      line
    - `clock`: the first two numbers of each line, (rows, 2); `time` [s]: of each line, (rows,), NaN without one

    Raises:
        TakeError: names the line.
    """
    for at in np.flatnonzero(cells <= OF_THE_CLOCK).tolist():
        if at and np.isfinite(time[at - 1]) and not time[at] > time[at - 1]:
            raise TakeError(
                f"line {rows.numbers[at]} ends after {cells[at]} of its {width} cells, and its time is not later than "
                "that of the line before", where=path, advice="the line is cut off: copy or export the file again",
            )  # fmt: skip
    order = np.arange(len(rows), dtype=float)
    for column in range(min(begin, OF_THE_CLOCK)):
        for at in np.flatnonzero(broken_of(rows, cells == column + 1, order, clock[:, column], CLOCK_WRITING)).tolist():
            raise within_a_number(rows.numbers[at], column + 1, width, path)


def within_a_number(number: int, cells: int, width: int, path: Path) -> TakeError:
    """Return the error of a line that ends within its last number, after `cells` of `width` cells."""
    return TakeError(
        f"line {number} ends within a number, after {cells} of its {width} cells", where=path,
        advice="the line is cut off: copy or export the file again",
    )  # fmt: skip


def last_may_be_cut(rows: Rows, cells: Integers, width: int) -> bool:
    """Return whether the last line may have been cut, although it has a line end.

    cells: number of cells of each line, (rows,); `width`: of a whole line
    """
    short, last = np.flatnonzero(cells < width), len(cells) - 1
    if not rows.are_last or last < FEWEST_OTHERS or last not in short:
        return False
    if np.argmin(cells) == last:  # the first of those with so few
        return True
    return not rows[last][-1].strip() and all(rows[int(at)][-1].strip() for at in short[:-1])

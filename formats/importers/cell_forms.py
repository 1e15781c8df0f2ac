"""Find numbers within lines that have other digits than their column always has, as lost bytes leave them.

A digit that is lost behind the point moves a place too little to leap. A program that leaves out no zeros never writes
such a number. All numbers of the file together must show such a program. Some lines must show that the column is
written as all are. Few numbers of the whole column may be written otherwise, and each of them once.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Collection, Sequence

import numpy as np

from formats.arrays import Floats, Integers
from formats.importers.broken_numbers import are_rare, lines_looked_at, writing_of_all
from formats.importers.marker_lines import Rows
from formats.importers.number_cells import LONGEST_SHOWN, form_of, is_seen
from formats.plain_text import first_few

MOST_ODD = 3  # of a column, stated by us: more are the habit of whoever wrote it
MOST_PATTERNS = 32  # of lines of as many numbers of cells; lines of others are looked at cell by cell
EVERY_LINE = 8  # of those looked at tells how a column is written: 25 lines, of which cuts leave one otherwise


def take_out_odd_cells(
    rows: Rows, columns: Integers, places: Floats, labels: Sequence[str], line: Callable[[int], str]
) -> str:
    """Take out the markers of numbers with other digits than their columns have; return a sentence on them.

    - `columns`: of each marker's x, y and z, (markers, 3); `labels`: their names
    - `places` [m], (rows, markers, 3), NaN where not seen; `line`: names the line of a row
    """
    digits = writing_of_all(rows, columns.ravel().tolist()).always
    if not digits:
        return ""
    fixed = _fixed_columns(rows, columns, digits)
    usual = dict[int, re.Pattern[str]]()  # of lines of so many cells
    odd = list[tuple[int, int, str]]()
    for at, text in enumerate(rows.lines[:-1]):  # other rules tell of the last one
        cells = text.count(rows.separator) + 1
        if cells not in usual and len(usual) < MOST_PATTERNS:
            usual[cells] = _usual_line(rows.separator, cells, fixed, digits)
        if cells in usual and usual[cells].match(text):
            continue
        row = rows[at]
        for k, cell in enumerate(row):
            if k in fixed and is_seen(cell) and form_of(cell).digits != digits:
                marker = fixed[k]
                if np.isfinite(places[at, marker]).all():
                    odd.append((at, k, cell.strip()))
    of_column, of_text = Counter(k for _, k, _ in odd), Counter((k, text) for _, k, text in odd)
    odd = [one for one in odd if of_column[one[1]] <= MOST_ODD and of_text[one[1:]] == 1]
    for at, k, _ in odd:
        places[at, fixed[k]] = np.nan
    if not odd:
        return ""
    each = [f"{text[:LONGEST_SHOWN]!r} of {labels[fixed[k]].strip()[:LONGEST_SHOWN]}" for _, k, text in odd]
    if len(odd) == 1:
        return (
            f"{line(odd[0][0])}: {each[0]} has not the {digits} digits behind a point that its column has, so it "
            "counts as not seen there"
        )
    some = first_few([f"{one} in {line(at)}" for one, (at, _, _) in zip(each, odd, strict=True)], len(odd))
    return (
        f"{len(odd)} numbers have other than the {digits} digits of their columns, so their markers count as not seen "
        f"there: {some}"
    )


def _fixed_columns(rows: Rows, columns: Integers, digits: int) -> dict[int, int]:
    """Return the markers of the columns of which hardly a number has other digits, by some of the lines."""
    seen, odd = Counter[int](), Counter[int]()
    for row in list(lines_looked_at(rows))[::EVERY_LINE]:
        for k in columns.ravel().tolist():
            if k < len(row) and is_seen(row[k]):
                seen[k] += 1
                odd[k] += form_of(row[k]).digits != digits
    markers = {k: marker for marker, axes in enumerate(columns.tolist()) for k in axes}
    return {k: marker for k, marker in markers.items() if seen[k] > 1 and are_rare(odd[k], seen[k])}


def _usual_line(separator: str, cells: int, fixed: Collection[int], digits: int) -> re.Pattern[str]:
    """Return a pattern of lines of so many cells whose numbers have their digits: others are looked at by cells."""
    other, sign = re.escape(separator), "[.]" if separator == "," else "[.,]"
    number = rf"(?:[^{other}]*{sign}\d{{{digits}}}[ \"]*|[^{other}.,1-9]*)"
    return re.compile(other.join(number if k in fixed else f"[^{other}]*" for k in range(cells)) + "$")

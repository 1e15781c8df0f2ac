"""Learn how a file formats its numbers, and find numbers whose digits differ because bytes were lost.

A program either keeps trailing zeros or omits them. One that keeps them gives all numbers the same digits, and one
number in ten ends in a zero. One that omits them never ends a number in a zero, except in 12.0. So trailing zeros prove
the format of all numbers, however long a marker rests. All columns of positions are searched together.

A lost digit behind the decimal point moves a position too little for the outlier checks. A program that keeps trailing
zeros never writes such a number. A spreadsheet may round single columns. So a sample of lines must show that the column
has the file's format. Only few numbers of the column may differ, each of them once.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from formats.arrays import Floats, Integers
from formats.importers.marker_lines import Rows
from formats.importers.number_cells import CELL_END, CELL_SHOWN, Form, form_of, is_seen, magnitude_of
from formats.plain_text import first_few

LINES_LOOKED_AT, MOST_COLUMNS = 200, 300  # sample of a file, from which its number format is learnt
MOST_DIGITS = 9  # behind a point: further digits change no position and no time
FEWEST_ZEROS = 3  # different numbers; our choice: a cut line and an edited one leave one each
MOST_SHORTER = 0.02  # of different numbers; our choice: lost bytes damage fewer
MOST_ODD = 3  # of a column; our choice: more are intended by the file's author
MOST_PATTERNS = 32  # one for each number of cells in a line; other lines are checked cell by cell
EVERY_LINE = 8  # of the sample: 25 lines show a column's format, and a cut changes one of them


@dataclass(frozen=True)
class Writing:
    """The number format of a file's positions.

    - `most`: largest number of digits behind the point; `smallest`: least power of ten among numbers with so many
      digits
    - `form`: the format of all numbers where the program keeps trailing zeros, else None
    - `powers`: exponents that occur, as text such as -05
    - `has_bare_points`: some numbers end in a decimal point
    - `shorter`: count of different numbers with at most 0, 1, 2 ... digits behind the point
    """

    most: int = MOST_DIGITS
    smallest: int = 0
    form: Form | None = None
    powers: frozenset[str] = frozenset()
    has_bare_points: bool = False
    shorter: tuple[int, ...] = ()

    def share_of(self, digits: int) -> float:
        """Return the share of numbers with at most this many digits behind the point, with 1 added to both counts."""
        return (1 + self.shorter[min(digits, len(self.shorter) - 1)]) / (1 + self.shorter[-1]) if self.shorter else 1.0


def writing_of(rows: Rows, columns: Sequence[int]) -> Writing:
    """Return the number format of columns, from a sample of lines and columns."""
    some, texts = columns[:: 1 + len(columns) // MOST_COLUMNS], set[str]()
    for row in _lines_looked_at(rows):
        texts.update(cell.lower() for k in some if k < len(row) and is_seen(cell := row[k].strip()))
    if not texts:
        return Writing()
    forms = Counter(map(form_of, texts))
    usual, count = forms.most_common(1)[0]
    zeros = sum(form_of(text) == usual and usual.digits > 0 and text.partition("e")[0].endswith("0") for text in texts)
    has_wholes = usual.digits == 1 and zeros > count / 2  # as 12.0 of programs that omit other trailing zeros
    is_fixed = zeros >= FEWEST_ZEROS and not has_wholes and are_rare(len(texts) - count, len(texts))
    most = min(max(form.digits for form in forms), MOST_DIGITS)
    return Writing(
        most=most,
        smallest=min(magnitude_of(text) for text in texts if form_of(text).digits >= most),
        form=usual if is_fixed else None,
        powers=frozenset(text.partition("e")[2] for text in texts if "e" in text),
        has_bare_points=any(text[-1] in ".," for text in texts),
        shorter=tuple(np.cumsum(np.bincount([form_of(text).digits for text in texts])).tolist()),
    )


def are_rare(count: int, total: int) -> bool:
    """Return whether differing numbers are as few as lost bytes cause."""
    return count <= max(1, MOST_SHORTER * total)


def written_as(rows: Rows, columns: Collection[int], form: Form) -> set[int]:
    """Return the columns in which nearly all numbers have this format, from a sample of lines."""
    seen, odd = Counter[int](), Counter[int]()
    for row in list(_lines_looked_at(rows))[::EVERY_LINE]:
        for k in columns:
            if k < len(row) and is_seen(row[k]):
                seen[k] += 1
                odd[k] += form_of(row[k]) != form
    return {k for k in columns if seen[k] > 1 and are_rare(odd[k], seen[k])}


def remove_odd_numbers(
    rows: Rows, columns: Integers, positions: Floats, labels: Sequence[str], line: Callable[[int], str],
    form: Form | None,
) -> str:  # fmt: skip
    """Mark as not seen the markers whose number has another format than its column; return a warning of them.

    - `columns`: of each marker's x, y and z, (markers, 3); `labels`: the markers' names
    - `positions` [m], (rows, markers, 3), NaN where not seen; `line`: returns the name of a row's line in the file
    - `form`: the format of all numbers where the program keeps trailing zeros, else None
    """
    if form is None:
        return ""
    markers = {k: marker for marker, axes in enumerate(columns.tolist()) for k in axes}
    fixed = written_as(rows, markers, form)
    usual = dict[int, re.Pattern[str]]()  # by the number of cells in a line
    not_usual = re.compile(f"{_usual_number(CELL_END, '[.,]', form)}{CELL_END}|(.*){CELL_END}")
    odd = list[tuple[int, int, str]]()
    for at, text in enumerate(rows.lines[:-1]):  # other checks handle the last line
        cells = text.count(rows.separator) + 1
        if cells not in usual and len(usual) < MOST_PATTERNS:
            usual[cells] = _usual_line(rows.separator, cells, fixed, form)
        if cells in usual and usual[cells].match(text):
            continue
        for k, cell in enumerate(not_usual.findall(CELL_END.join([*rows[at], ""]))):  # '' for each usual cell
            if not cell or k not in fixed or not is_seen(cell) or form_of(cell) == form:
                continue
            if np.isfinite(positions[at, markers[k]]).all():
                odd.append((at, k, cell.strip()))
    of_column, of_text = Counter(k for _, k, _ in odd), Counter((k, text) for _, k, text in odd)
    odd = [one for one in odd if of_column[one[1]] <= MOST_ODD and of_text[one[1:]] == 1]
    for at, k, _ in odd:
        positions[at, markers[k]] = np.nan
    if not odd:
        return ""
    each = [f"{text[:CELL_SHOWN]!r} of {labels[markers[k]].strip()[:CELL_SHOWN]}" for _, k, text in odd]
    if len(odd) == 1:
        what = f"{form.digits} digits behind a point" + " and the power" * bool(form.power)
        return f"{line(odd[0][0])}: {each[0]} lacks the {what} of its column, so it counts as not seen there"
    some = first_few([f"{one} in {line(at)}" for one, (at, _, _) in zip(each, odd, strict=True)], len(odd))
    return (
        f"{len(odd)} numbers have other than the {form.digits} digits of their columns, so their markers count as not "
        f"seen there: {some}"
    )


def _lines_looked_at(rows: Rows) -> Iterator[list[str]]:
    """Yield the cells of a sample of lines, without the last line, which may be cut."""
    for at in np.unique(np.linspace(0, len(rows) - 2, LINES_LOOKED_AT, dtype=int)).tolist() if len(rows) > 1 else []:
        yield rows[at]


def _usual_line(separator: str, cells: int, fixed: Collection[int], form: Form) -> re.Pattern[str]:
    """Return a pattern for lines with this many cells and this format; other lines are checked cell by cell."""
    other = re.escape(separator)
    number = _usual_number(separator, "[.]" if separator == "," else "[.,]", form)
    return re.compile(other.join(number if k in fixed else f"[^{other}]*" for k in range(cells)) + "$")


def _usual_number(separator: str, sign: str, form: Form) -> str:
    """Return a pattern for a cell whose number has this format, or that shows no number other than 0.

    `sign`: pattern for the decimal separator
    """
    other = re.escape(separator)
    power = rf"[eE][+-]\d{{{form.power - 1}}}" if form.power else ""
    return rf"(?:[^{other}]*{sign}\d{{{form.digits}}}{power}[ \"]*|[^{other}.,1-9]*)"

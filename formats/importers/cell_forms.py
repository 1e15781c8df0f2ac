"""Learn how a file writes its numbers, and find those that lost bytes left with other digits than all others.

A program either keeps the zeros at the end of its numbers or leaves them out. One that keeps them writes all numbers of
one form, and ends one in ten in a zero. One that leaves them out never does, but for the one of 12.0. So zeros prove
the form that all numbers of the file have, however long a marker rests and whatever chance does. They are looked for in
all columns of places together.

A digit that is lost behind the point moves a place too little to leap. A program that keeps zeros never writes such a
number. Some lines must show that its column is written as all are, for a spreadsheet may round columns on their own.
Few numbers of the whole column may be written otherwise, and each of them once.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from formats.arrays import Floats, Integers
from formats.importers.marker_lines import Rows
from formats.importers.number_cells import LONGEST_SHOWN, Form, form_of, is_seen, magnitude_of
from formats.plain_text import first_few

LINES_LOOKED_AT, MOST_COLUMNS = 200, 300  # of a file, to learn how it writes numbers
MOST_DIGITS = 9  # behind a point: those after them matter to no place and no time
FEWEST_ZEROS = 3  # different numbers, stated by us: a cut line and an edited one leave one each
MOST_SHORTER = 0.02  # of different numbers, stated by us: lost bytes hit fewer
MOST_ODD = 3  # of a column, stated by us: more are the habit of whoever wrote it
MOST_PATTERNS = 32  # of lines of as many numbers of cells; lines of others are looked at cell by cell
EVERY_LINE = 8  # of those looked at tells how a column is written: 25 lines, of which cuts leave one otherwise


@dataclass(frozen=True)
class Writing:
    """How a file writes the numbers of places.

    - `most`: digits behind the point at most, and `smallest`: the least power of ten of numbers that have them
    - `form`: of all numbers, where the program keeps zeros, else None
    - `powers`: behind an `e`, as -05
    - `has_bare_points`: some numbers end in a point
    - `shorter`: different numbers with at most 0, 1, 2 ... digits behind the point
    """

    most: int = MOST_DIGITS
    smallest: int = 0
    form: Form | None = None
    powers: frozenset[str] = frozenset()
    has_bare_points: bool = False
    shorter: tuple[int, ...] = ()

    def share_of(self, digits: int) -> float:
        """Return the share of numbers that have so many digits behind the point or fewer, and one more."""
        return (1 + self.shorter[min(digits, len(self.shorter) - 1)]) / (1 + self.shorter[-1]) if self.shorter else 1.0


def writing_of(rows: Rows, columns: Sequence[int]) -> Writing:
    """Return how the numbers of columns are written, by some of the lines and of the columns."""
    some, texts = columns[:: 1 + len(columns) // MOST_COLUMNS], set[str]()
    for row in _lines_looked_at(rows):
        texts.update(cell.lower() for k in some if k < len(row) and is_seen(cell := row[k].strip()))
    if not texts:
        return Writing()
    forms = Counter(map(form_of, texts))
    usual, count = forms.most_common(1)[0]
    zeros = sum(form_of(text) == usual and usual.digits > 0 and text.partition("e")[0].endswith("0") for text in texts)
    has_wholes = usual.digits == 1 and zeros > count / 2  # as programs write 12.0 that leave out other zeros
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
    """Return whether so few of some numbers are written otherwise as lost bytes make them."""
    return count <= max(1, MOST_SHORTER * total)


def written_as(rows: Rows, columns: Collection[int], form: Form) -> set[int]:
    """Return the columns of which hardly a number has another form, by some of the lines."""
    seen, odd = Counter[int](), Counter[int]()
    for row in list(_lines_looked_at(rows))[::EVERY_LINE]:
        for k in columns:
            if k < len(row) and is_seen(row[k]):
                seen[k] += 1
                odd[k] += form_of(row[k]) != form
    return {k for k in columns if seen[k] > 1 and are_rare(odd[k], seen[k])}


def take_out_odd_cells(
    rows: Rows, columns: Integers, places: Floats, labels: Sequence[str], line: Callable[[int], str], form: Form | None
) -> str:
    """Take out the markers of numbers of another form than their columns have; return a sentence on them.

    - `columns`: of each marker's x, y and z, (markers, 3); `labels`: their names
    - `places` [m], (rows, markers, 3), NaN where not seen; `line`: names the line of a row
    - `form`: of all numbers, where the program keeps zeros, else None
    """
    if form is None:
        return ""
    markers = {k: marker for marker, axes in enumerate(columns.tolist()) for k in axes}
    fixed = written_as(rows, markers, form)
    usual = dict[int, re.Pattern[str]]()  # of lines of so many cells
    odd = list[tuple[int, int, str]]()
    for at, text in enumerate(rows.lines[:-1]):  # other rules tell of the last one
        cells = text.count(rows.separator) + 1
        if cells not in usual and len(usual) < MOST_PATTERNS:
            usual[cells] = _usual_line(rows.separator, cells, fixed, form)
        if cells in usual and usual[cells].match(text):
            continue
        for k, cell in enumerate(rows[at]):
            if k in fixed and is_seen(cell) and form_of(cell) != form and np.isfinite(places[at, markers[k]]).all():
                odd.append((at, k, cell.strip()))
    of_column, of_text = Counter(k for _, k, _ in odd), Counter((k, text) for _, k, text in odd)
    odd = [one for one in odd if of_column[one[1]] <= MOST_ODD and of_text[one[1:]] == 1]
    for at, k, _ in odd:
        places[at, markers[k]] = np.nan
    if not odd:
        return ""
    each = [f"{text[:LONGEST_SHOWN]!r} of {labels[markers[k]].strip()[:LONGEST_SHOWN]}" for _, k, text in odd]
    if len(odd) == 1:
        what = f"{form.digits} digits behind a point" + " and the power" * bool(form.power)
        return f"{line(odd[0][0])}: {each[0]} has not the {what} that its column has, so it counts as not seen there"
    some = first_few([f"{one} in {line(at)}" for one, (at, _, _) in zip(each, odd, strict=True)], len(odd))
    return (
        f"{len(odd)} numbers have other than the {form.digits} digits of their columns, so their markers count as not "
        f"seen there: {some}"
    )


def _lines_looked_at(rows: Rows) -> Iterator[list[str]]:
    """Yield the cells of some lines, which show how a file writes numbers; the last one may be cut."""
    for at in np.unique(np.linspace(0, len(rows) - 2, LINES_LOOKED_AT, dtype=int)).tolist() if len(rows) > 1 else []:
        yield rows[at]


def _usual_line(separator: str, cells: int, fixed: Collection[int], form: Form) -> re.Pattern[str]:
    """Return a pattern of lines of so many cells whose numbers have their form: others are looked at by cells."""
    other, sign = re.escape(separator), "[.]" if separator == "," else "[.,]"
    power = rf"[eE][+-]\d{{{form.power - 1}}}" if form.power else ""
    number = rf"(?:[^{other}]*{sign}\d{{{form.digits}}}{power}[ \"]*|[^{other}.,1-9]*)"
    return re.compile(other.join(number if k in fixed else f"[^{other}]*" for k in range(cells)) + "$")

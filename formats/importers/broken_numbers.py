"""Find the lines that end within a number though more lines follow, by the path on which that number should lie.

A line that was cut, and was given an end by an editor, may end within the z of a marker. The number that is left begins
as the whole one does, and is another one: of 1205.34 it may be 1205.3, 12 or 1. Three straight lines tell where the
whole one lies: between the places before and after, through the two before, and through the two after. Two things show
a broken number. All three lines miss it by more than b. Another number that begins with its letters is within b of one:

    b  =  NOISES q c  +  10^-d        c = h1 h2 / h^2 between two,  h1 (h1 + h2) / h^2 ahead of two

- `q`: half of the places of the path are no farther than that from the straight line between their neighbours
- `h1`, `h2`: the steps of time; `h`: the median step
- `d`: digits behind the point

In a file that leaves out no zeros, a number with fewer digits than others is broken however near it lies.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from formats.arrays import Booleans, Floats, Integers
from formats.importers.marker_lines import Rows
from formats.importers.number_cells import form_of, is_seen

NOISES = 7.0  # of normal noise, q is 0.67 standard deviations: one place of 400,000 is farther off
LINES_LOOKED_AT = 200  # of a file, to learn how it writes numbers
# Of programs that leave out zeros, one number of ten has fewer digits. So of 100 at most 2 have in one file of 500.
FEWEST_NUMBERS, MOST_SHORTER = 100, 0.02
MOST_DIGITS = 9  # behind a point: those after them matter to no place and no time
MOST_LETTERS = 6  # that a cut takes before a point: no place is 1000 km away


@dataclass(frozen=True)
class Writing:
    """How a file writes its numbers.

    - `most`: digits behind the point at most
    - `always`: digits that all numbers have, 0 where they vary
    - `has_powers`: some are written as 1.5e-05
    """

    most: int
    always: int = 0
    has_powers: bool = False


CLOCK = Writing(MOST_DIGITS)  # a time may go on with any digits


def writing_of(rows: Rows, columns: Iterable[int]) -> Writing:
    """Return how the numbers of some columns are written, by some of the lines."""
    texts = set[str]()
    for at in range(0, len(rows), 1 + len(rows) // LINES_LOOKED_AT):
        row = rows[at]
        texts.update(cell for k in columns if k < len(row) and is_seen(cell := row[k].strip()))
    forms = Counter(map(form_of, texts))
    if not forms:
        return CLOCK
    most = min(max(form.digits for form in forms), MOST_DIGITS)
    has_powers = any(form.power for form in forms)
    shorter = sum(count for form, count in forms.items() if form.digits < most)
    is_fixed = not has_powers and len(texts) >= FEWEST_NUMBERS and shorter <= MOST_SHORTER * len(texts)
    return Writing(most, most if is_fixed else 0, has_powers)


def broken_lines(
    rows: Rows, cells: Integers, columns: Integers, time: Floats, places: Floats, metres: float
) -> Booleans:
    """Return which lines end within the z of a marker, (rows,).

    - `cells`: of each line, (rows,); `columns`: of each marker's x, y and z, (markers, 3)
    - `time` [s], (rows,); `places` [m], (rows, markers, 3), NaN where not seen; `metres`: of the unit that they had
    """
    found = np.zeros(len(rows), bool)
    writing = writing_of(rows, columns[:, 2].tolist())
    for marker in np.flatnonzero(np.isin(columns[:, 2] + 1, cells)).tolist():
        ends_here = cells == columns[marker, 2] + 1
        found |= broken_of(rows, ends_here, time, places[:, marker, 2] / metres, writing)
    return found


def broken_of(rows: Rows, ends_here: Booleans, time: Floats, path: Floats, writing: Writing) -> Booleans:
    """Return which lines end within their number of a path, (rows,).

    - `ends_here`: which lines have that number last, (rows,)
    - `time` [s], (rows,); `path`: of any unit, (rows,), NaN where not seen
    """
    found = np.zeros(len(rows), bool)
    seen = np.flatnonzero(np.isfinite(path) & np.isfinite(time))
    if not ends_here[seen].any() or len(seen) < 3 or not (np.diff(time[seen]) > 0).all():
        return found
    should, bounds = _should_be(time[seen], path[seen])
    bounds += 10.0**-writing.most
    is_off = np.asarray(~(np.abs(path[seen] - should) <= bounds).any(0))
    for k in np.flatnonzero(ends_here[seen]).tolist():
        at = int(seen[k])
        if not is_off[k] and not writing.always:
            continue
        cell = rows.last_cell(at)
        if (is_off[k] or form_of(cell).digits < writing.always) and any(
            _may_begin(cell, place - bound, place + bound, writing)
            for place, bound in zip(should[:, k], bounds[:, k], strict=True)
        ):
            found[at] = True
    return found


def _should_be(time: Floats, path: Floats) -> tuple[Floats, Floats]:
    """Return where three straight lines lead, (3, n), NaN without one, and how far off noise may be, (3, n)."""
    should, reach = np.full((3, len(time)), np.nan), np.ones((3, len(time)))
    step = np.diff(time)
    slope = np.diff(path) / step
    before, after = step[:-1], step[1:]
    should[0, 1:-1] = path[:-2] + (path[2:] - path[:-2]) * before / (before + after)
    reach[0, 1:-1] = before * after
    should[1, 2:] = path[1:-1] + slope[:-1] * after
    reach[1, 2:] = after * (before + after)
    should[2, :-2] = path[1:-1] - slope[1:] * before
    reach[2, :-2] = before * (before + after)
    noise = float(np.median(np.abs(path - should[0])[1:-1]))
    return should, NOISES * noise * np.maximum(1.0, reach / np.median(step) ** 2)


def _may_begin(cell: str, low: float, high: float, writing: Writing) -> bool:
    """Return whether a number between two others is written with the letters of a cell, and more behind them."""
    text = cell.strip().replace(",", ".").lower()
    mantissa = text.partition("e")[0]
    digits, has_point = form_of(mantissa).digits, "." in mantissa
    sign = -1.0 if mantissa.startswith("-") else 1.0
    begin = abs(float(mantissa))
    goes_on = [(begin, begin + 10.0**-digits)] if digits < writing.most or writing.has_powers else []
    if not has_point and begin:
        goes_on += [(begin * 10.0**k, (begin + 1) * 10.0**k) for k in range(1, MOST_LETTERS)]
    powers = 10.0 ** np.arange(-9, 10) if writing.has_powers else np.ones(1)
    near, far = sorted((sign * low, sign * high))
    return any(first * power < far and near < last * power for first, last in goes_on for power in powers)

"""Find the lines that end within a number though more lines follow, by the path on which that number should lie.

A line that was cut, and was given an end by an editor, may end within the z of a marker. The number that is left begins
as the whole one does, and is another one: of 1205.34 it may be 1205.3, 12 or 1. Three straight lines tell where the
whole one lies: between the places before and after, through the two before, and through the two after. Two things show
a broken number. All three lines miss it by more than b. Another number that begins with its letters is within b of one:

    b  =  NOISES q c  +  10^-d        c = h1 h2 / h^2 between two,  h1 (h1 + h2) / h^2 ahead of two

- `q`: half of the places of a stretch are no farther than that from the straight line between their neighbours. The
  largest of a stretch and those beside it counts, as cloth that rests begins to move
- `h1`, `h2`: the steps of time; `h`: the median step
- `d`: digits behind the point of that number before or after it which has more

In a file that leaves out no zeros, a number with fewer digits than others is broken however near it lies. In one that
writes powers of ten, as in 1.2e+03, a number without its power is broken.
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
STRETCH = 50  # places: half a swing at 100 frames a second
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
    - `has_powers`, `all_powers`: some and all are written as 1.5e-05
    """

    most: int
    always: int = 0
    has_powers: bool = False
    all_powers: bool = False


CLOCK = Writing(MOST_DIGITS)  # a time may go on with any digits


def writing_of(rows: Rows, columns: Iterable[int]) -> Writing:
    """Return how the numbers of some columns are written, by some of the lines."""
    texts = Counter[str]()
    for at in np.unique(np.linspace(0, len(rows) - 1, LINES_LOOKED_AT, dtype=int)).tolist() if len(rows) else []:
        row = rows[at]
        texts.update(cell for k in columns if k < len(row) and is_seen(cell := row[k].strip()))
    forms = [(form_of(text), count) for text, count in texts.items()]
    if not forms:
        return CLOCK
    most = min(max(form.digits for form, _ in forms), MOST_DIGITS)
    powers = [bool(form.power) for form, _ in forms]
    shorter = sum(count for form, count in forms if form.digits < most)
    is_known = len(texts) >= FEWEST_NUMBERS
    is_fixed = not any(powers) and is_known and most < MOST_DIGITS and shorter <= MOST_SHORTER * texts.total()
    return Writing(most, most if is_fixed else 0, any(powers), is_known and all(powers))


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
        if not (is_off[k] or writing.always or writing.all_powers):
            continue
        at, cell = int(seen[k]), rows.last_cell(int(seen[k]))
        around = bounds[:, k]
        if not writing.always:
            column, beside = len(rows[at]) - 1, [rows[int(seen[n])] for n in (k - 1, k + 1) if 0 <= n < len(seen)]
            digits = [form_of(row[column]).digits for row in beside if column < len(row)]
            around = around + 10.0 ** -max(digits, default=writing.most)
        found[at] = _is_broken(cell, path[at], should[:, k], around, writing)
    return found


def _is_broken(cell: str, number: float, should: Floats, bounds: Floats, writing: Writing) -> bool:
    """Return whether a cell, which holds a number, begins one that should be there, within some bounds, (3,)."""
    form = form_of(cell)
    if writing.all_powers and not form.power:
        return True
    if (np.abs(number - should) <= bounds).any() and form.digits >= writing.always:
        return False
    return any(_may_begin(cell, place - off, place + off, writing) for place, off in zip(should, bounds, strict=True))


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
    off = np.abs(path - should[0])
    off[[0, -1]] = off[[1, -2]]
    stretches = np.array_split(off, -(-len(off) // STRETCH))
    halves = np.pad([np.median(stretch) for stretch in stretches], 1, mode="edge")
    noise = np.repeat(np.max([halves[:-2], halves[1:-1], halves[2:]], 0), [len(stretch) for stretch in stretches])
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

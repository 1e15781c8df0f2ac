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

Cloth gains nothing from less than the noise of cameras, so a line misses a place by that noise at least.

In a column that leaves out no zeros, a number with fewer digits than others is broken however near it lies. It is
whole where its column repeats it, as of a plane's markers. In one that writes powers of ten, as in 1.2e+03, a number
without its power is broken, and one with a whole power is whole.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from formats.arrays import Booleans, Floats, Integers
from formats.importers.marker_lines import Rows
from formats.importers.marker_tracks import MARKER_SD
from formats.importers.number_cells import form_of, is_seen, magnitude_of
from formats.importers.strays import straight_lines

NOISES = 7.0  # of normal noise, q is 0.67 standard deviations: one place of 400,000 is farther off
STRETCH = 50  # places: half a swing at 100 frames a second
LINES_LOOKED_AT, MOST_COLUMNS = 200, 300  # of a file, to learn how it writes numbers
# Of programs that leave out zeros, one number of ten has fewer digits. So of 100 at most 2 have in one file of 500.
FEWEST_NUMBERS, MOST_SHORTER = 100, 0.02
MOST_DIGITS = 9  # behind a point: those after them matter to no place and no time
MOST_LETTERS = 6  # that a cut takes before a point: no place is 1000 km away


@dataclass(frozen=True)
class Writing:
    """How a file writes the numbers of a column.

    - `most`: digits behind the point at most
    - `always`: digits that all numbers have, 0 where they vary
    - `has_powers`, `all_powers`: some and all are written as 1.5e-05
    - `power`: letters that powers have, 0 where they vary or there are none
    - `repeated`: numbers that the column holds more than once
    """

    most: int
    always: int = 0
    has_powers: bool = False
    all_powers: bool = False
    power: int = 0
    repeated: frozenset[str] = field(default=frozenset(), compare=False)


CLOCK = Writing(MOST_DIGITS)  # a time may go on with any digits


def writings_of(rows: Rows, wanted: Iterable[int], columns: Sequence[int]) -> dict[int, Writing]:
    """Return how the numbers of each wanted column are written, by some of the lines.

    A column with too few numbers is taken to be written as all are together, unless its own numbers tell otherwise.

    columns: those of all places
    """
    texts = {k: Counter[str]() for k in wanted}
    for row in lines_looked_at(rows) if texts else ():
        for k, own in texts.items():
            if k < len(row) and is_seen(cell := row[k].strip()):
                own[cell] += 1
    of_all, found = writing_of_all(rows, columns), dict[int, Writing]()
    for k, own in texts.items():
        writing = _writing(own) if len(own) >= FEWEST_NUMBERS else of_all
        shorter = sum(count for text, count in own.items() if form_of(text).digits < of_all.always)
        if of_all.always and are_rare(shorter, own.total()):
            always = of_all.always
        else:
            always = 0 if writing is of_all else writing.always
        repeated = frozenset(text for text, count in own.items() if count > 1)
        found[k] = replace(writing, always=always, repeated=repeated)
    return found


def writing_of_all(rows: Rows, columns: Sequence[int]) -> Writing:
    """Return how the numbers of columns are written, by some of the lines and of the columns."""
    some, texts = columns[:: 1 + len(columns) // MOST_COLUMNS], Counter[str]()
    for row in lines_looked_at(rows):
        texts.update(cell for k in some if k < len(row) and is_seen(cell := row[k].strip()))
    return _writing(texts)


def lines_looked_at(rows: Rows) -> Iterator[list[str]]:
    """Yield the cells of some lines, which show how a file writes numbers."""
    for at in np.unique(np.linspace(0, len(rows) - 1, LINES_LOOKED_AT, dtype=int)).tolist() if len(rows) else []:
        yield rows[at]


def _writing(texts: Counter[str]) -> Writing:
    """Return how numbers are written, of which each text came so many times.

    Programs that keep so many digits in all, as `%g` does, write as many behind the point at one magnitude alone.
    """
    forms = {text: form_of(text) for text in texts}
    if not forms:
        return CLOCK
    most = min(max(form.digits for form in forms.values()), MOST_DIGITS)
    powers = Counter(form.power for form in forms.values())
    usual_digits = Counter(form.digits for form in forms.values()).most_common(1)[0][0]
    others = [text for text, form in forms.items() if form.digits != usual_digits]
    is_known = len(texts) >= FEWEST_NUMBERS
    is_rare = len(others) <= MOST_SHORTER * len(texts) and sum(map(texts.__getitem__, others)) <= (
        MOST_SHORTER * texts.total()
    )
    is_fixed = is_known and is_rare and powers.keys() == {0} and usual_digits < MOST_DIGITS
    is_fixed = is_fixed and len({magnitude_of(text) for text in forms.keys() - set(others)}) > 1
    lengths = Counter({power: count for power, count in powers.items() if power})
    usual = next(
        (power for power, count in lengths.most_common(1) if are_rare(lengths.total() - count, lengths.total())), 0
    )
    return Writing(most, usual_digits if is_fixed else 0, bool(lengths), is_known and not powers[0], usual)


def are_rare(count: int, total: int) -> bool:
    """Return whether so few of some numbers are written otherwise as cuts make them."""
    return count <= max(1, MOST_SHORTER * total)


def broken_lines(
    rows: Rows, cells: Integers, columns: Integers, time: Floats, places: Floats, metres: float
) -> Booleans:
    """Return which lines end within the z of a marker, (rows,).

    - `cells`: of each line, (rows,); `columns`: of each marker's x, y and z, (markers, 3)
    - `time` [s], (rows,); `places` [m], (rows, markers, 3), NaN where not seen; `metres`: of the unit that they had
    """
    found = np.zeros(len(rows), bool)
    markers = np.flatnonzero(np.isin(columns[:, 2] + 1, cells))
    last = columns[markers, 2].tolist()
    writings = writings_of(rows, last, columns.ravel().tolist()) if last else {}
    for marker, column in zip(markers.tolist(), last, strict=True):
        path = places[:, marker, 2] / metres
        found |= broken_of(rows, cells == column + 1, time, path, writings[column], MARKER_SD / metres)
    return found


def broken_of(
    rows: Rows, ends_here: Booleans, time: Floats, path: Floats, writing: Writing, least: float = 0.0
) -> Booleans:
    """Return which lines end within their number of a path, (rows,).

    - `ends_here`: which lines have that number last, (rows,)
    - `time` [s], (rows,); `path`: of any unit, (rows,), NaN where not seen
    - `least`: of that unit, by which a line misses a number at least
    """
    found = np.zeros(len(rows), bool)
    seen = np.flatnonzero(np.isfinite(path) & np.isfinite(time))
    if not ends_here[seen].any() or len(seen) < 3 or not (np.diff(time[seen]) > 0).all():
        return found
    should, bounds = _should_be(time[seen], path[seen])
    bounds = np.maximum(bounds, least) + 10.0**-writing.most
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
    if writing.all_powers and form.power < max(writing.power, 1):
        return True
    if writing.power and form.power == writing.power:
        return False
    has_all = form.digits >= writing.always or not number or cell.strip() in writing.repeated
    if (np.abs(number - should) <= bounds).any() and has_all:
        return False
    return any(_may_begin(cell, place - off, place + off, writing) for place, off in zip(should, bounds, strict=True))


def _should_be(time: Floats, path: Floats) -> tuple[Floats, Floats]:
    """Return where three straight lines lead, (3, n), NaN without one, and how far off noise may be, (3, n)."""
    should, reach = straight_lines(time, path)
    off = np.abs(path - should[0])
    off[[0, -1]] = off[[1, -2]]
    stretches = np.array_split(off, -(-len(off) // STRETCH))
    halves = np.pad([np.median(stretch) for stretch in stretches], 1, mode="edge")
    noise = np.repeat(np.max([halves[:-2], halves[1:-1], halves[2:]], 0), [len(stretch) for stretch in stretches])
    return should, NOISES * noise * np.maximum(1.0, reach / np.median(np.diff(time)) ** 2)


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

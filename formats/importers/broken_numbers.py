"""Find lines that end within a number, although other lines follow, from the path on which the number should lie.

A cut line to which an editor added a line end may end within a marker's z. The rest of the number begins like the whole
number but has another value: 1205.34 may become 1205.3, 12 or 1. Three straight lines predict the whole value: between
the positions before and after, through the two before, and through the two after.

A number counts as broken under two conditions. First, some number that begins with its characters lies within u of a
prediction. Second, the number itself is farther than F u from each prediction, with F > 1 and

    DIGITS share / ((n + 1) F^TAIL)  <  chance that a line is cut there

The left side is the likelihood ratio of an undamaged number to a cut one.

- `u`: the largest deviation from the predictions around, and at least the noise of cameras and the last digit. For z,
  the POSITIONS_AROUND frames before and after count, except the nearest. For all other coordinates, two frames before
  to two after count, since a flick moves all markers. Deviations count in units of r of their lines
- `n`: the number of deviations of z. One more deviation is the largest by chance in one case of n + 1. A deviation F
  times as large is F^TAIL times rarer, because the far tail falls with that power
- `share`: the share of all numbers in the file with as few digits, which an undamaged number has by chance
- DIGITS: a cut leaves each count of characters with equal probability
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from formats.arrays import Booleans, Floats, Integers
from formats.importers.marker_lines import Rows
from formats.importers.marker_tracks import MARKER_SD
from formats.importers.number_cells import form_of
from formats.importers.number_formats import Writing
from formats.importers.path_outliers import straight_lines

# Probabilities. Our choice: high, as disks and networks verify their bytes. A file to which an editor
# added an end is commoner.
CUT_WITHIN, CUT_LAST = 1e-5, 1e-3
DIGITS = 10  # digits, from 0 to 9
TAIL = 3.0  # of Student's t with 3 degrees of freedom; that of noise and smooth motion falls faster
POSITIONS_AROUND = 50  # positions: half a swing at 100 frames a second
CONTAMINATED = 2  # positions on either side of a broken one: their lines go through it
MOST_DIGITS_CUT = 6  # digits that a cut removes before a point: no position is 1000 km away
PROOFS = 4  # positions; our choice: noise hardly keeps five in a row on a path that it does not follow
NEAR_PATH = 2e-3  # m; our choice: so near its path a position is accurate enough even with digits missing

CLOCK_WRITING = Writing()  # a time may continue with any digits


def broken_lines(
    rows: Rows, cells: Integers, columns: Integers, time: Floats, positions: Floats, metres: float, writing: Writing
) -> Booleans:
    """Return which lines end within a marker's z, (rows,).

    - `cells`: number of cells of each line, (rows,); `columns`: of each marker's x, y and z, (markers, 3)
    - `time` [s], (rows,); `positions` [m], (rows, markers, 3), NaN where not seen; `metres`: of their unit in the file
    """
    found = np.zeros(len(rows), bool)
    for marker in np.flatnonzero(np.isin(columns[:, 2] + 1, cells)).tolist():

        def others(at: int, lines: Booleans, marker: int = marker) -> float:
            around = slice(max(0, at - 2 * CONTAMINATED), at + 2 * CONTAMINATED + 1)
            if not (np.diff(time[around]) > 0).all():
                return np.inf
            beside = positions[around].copy()
            beside[:, marker, 2] = np.nan
            misses = _misses(time[around], beside.reshape(len(beside), -1))[1]
            first = max(0, at - around.start - CONTAMINATED)
            among = np.fmin.reduce(misses[lines, first : first + 2 * CONTAMINATED + 1])
            return float(np.nanmax(among, initial=0.0)) / metres

        path, ends_here = positions[:, marker, 2] / metres, cells == columns[marker, 2] + 1
        found |= broken_of(rows, ends_here, time, path, writing, MARKER_SD / metres, others)
    return found


def broken_of(
    rows: Rows, ends_here: Booleans, time: Floats, path: Floats, writing: Writing, noise: float = 0.0,
    others: Callable[[int, Booleans], float] = lambda _, __: 0.0,
) -> Booleans:  # fmt: skip
    """Return which lines end within the number of one path, (rows,).

    - `ends_here`: which lines have that number as their last, (rows,)
    - `time` [s], (rows,); `path`: the numbers, of any unit, (rows,), NaN where not seen
    - `noise`: in that unit; `others`: returns the largest deviation of other paths around a row, for the same lines
    """
    found, least = np.zeros(len(rows), bool), noise + 10.0**-writing.most
    seen = np.flatnonzero(np.isfinite(path) & np.isfinite(time))
    if not ends_here[seen].any() or len(seen) < 3 or not (np.diff(time[seen]) > 0).all():
        return found
    lead, misses, wide = _misses(time[seen], path[seen])
    off = np.fmin.reduce(misses)
    is_far = off > np.maximum(least, _largest_around(off))
    for k in np.flatnonzero(ends_here[seen] & is_far).tolist():
        lines = np.isfinite(lead[:, k])
        around = np.fmin.reduce(misses[lines, max(0, k - POSITIONS_AROUND) : k + POSITIONS_AROUND + 1])
        apart = np.abs(np.arange(len(around)) - min(k, POSITIONS_AROUND))
        own = around[np.isfinite(around) & (apart > (0 if lines.sum() == 1 else CONTAMINATED))]
        at, chance = int(seen[k]), CUT_LAST if seen[k] == len(rows) - 1 else CUT_WITHIN
        cell = rows.last_cell(at)
        odds = DIGITS * writing.share_of(form_of(cell).digits) / ((len(own) + 1) * chance)
        farther, usual = max(1.0, odds ** (1 / TAIL)), max(least, float(own.max(initial=0.0)))
        if off[k] <= farther * usual or off[k] <= farther * (usual := max(usual, others(at, lines))):
            continue
        bounds = usual * wide[lines, k]
        should = lead[lines, k]
        found[at] = any(
            _may_begin(cell, low, high, writing) for low, high in zip(should - bounds, should + bounds, strict=True)
        )
    return found


def is_near(time: Floats, path: Floats) -> bool:
    """Return whether a path [m], (rows,), ends within NEAR_PATH of a linear or parabolic extrapolation.

    The last position may be broken. The PROOFS positions before it must lie as near to theirs. `time` [s], (rows,)
    """
    return any(
        len(path) >= PROOFS + degree + 2
        and all(_is_led(time[: len(path) - k], path[: len(path) - k], degree) for k in range(PROOFS + 1))
        for degree in (1, 2)
    )


def _is_led(time: Floats, path: Floats, degree: int) -> bool:
    """Return whether the last position lies within NEAR_PATH of the polynomial through the positions before."""
    before = slice(-degree - 2, -1)
    if not np.isfinite(path[before]).all() or not (np.diff(time[before]) > 0).all():
        return False
    return bool(abs(path[-1] - np.polyfit(time[before] - time[-1], path[before], degree)[-1]) <= NEAR_PATH)


def _misses(time: Floats, path: Floats) -> tuple[Floats, Floats, Floats]:
    """Return predictions of three straight lines, deviations of the path from them, and relative r, each (3, n, ...).

    Entries are NaN without a line. The relative r is r over the square of the median interval, and at least 1.
    Deviations are divided by the relative r.

    `time` [s], (n,), increasing; `path`, (n, ...), of any unit
    """
    lead, reach = straight_lines(time, path)
    wide = np.maximum(1.0, reach / np.median(np.diff(time)) ** 2).reshape(3, -1, *[1] * (path.ndim - 1))
    return lead, np.abs(path - lead) / wide, wide


def _largest_around(off: Floats) -> Floats:
    """Return the largest of the numbers around each one, without its nearest neighbours."""
    beside = POSITIONS_AROUND - CONTAMINATED
    largest = sliding_window_view(np.pad(off, POSITIONS_AROUND), beside).max(1)
    return np.asarray(np.maximum(largest[: len(off)], largest[POSITIONS_AROUND + CONTAMINATED + 1 :][: len(off)]))


def _may_begin(cell: str, low: float, high: float, writing: Writing) -> bool:
    """Return whether some number between two others begins with the characters of a cell and continues."""
    mantissa, sign, power = cell.strip().replace(",", ".").lower().partition("e")
    digits, has_point = form_of(mantissa).digits, "." in mantissa
    begin = abs(float(mantissa))
    first, last = begin, begin + 10.0**-digits
    goes_on = list[tuple[float, float]]()
    if not sign:
        goes_on += [(first, last)] if digits < writing.most else []
        goes_on += (
            [(first * 10.0**k, (first + 1) * 10.0**k) for k in range(1, MOST_DIGITS_CUT)] if not has_point else []
        )
    if sign or 1 <= begin < 10:  # as programs write numbers with a power
        tens = [10.0 ** int(whole) for whole in writing.powers if whole.startswith(power) and whole != power]
        goes_on += [(first * ten, last * ten) for ten in tens]
    near, far = sorted((-low, -high)) if mantissa.startswith("-") else (low, high)
    return any(first < far and near < last for first, last in goes_on)

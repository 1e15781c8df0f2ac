"""Find the lines that end within a number though more lines follow, by the path on which that number should lie.

A line that was cut, and was given an end by an editor, may end within the z of a marker. The number that is left begins
as the whole one does, and is another one: of 1205.34 it may be 1205.3, 12 or 1. Three straight lines tell where the
whole one lies: between the places before and after, through the two before, and through the two after.

A number is broken where another number that begins with its letters is within u of a line. It must itself be farther
than F u from each of the three, with F > 1 and

    LETTERS share / ((n + 1) F^TAIL)  <  chance that a line is cut there

The left side says how much less likely an honest number looks so than a cut one does.

- `u`: the largest miss of the lines around. It is at least the noise of cameras and the last digit. Those of z count in
  the STRETCH frames before and after, but for those beside it. Those of all other coordinates count from two frames
  before to two after, since a flick moves all markers. Misses count in the reach of their lines
- `n`: how many misses of z are looked at. One more is the largest of all by chance in one case of n + 1. It is F times
  as large in F^TAIL times fewer, as the far tail of misses falls with that power
- `share`: of the file's numbers, in all columns, that have as few digits. An honest number has them by chance
- LETTERS: a cut leaves each number of letters as likely
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from formats.arrays import Booleans, Floats, Integers
from formats.importers.cell_forms import Writing
from formats.importers.marker_lines import Rows
from formats.importers.marker_tracks import MARKER_SD
from formats.importers.number_cells import form_of
from formats.importers.strays import straight_lines

# Stated by us, high: disks and networks check the bytes that they carry. Files that an editor ended are commoner.
CUT_WITHIN, CUT_LAST = 1e-5, 1e-3
LETTERS = 10
TAIL = 3.0  # of Student's t with 3 degrees of freedom; that of noise and smooth motion falls faster
STRETCH = 50  # places: half a swing at 100 frames a second
CONTAMINATED = 2  # places before and after a broken one have lines that lead through it
MOST_LETTERS = 6  # that a cut takes before a point: no place is 1000 km away
PROOFS = 4  # places, stated by us
NEAR = 2e-3  # m, stated by us: a place so near its path is as good as any, whatever digits are missing

CLOCK = Writing()  # a time may go on with any digits


def broken_lines(
    rows: Rows, cells: Integers, columns: Integers, time: Floats, places: Floats, metres: float, writing: Writing
) -> Booleans:
    """Return which lines end within the z of a marker, (rows,).

    - `cells`: of each line, (rows,); `columns`: of each marker's x, y and z, (markers, 3)
    - `time` [s], (rows,); `places` [m], (rows, markers, 3), NaN where not seen; `metres`: of the unit that they had
    """
    found = np.zeros(len(rows), bool)
    for marker in np.flatnonzero(np.isin(columns[:, 2] + 1, cells)).tolist():

        def others(at: int, lines: Booleans, marker: int = marker) -> float:
            around = slice(max(0, at - 2 * CONTAMINATED), at + 2 * CONTAMINATED + 1)
            if not (np.diff(time[around]) > 0).all():
                return np.inf
            beside = places[around].copy()
            beside[:, marker, 2] = np.nan
            misses = _misses(time[around], beside.reshape(len(beside), -1))[1]
            first = max(0, at - around.start - CONTAMINATED)
            among = np.fmin.reduce(misses[lines, first : first + 2 * CONTAMINATED + 1])
            return float(np.nanmax(among, initial=0.0)) / metres

        path, ends_here = places[:, marker, 2] / metres, cells == columns[marker, 2] + 1
        found |= broken_of(rows, ends_here, time, path, writing, MARKER_SD / metres, others)
    return found


def broken_of(
    rows: Rows, ends_here: Booleans, time: Floats, path: Floats, writing: Writing, noise: float = 0.0,
    others: Callable[[int, Booleans], float] = lambda _, __: 0.0,
) -> Booleans:  # fmt: skip
    """Return which lines end within their number of a path, (rows,).

    - `ends_here`: which lines have that number last, (rows,)
    - `time` [s], (rows,); `path`: of any unit, (rows,), NaN where not seen
    - `noise`: of that unit; `others`: tells what other paths miss the same of the three lines by, around a row
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
        around = np.fmin.reduce(misses[lines, max(0, k - STRETCH) : k + STRETCH + 1])
        apart = np.abs(np.arange(len(around)) - min(k, STRETCH))
        own = around[np.isfinite(around) & (apart > (0 if lines.sum() == 1 else CONTAMINATED))]
        at, chance = int(seen[k]), CUT_LAST if seen[k] == len(rows) - 1 else CUT_WITHIN
        cell = rows.last_cell(at)
        odds = LETTERS * writing.share_of(form_of(cell).digits) / ((len(own) + 1) * chance)
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
    """Return whether a path [m], (rows,), is within NEAR of where a line or a parabola leads, at its last places.

    The last place may be another one. The PROOFS before show how well they lead. `time` [s], (rows,)
    """
    return any(
        len(path) >= PROOFS + degree + 2
        and all(_is_led(time[: len(path) - k], path[: len(path) - k], degree) for k in range(PROOFS + 1))
        for degree in (1, 2)
    )


def _is_led(time: Floats, path: Floats, degree: int) -> bool:
    """Return whether a polynomial through the places before the last one leads to it, as near as NEAR."""
    before = slice(-degree - 2, -1)
    if not np.isfinite(path[before]).all() or not (np.diff(time[before]) > 0).all():
        return False
    return bool(abs(path[-1] - np.polyfit(time[before] - time[-1], path[before], degree)[-1]) <= NEAR)


def _misses(time: Floats, path: Floats) -> tuple[Floats, Floats, Floats]:
    """Return where three straight lines lead, by what a path misses them, and their reaches, each (3, n, ...).

    NaN without a line. Misses are divided by the reaches, and reaches by that between two usual steps.

    `time` [s], (n,), increasing; `path`, (n, ...), of any unit
    """
    lead, reach = straight_lines(time, path)
    wide = np.maximum(1.0, reach / np.median(np.diff(time)) ** 2).reshape(3, -1, *[1] * (path.ndim - 1))
    return lead, np.abs(path - lead) / wide, wide


def _largest_around(off: Floats) -> Floats:
    """Return the largest of the numbers before and after each, but for those beside it."""
    beside = STRETCH - CONTAMINATED
    largest = sliding_window_view(np.pad(off, STRETCH), beside).max(1)
    return np.asarray(np.maximum(largest[: len(off)], largest[STRETCH + CONTAMINATED + 1 :][: len(off)]))


def _may_begin(cell: str, low: float, high: float, writing: Writing) -> bool:
    """Return whether a number between two others is written with the letters of a cell, and more behind them."""
    mantissa, sign, power = cell.strip().replace(",", ".").lower().partition("e")
    digits, has_point = form_of(mantissa).digits, "." in mantissa
    begin = abs(float(mantissa))
    first, last = begin, begin + 10.0**-digits
    goes_on = list[tuple[float, float]]()
    if not sign:
        goes_on += [(first, last)] if digits < writing.most else []
        goes_on += [(first * 10.0**k, (first + 1) * 10.0**k) for k in range(1, MOST_LETTERS)] if not has_point else []
    if sign or 1 <= begin < 10:  # as programs write numbers with a power
        tens = [10.0 ** int(whole) for whole in writing.powers if whole.startswith(power) and whole != power]
        goes_on += [(first * ten, last * ten) for ten in tens]
    near, far = sorted((-low, -high)) if mantissa.startswith("-") else (low, high)
    return any(first < far and near < last for first, last in goes_on)

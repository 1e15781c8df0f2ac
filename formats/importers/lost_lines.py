"""Detect missing frames between two lines of a marker file, where lost bytes may have joined the lines around them.

Lost bytes may begin within one line and end within a later one. Their rests may together have as many cells as a
whole line: the time of the first line, and positions of the second. Then some coordinates lie off the straight lines
through the two positions before. A whole line before a pause continues all trajectories, and keeps its positions.

One frame misses where a step of the times is two intervals, and all later times come an interval later. A late stamp
differs from that, since the next one is on time. Times rounded to about an interval show no single frame. Neither do
intervals of random lengths, whose sums come about as late without it.

Frame numbers that go on across a pause in the times show that no line was lost. The pause is reported all the same.

Programs that leave out frames do so in many places, so a file with many missing frames gets no warning.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from formats.arrays import Booleans, Floats
from formats.importers.broken_numbers import POSITIONS_AROUND
from formats.importers.path_outliers import straight_lines
from formats.importers.stated_values import missing_frames

MOST_HOLES = 3  # of a file; our choice: more are gaps that a program left
FEWEST_TIMES = 10  # our choice: fewer do not show the interval of frames
LONGEST_STEP_IN_TURN = 2.5  # median intervals: times rounded to 0.01 s at 99.7 frames a second have steps of 2
LEAST_STEP_OF_TWO = 1.5  # median intervals: halfway between one and two
FINEST_OF_INTERVAL = 0.25  # of the interval, which the digits of times must resolve; our choice: half a jump to see
LASTING_DELAY = 0.6  # intervals; our choice: half is a late stamp at the end of the lines around, one a missing frame
AROUND_A_STEP = 10, 3  # lines on each side; our choice: at most, and fewer than the second show no lasting delay
FEWEST_DEVIATIONS = 8  # lines around; our choice: the largest of fewer tells little of the usual deviation
DIGITS_OF_TIMES, SAME_STAMP = 6, 1e-3  # tried, of seconds behind the point; intervals, for the rounding of floats
FARTHER = 2.0  # times the largest of 50 deviations or delays; our choice: 4.5 standard deviations of noise


def remove_joined_lines(first: Floats, time: Floats, positions: Floats, line: Callable[[int], str]) -> str:
    """Return a warning of missing frames, '' without any; mark as not seen the markers of joined lines before them.

    - `first`: the first number of each line, which may be the frame number, (rows,); `time` [s], (rows,)
    - `positions` [m], (rows, markers, 3), NaN where not seen; `line`: returns the name of a row's line in the file
    """
    steps = np.diff(time)
    if len(time) < FEWEST_TIMES or not (steps > 0).all():
        return ""
    numbers = np.diff(first)
    are_numbered = bool((first == np.rint(first)).all()) and np.median(numbers) == 1
    usual = float(np.median(steps))
    is_pause = steps > LONGEST_STEP_IN_TURN * usual
    is_hole = numbers > 1 if are_numbered else is_pause | _are_steps_of_two(time, steps, usual)
    certain = numbers > 1 if are_numbered else is_pause
    told = (np.flatnonzero(one).tolist() for one in (is_hole | is_pause, certain))
    holes = next((one for one in told if len(one) <= MOST_HOLES), [])
    seen = [at for at in holes if is_hole[at] and np.isfinite(positions[at]).any()]
    joined = [at for at in seen if not _goes_on(time, positions, at, holes)]
    positions[joined] = np.nan
    lacks = (
        missing_frames(int(first[at]) + 1, int(first[at + 1]) - 1)
        if are_numbered and is_hole[at]
        else f"{steps[at] - usual:.3g} s are"
        for at in holes
    )
    return "; ".join(
        f"{what} missing behind {line(at)}" + ", so its markers count as not seen" * (at in joined)
        for at, what in zip(holes, lacks, strict=True)
    )


def _are_steps_of_two(time: Floats, steps: Floats, usual: float) -> Booleans:
    """Return behind which lines one frame is missing, (steps,), by steps of two usual intervals [s] that last."""
    found = np.zeros(len(steps), bool)
    long = np.flatnonzero(steps >= LEAST_STEP_OF_TWO * usual)
    maybe = long[steps[long] <= LONGEST_STEP_IN_TURN * usual].tolist()
    if not maybe or len(maybe) > MOST_HOLES or _resolution(time, usual) > FINEST_OF_INTERVAL * usual:
        return found
    most = AROUND_A_STEP[0]
    interval = float(np.median((time[most:] - time[:-most]) / most)) if len(time) > most else usual
    late = time - interval * np.arange(len(time))
    for at in maybe:
        near = range(max(0, at - POSITIONS_AROUND), min(len(steps), at + POSITIONS_AROUND))
        uneven = max((abs(steps[k] - usual) for k in near if k not in maybe), default=0.0)
        others = max((abs(_delay(late, k)) for k in near if (np.abs(long - k) >= most).all()), default=0.0)
        delay = _delay(late, at)
        is_odd = delay > FARTHER * others or steps[at] - usual > FARTHER * uneven
        found[at] = delay > LASTING_DELAY * interval and is_odd
    return found


def _delay(late: Floats, at: int) -> float:
    """Return by how much [s] the times behind a line are later than those up to it, 0 with too few of either.

    late: times without a regular clock's part [s], (rows,)
    """
    most, fewest = AROUND_A_STEP
    before, after = late[max(at + 1 - most, 0) : at + 1], late[at + 1 : at + 1 + most]
    return float(after.mean() - before.mean()) if min(len(before), len(after)) >= fewest else 0.0


def _resolution(time: Floats, usual: float) -> float:
    """Return the coarsest power of ten [s] of which all times are multiples, a small one where none is."""
    for digits in range(DIGITS_OF_TIMES):
        coarse = 10.0**-digits
        if (np.abs(time - coarse * np.rint(time / coarse)) < SAME_STAMP * usual).all():
            return coarse
    return 0.0


def _goes_on(time: Floats, positions: Floats, at: int, holes: list[int]) -> bool:
    """Return whether a line continues the trajectories of all markers that the two lines before it show.

    - `time` [s], (rows,), increasing; `positions` [m], (rows, markers, 3), NaN where not seen
    - `holes`: lines behind which frames are missing
    """
    near = slice(max(0, at - POSITIONS_AROUND), at + POSITIONS_AROUND)
    lead, reach = straight_lines(time[near], positions[near].reshape(len(time[near]), -1))
    wide = np.maximum(1.0, reach[1] / np.median(np.diff(time)) ** 2)
    off = np.abs(positions[near].reshape(len(lead[1]), -1) - lead[1]) / wide[:, None]
    own = at - near.start
    across = [hole + 1 + k - near.start for hole in holes for k in range(2)]
    others = np.delete(off, [own, *(k for k in across if 0 <= k < len(off))], axis=0)
    is_led = np.isfinite(off[own]) & (np.isfinite(others).sum(0) >= FEWEST_DEVIATIONS)
    usual = np.fmax.reduce(others[:, is_led], initial=0.0)
    return bool(is_led.any() and (off[own, is_led] <= FARTHER * usual).all())

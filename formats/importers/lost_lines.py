"""Detect missing frames between two lines of a marker file, where lost bytes may have joined the lines around them.

Lost bytes may begin within one line and end within a later one. Their rests may together have as many cells as a
whole line: the time of the first line, and positions of the second. Then some coordinates lie off the straight lines
through the two positions before. A whole line before a pause continues all trajectories, and keeps its positions.

One frame misses where a step of the times is two intervals, and all later times come an interval later. A late stamp
differs from that, since the next one is on time. Times rounded to about an interval show no single frame.

Frame numbers that go on across a pause in the times show that no line was lost. The pause is reported all the same.

Programs that leave out frames do so in many places, so a file with many missing frames gets no warning.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from formats.arrays import Booleans, Floats
from formats.importers.broken_numbers import POSITIONS_AROUND
from formats.importers.path_outliers import straight_lines

MOST_HOLES = 3  # of a file; our choice: more are gaps that a program left
FEWEST_TIMES = 10  # our choice: fewer do not show the interval of frames
LONGEST_STEP_IN_TURN = 2.5  # median intervals: times rounded to 0.01 s at 99.7 frames a second have steps of 2
LEAST_STEP_OF_TWO = 1.5  # median intervals: halfway between one and two
FINEST_OF_INTERVAL = 0.25  # of the interval, which the digits of times must resolve; our choice: half a jump to see
LASTING_DELAY = 0.6  # intervals; our choice: half is a late stamp at the end of the lines around, one a missing frame
AROUND_A_STEP = 10, 3  # lines on each side; our choice: at most, and fewer than the second show no lasting delay
FEWEST_DEVIATIONS = 8  # lines around; our choice: the largest of fewer tells little of the usual deviation
DIGITS_OF_TIMES, SAME_STAMP = 6, 1e-3  # tried, of seconds behind the point; intervals, for the rounding of floats
FARTHER = 2.0  # times the largest of 50 deviations; our choice: 4.5 standard deviations of noise


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
    holes = np.flatnonzero(is_hole | is_pause).tolist()
    if len(holes) > MOST_HOLES:
        return ""
    seen = [at for at in holes if is_hole[at] and np.isfinite(positions[at]).any()]
    joined = [at for at in seen if not _goes_on(time, positions, at, holes)]
    positions[joined] = np.nan
    told = (
        _missing(first[at : at + 2]) if are_numbered and is_hole[at] else f"{steps[at] - usual:.3g} s are"
        for at in holes
    )
    return "; ".join(
        f"{what} missing behind {line(at)}" + ", so its markers count as not seen" * (at in joined)
        for at, what in zip(holes, told, strict=True)
    )


def _are_steps_of_two(time: Floats, steps: Floats, usual: float) -> Booleans:
    """Return behind which lines one frame is missing, (steps,), by steps of two usual intervals [s] that last."""
    found = np.zeros(len(steps), bool)
    maybe = np.flatnonzero((steps >= LEAST_STEP_OF_TWO * usual) & (steps <= LONGEST_STEP_IN_TURN * usual)).tolist()
    if not maybe or len(maybe) > MOST_HOLES or _resolution(time, usual) > FINEST_OF_INTERVAL * usual:
        return found
    most, fewest = AROUND_A_STEP
    interval = float(np.median((time[most:] - time[:-most]) / most)) if len(time) > most else usual
    for at in maybe:
        before, after = time[max(at + 1 - most, 0) : at + 1], time[at + 1 : at + 1 + most]
        if min(len(before), len(after)) >= fewest:
            later = (after - interval * np.arange(len(after))).mean() - interval
            later -= (before + interval * np.arange(len(before))[::-1]).mean()
            found[at] = later > LASTING_DELAY * interval
    return found


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


def _missing(around: Floats) -> str:
    """Return the missing frame numbers between two frames in words."""
    begin, end = int(around[0]) + 1, int(around[1]) - 1
    return f"frame {begin} is" if begin == end else f"frames {begin} to {end} are"

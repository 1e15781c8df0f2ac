"""Detect missing frames between two lines of a marker file, where lost bytes may have joined the lines around them.

Lost bytes may begin within one line and end within a later one. Their rests may together have as many cells as a
whole line: the time of the first line, and positions of the second. Then some coordinates lie off the straight lines
through the two positions before. A whole line before a pause continues all trajectories, and keeps its positions.

Programs that leave out frames do so in many places, so a file with many missing frames gets no warning.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from formats.arrays import Floats
from formats.importers.broken_numbers import STRETCH
from formats.importers.path_outliers import straight_lines

MOST_HOLES = 3  # of a file; our choice: more are gaps that a program left
FEWEST_TIMES = 10  # our choice: fewer do not show the interval of frames
LONGEST_STEP_IN_TURN = 2.5  # median intervals: times rounded to 0.01 s at 99.7 frames a second have steps of 2
FEWEST_DEVIATIONS = 8  # lines around; our choice: the largest of fewer tells little of the usual deviation
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
    is_hole = numbers > 1 if are_numbered else steps > LONGEST_STEP_IN_TURN * np.median(steps)
    holes = np.flatnonzero(is_hole).tolist()
    if len(holes) > MOST_HOLES:
        return ""
    joined = [at for at in holes if not _goes_on(time, positions, at, holes)]
    positions[joined] = np.nan
    return "; ".join(
        f"{_missing(first[at : at + 2], float(steps[at]), are_numbered=are_numbered)} missing behind {line(at)}"
        + ", so its markers count as not seen" * (at in joined)
        for at in holes
    )


def _goes_on(time: Floats, positions: Floats, at: int, holes: list[int]) -> bool:
    """Return whether a line continues the trajectories of all markers that the two lines before it show.

    - `time` [s], (rows,), increasing; `positions` [m], (rows, markers, 3), NaN where not seen
    - `holes`: lines behind which frames are missing
    """
    near = slice(max(0, at - STRETCH), at + STRETCH)
    lead, reach = straight_lines(time[near], positions[near].reshape(len(time[near]), -1))
    wide = np.maximum(1.0, reach[1] / np.median(np.diff(time)) ** 2)
    off = np.abs(positions[near].reshape(len(lead[1]), -1) - lead[1]) / wide[:, None]
    own = at - near.start
    across = [hole + 1 + k - near.start for hole in holes for k in range(2)]
    others = np.delete(off, [own, *(k for k in across if 0 <= k < len(off))], axis=0)
    is_led = np.isfinite(off[own]) & (np.isfinite(others).sum(0) >= FEWEST_DEVIATIONS)
    usual = np.fmax.reduce(others[:, is_led], initial=0.0)
    return bool(is_led.any() and (off[own, is_led] <= FARTHER * usual).all())


def _missing(around: Floats, step: float, *, are_numbered: bool) -> str:
    """Return the missing frame numbers between two frames in words, or the missing time."""
    begin, end = int(around[0]) + 1, int(around[1]) - 1
    if not are_numbered:
        return f"{step:.3g} s are"
    return f"frame {begin} is" if begin == end else f"frames {begin} to {end} are"

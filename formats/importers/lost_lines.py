"""Detect missing frames between two lines of a marker file, where lost bytes may have joined the lines around them.

Lost bytes may begin within one line and end within a later one. Their rests may together have as many cells as a
whole line: the time of the first line, and positions of the second. Programs that leave out frames do so in many
places, so a file with many missing frames gets no warning.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from formats.arrays import Floats

MOST_HOLES = 3  # of a file, stated by us
FEWEST_LINES = 10  # stated by us: fewer do not show the interval of frames
LONGEST_STEP_IN_TURN = 2.5  # median intervals: times rounded to 0.01 s at 99.7 frames a second have steps of 2


def remove_joined_lines(first: Floats, time: Floats, positions: Floats, line: Callable[[int], str]) -> str:
    """Mark as not seen the markers of lines behind which frames are missing; return a warning of them, '' without any.

    - `first`: the first number of each line, which may be the frame number, (rows,); `time` [s], (rows,)
    - `positions` [m], (rows, markers, 3), NaN where not seen; `line`: returns the name of a row's line in the file
    """
    steps = np.diff(time)
    if len(time) < FEWEST_LINES or not (steps > 0).all():
        return ""
    numbers = np.diff(first)
    are_numbered = bool((first == np.rint(first)).all()) and np.median(numbers) == 1
    is_hole = numbers > 1 if are_numbered else steps > LONGEST_STEP_IN_TURN * np.median(steps)
    holes = np.flatnonzero(is_hole).tolist()
    if len(holes) > MOST_HOLES:
        return ""
    positions[holes] = np.nan
    return "; ".join(
        f"{_missing(first[at : at + 2], float(steps[at]), are_numbered=are_numbered)} missing behind {line(at)}, so "
        "its markers count as not seen"
        for at in holes
    )


def _missing(around: Floats, step: float, *, are_numbered: bool) -> str:
    """Return the missing frame numbers between two frames in words, or the missing time."""
    begin, end = int(around[0]) + 1, int(around[1]) - 1
    if not are_numbered:
        return f"{step:.3g} s are"
    return f"frame {begin} is" if begin == end else f"frames {begin} to {end} are"

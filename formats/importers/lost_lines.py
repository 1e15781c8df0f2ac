"""Tell of frames that are missing between two lines: lost bytes may have joined the two lines around them.

A piece of a text that is lost begins within one line and ends within another. The rest of both may have as many
cells as a line. It has the time of the first and places of the second. Programs that leave out frames do so in many
places, and then none is told.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from formats.arrays import Floats

MOST_HOLES = 3  # of a file, stated by us
FEWEST_LINES = 10  # stated by us: fewer do not tell how far frames are apart
LONGEST_STEP_IN_TURN = 2.5  # median steps; a time to 0.01 s of 99.7 frames a second is two off for some


def take_out_joined_lines(first: Floats, time: Floats, places: Floats, line: Callable[[int], str]) -> str:
    """Take out the places of lines behind which frames are missing; return a sentence on them, '' without any.

    - `first`: the first number of each line, (rows,), which may be that of its frame; `time` [s], (rows,)
    - `places` [m], (rows, markers, 3), NaN where not seen; `line`: names the line of a row
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
    places[holes] = np.nan
    return "; ".join(
        f"{_missing(first[at : at + 2], float(steps[at]), are_numbered=are_numbered)} missing behind {line(at)}, so "
        "its markers count as not seen"
        for at in holes
    )


def _missing(around: Floats, step: float, *, are_numbered: bool) -> str:
    """Return which frames are missing between the numbers of two, or how much time."""
    begin, end = int(around[0]) + 1, int(around[1]) - 1
    if not are_numbered:
        return f"{step:.3g} s are"
    return f"frame {begin} is" if begin == end else f"frames {begin} to {end} are"

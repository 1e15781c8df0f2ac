"""Find coordinates of C3D files that wrap round at 16 bits: a position beyond 32767 steps is written 65536 lower.

A marker's coordinate wraps between two positions whose difference is about one turn of 65536 steps:

    | |z2 - z1| - 65536 |  <  max(WRAP_BEYOND_ALL, TIMES_USUAL s)

Programs scale the farthest coordinate to 32000 steps at most. So two undamaged positions differ by 64000 at most, which
`WRAP_BEYOND_ALL` says. A fast marker comes farther from one frame to the next: `s` is the length that USUAL_STEPS of
the coordinate's differences keep. It counts between successive frames alone, and below `WRAP_SHOWS`.

Behind each wrap the coordinate lies on another level, one turn higher or lower. The level of most positions counts as
undamaged, since the garment's other markers lie beside these.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from formats.arrays import Booleans, Floats
from formats.importers.missing_values import counted_out
from formats.importers.number_cells import CELL_SHOWN
from formats.plain_text import MOST_LISTED, first_few

WRAP = 1 << 16  # steps: one turn of 16 bits
SCALED_TO = 32000  # steps: the C3D user guide has programs scale the farthest coordinate to it
WRAP_BEYOND_ALL = WRAP - 2 * SCALED_TO  # steps: undamaged positions differ by this much less than a turn
TIMES_USUAL = (
    3.0  # times the usual difference; our choice: a swing's fastest frames move twice as far as its usual ones
)
USUAL_STEPS = 0.95  # of a coordinate's differences; our choice: the wraps themselves are fewer
WRAP_SHOWS = WRAP // 4  # steps from frame to frame; our choice: a path that moves farther shows no wrap


def remove_wrapped(positions: Floats, steps: Floats, labels: Sequence[str], where: Callable[[int], str]) -> str:
    """Mark as not seen the positions with a coordinate that wrapped; return a warning of them, '' without any.

    - `positions` [m], (frames, markers, 3), NaN where not seen; `steps` [m]: of each marker's integers, (markers,)
    - `labels`: the markers' names; `where`: returns the name of a frame's number in the file
    """
    count, named = 0, list[str]()
    for marker in range(positions.shape[1]):
        wrapped = _are_wrapped(positions[:, marker] / steps[marker])
        frames = np.flatnonzero(wrapped)
        if not len(frames):
            continue
        positions[frames, marker] = np.nan
        until = f" to {where(int(frames[-1]))}" if len(frames) > 1 else ""
        named.append(f"{labels[marker].strip()[:CELL_SHOWN]} in {where(int(frames[0]))}{until}")
        count += len(frames)
    if not count:
        return ""
    return (
        f"{counted_out(count)}, with a coordinate that wrapped round at 16 bits: "
        f"{first_few(named[:MOST_LISTED], len(named))}; export floats, or a larger scale"
    )


def _are_wrapped(path: Floats) -> Booleans:
    """Return which positions have a coordinate on another level than most, (frames,); `path`: steps, (frames, 3)."""
    found, seen = np.zeros(len(path), bool), np.flatnonzero(np.isfinite(path).all(1))
    places, are_successive = path[seen], np.diff(seen) == 1
    ways = np.diff(places, axis=0)
    off = np.abs(np.abs(ways) - WRAP)
    for axis in np.flatnonzero((off < WRAP_SHOWS).any(0)).tolist():
        usual = float(np.quantile(np.minimum(np.abs(ways[:, axis]), off[:, axis]), USUAL_STEPS))
        fast = TIMES_USUAL * usual if WRAP_BEYOND_ALL < TIMES_USUAL * usual < WRAP_SHOWS else WRAP_BEYOND_ALL
        wraps = off[:, axis] < np.where(are_successive, fast, WRAP_BEYOND_ALL)
        level = np.concatenate([[0], np.cumsum(np.where(wraps, np.sign(ways[:, axis]), 0))])
        levels, counts = np.unique(level, return_counts=True)
        found[seen[level != levels[counts.argmax()]]] = True
    return found

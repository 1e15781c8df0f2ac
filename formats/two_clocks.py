"""Merge a hanger and points with separate clocks into one take, whose frames are the times of both.

A frame then holds only the hanger (`FrameState.HANGER_ALONE`), only the points (`FrameState.POINTS_ALONE`), or both
where they were measured at the same time.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from formats.arrays import Booleans, Floats, Integers
from formats.missing import origin_of, span_words
from formats.take import FrameState, Take

MOST_OF_THE_TIME = 0.9  # of the pictures' time: the public recordings' paths cover 0.96 of it and more
SAME_TIME = 1e-3  # s: nearer times become one frame; a hanger at 2 m/s moves 2 mm meanwhile


def with_hanger(take: Take, time: Floats, held: Floats, sd: float) -> Take:
    """Return an imported take with a hanger that was measured at other times than its points.

    - `time` [s], (sights,): increasing, on the clock of `take.time`
    - `held` [m], (sights, 2, 3): the two ends of the held edge, left first
    - `sd` [m]: their standard deviation per axis
    """
    sight, picture = _nearest(time, take.time), _nearest(take.time, time)
    shared = np.flatnonzero(np.abs(time[sight] - take.time) < SAME_TIME)  # pictures at which the hanger was seen too
    is_alone = np.abs(take.time[picture] - time) >= SAME_TIME
    every = np.concatenate([take.time, time[is_alone]])
    order = np.argsort(every)
    place = np.argsort(order)
    pictures, alone = place[: len(take.time)], place[len(take.time) :]

    def spread(values: NDArray[Any], empty: float | bool) -> NDArray[Any]:
        full = np.full((len(every), *values.shape[1:]), empty, values.dtype)
        full[pictures] = values
        return full

    both = np.full((len(every), 2, 3), np.nan)
    both[alone], both[pictures[shared]] = held[is_alone], held[sight[shared]]
    state = spread(take.state | FrameState.POINTS_ALONE, FrameState.HANGER_ALONE)
    state[pictures[shared]] &= ~np.uint16(FrameState.POINTS_ALONE)
    hidden = take.points_hidden
    return replace(
        take, time=every[order], held=both, held_valid=np.isfinite(both).all(2),
        held_sd=np.full(both.shape, sd), markers=both, points=spread(take.points, np.nan),
        points_valid=spread(take.points_valid, False), points_sd=spread(take.points_sd, np.nan), state=state,
        points_hidden=None if hidden is None else spread(hidden, False),
        quality=None if take.quality is None else spread(take.quality, np.nan),
    )  # fmt: skip


def _nearest(among: Floats, instants: Floats) -> Integers:
    """Return the index of the nearest of increasing times, (k,), for each of the instants, (n,)."""
    after = np.searchsorted(among, instants)
    before, after = np.clip(after - 1, 0, None), np.clip(after, None, len(among) - 1)
    return np.where(np.abs(among[before] - instants) <= np.abs(among[after] - instants), before, after)


def at_times(wanted: Floats, time: Floats, held: Floats) -> Floats:
    """Return the held ends [m], (n, 2, 3), interpolated linearly at the wanted times [s], (n,); NaN outside the path.

    time [s], (sights,); held [m], (sights, 2, 3)
    """
    columns = [np.interp(wanted, time, column, np.nan, np.nan) for column in held.reshape(len(time), 6).T]
    return np.stack(columns, axis=1).reshape(len(wanted), 2, 3)


def hanger_gap(take: Take) -> str:
    """Return in words the only time that the hanger's clock covers.

    Return '' where it covers MOST_OF_THE_TIME of the points' time.
    """
    of_hanger, of_points = take.time[shows_hanger(take)], take.time[shows_points(take)]
    if not len(of_hanger) or not len(of_points):
        return ""
    first, last = max(of_hanger[0], of_points[0]), min(of_hanger[-1], of_points[-1])
    if last - first >= MOST_OF_THE_TIME * (of_points[-1] - of_points[0]):
        return ""
    origin = origin_of(take)
    return f", {span_words(of_hanger[0] - origin, of_hanger[-1] - origin, 1, 'from ')} only"


def shows_points(take: Take) -> Booleans:
    """Return the frames in which points could be seen, (frames,)."""
    return np.asarray((take.state & FrameState.HANGER_ALONE) == 0)


def shows_hanger(take: Take) -> Booleans:
    """Return the frames in which the hanger could be seen, (frames,)."""
    return np.asarray((take.state & FrameState.POINTS_ALONE) == 0)

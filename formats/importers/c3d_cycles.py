"""Tell labels that are exchanged in a cycle from a shift of a C3D file's bytes by whole markers: both leap alike.

Three differences show which of them begins behind a frame:

- A shift begins within a frame. The markers before that place are where they should be, and all others have moved.
  Labels are exchanged for whole frames.
- A shift by `r` markers takes `r` of them from the frame before, or from the next one. So they lag behind the others by
  one step, or are ahead by one. In a cycle, no marker does.
- Where analogue values separate the frames' markers, a shift takes these values for positions.

The straight lines through the two positions before tell the time: each marker is compared with its line, one step
earlier and one step later. Where most markers accelerate, their mean distance from the lines is subtracted.
"""

from __future__ import annotations

import numpy as np

from formats.arrays import Booleans, Floats

TIME_SHOWS = 2.0  # times nearer to one time than to the others; our choice: at a turn, both are as near
FOREIGN = 10.0  # steps of the other markers; our choice: foreign values and bytes lie metres away
FRAMES_SHOWING = 3  # behind the last one before; our choice: a shift is found up to two frames beside its own


def is_cycle(frames: Floats, places: int) -> bool | None:
    """Return whether labels are exchanged in a cycle, rather than bytes shifted; None if the frames do not show it.

    - `frames`: positions of all markers, (frames, markers, 3), NaN where not seen; the last two frames before, then
      up to FRAMES_SHOWING behind
    - `places`: by how many labels each marker is moved, below 0 for earlier labels
    """
    count = frames.shape[1]
    source = np.arange(count) - places  # the marker under each label; those of no index lie in another frame
    is_taken = np.asarray((source < 0) | (source >= count))
    source %= count
    last, step, at = frames[1], frames[1] - frames[0], 1
    for k in range(2, len(frames)):
        here, led = frames[k], last + (k - at) * step
        with np.errstate(over="ignore", invalid="ignore"):  # of foreign bytes
            own, moved = np.linalg.norm(here - led, axis=1), np.linalg.norm(here - led[source], axis=1)
            shows = np.linalg.norm(led - led[source], axis=1) > 2 * np.fmin(own, moved)
            are_moved = (moved < own)[shows]
            if not are_moved.any():
                if shows.all():
                    last, step, at = here, (here - last) / (k - at), k
                continue
            if are_moved.all():
                return _are_together(here - led[source], step[source], is_taken)
            if are_moved[are_moved.argmax() :].all():
                return False
    return None


def _are_together(off: Floats, step: Floats, is_taken: Booleans) -> bool | None:
    """Return whether markers that a shift would take from another frame are at the others' time; None if unknown.

    - `off`, `step`: distances of the positions from their lines, and the lines' steps, (markers, 3)
    - `is_taken`: whether a shift would take the marker under a label from another frame, (markers,)
    """
    is_seen = np.isfinite(off + step).all(1)
    taken, others = np.flatnonzero(is_seen & is_taken), np.flatnonzero(is_seen & ~is_taken)
    if not len(taken) or not len(others):
        return None
    beside = [off - later * step for later in (-1, 0, 1)]
    farthest = FOREIGN * max(_median(off[others]), _median(step[others]))
    if min(_median(one[taken]) for one in beside) > farthest:
        return False
    times = [_time_of([_median(one[some]) for one in beside]) for some in (taken, others)]
    if None not in times:
        return times[0] == times[1]
    common = np.median(off[others], axis=0)
    time = _time_of([_median(one[taken] - common) for one in beside])
    return None if time is None else time == 1


def _median(vectors: Floats) -> float:
    """Return the median length of vectors, (markers, 3)."""
    return float(np.median(np.linalg.norm(vectors, axis=1)))


def _time_of(near: list[float]) -> int | None:
    """Return which of three distances is the shortest, None if not clearly so."""
    return None if TIME_SHOWS * min(near) >= sorted(near)[1] else near.index(min(near))

"""Choose the used part of a damaged take: the stretch without a hole that is judged for longest.

A take whose first frames are lost has one stretch, and its beginning is as unknown as after a hole.

The hanger's path is unknown across a hole of more than `LONGEST_GAP` seconds, so nothing bridges such a hole. A stretch
that begins in the middle of a swing begins with cloth of unknown state. The first seconds of this stretch drive the
simulation and are not judged.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from formats.missing import missing_words, origin_of
from formats.take import LONGEST_GAP, Take

SETTLING_TIME = 2.5  # s after which 4 % are left of a swing that decays with 1.25 /s, as a real hanging cloth did
STILL_MOTION = (
    0.004  # m that the held ends move, root mean square, in a take that begins at rest: sensors' noise is 1 to 3 mm
)
REST_WINDOW = 0.5  # s of a stretch that show whether it begins at rest
FRAME_FIELDS = (
    "time", "held", "held_valid", "held_sd", "points", "points_valid", "points_sd", "state", "markers", "pitch",
    "pitch_sd", "points_hidden", "quality",
)  # fmt: skip


IS_INCOMPLETE = "is incomplete ("  # of every note that `describe_missing` gives


def stretches(take: Take) -> list[slice]:
    """Return the frames between the holes of a take."""
    holes = [end for begin, end in take.missing if math.isfinite(begin + end) and end - begin > LONGEST_GAP]
    edges = [0, *(int(np.searchsorted(take.time, end)) for end in sorted(holes)), len(take.time)]
    return [slice(a, b) for a, b in pairwise(edges) if b > a]


def longest_intact(take: Take) -> Take:
    """Return the stretch of a take without a hole that is judged for longest; the whole take where it has none."""
    found = stretches(take)
    if len(found) < 2 and not _is_unknown(take, found[0]):
        return take
    longest = max(found, key=lambda part: take.time[part.stop - 1] - _judged_from(take, part))
    kept = {name: values[longest] for name in FRAME_FIELDS if (values := getattr(take, name)) is not None}
    valid = kept["points_valid"].copy()
    valid[kept["time"] < _judged_from(take, longest)] = False
    return replace(take, **{**kept, "points_valid": valid})


def _judged_from(take: Take, part: slice) -> float:
    """Return from when on [s of the sensor's clock] what the cloth does follows from the path of its held ends."""
    begin = float(take.time[part.start])
    return begin + SETTLING_TIME if _is_unknown(take, part) and not _begins_at_rest(take, part) else begin


def _is_unknown(take: Take, part: slice) -> bool:
    """Return whether frames are lost before a stretch."""
    return part.start > 0 or any(end <= take.time[0] for _, end in take.missing)


def _begins_at_rest(take: Take, part: slice) -> bool:
    time = take.time[part]
    held = take.held[part][time < time[0] + REST_WINDOW]
    held = held[np.isfinite(held).all((1, 2))]
    return len(held) > 1 and float(np.sqrt(held.var(0).sum(1)).max()) < STILL_MOTION


def describe_missing(takes: Sequence[Take]) -> list[str]:
    """Return a warning for each take that is incomplete: what is missing, and what of it is used."""
    found = []
    for take in takes:
        if take.is_complete:
            continue
        used = longest_intact(take)
        words = missing_words(take) or "its end was never written"
        note = f"Warning: the take {take.take_id} {IS_INCOMPLETE}{len(take.time)} frames are left; missing: {words})"
        if len(used.time) < len(take.time):
            origin = origin_of(take)
            note += f"; used: {used.time[0] - origin:.2f} to {used.time[-1] - origin:.2f} s"
        if np.count_nonzero(used.points_valid) < np.count_nonzero(take.points_valid[_rows_of(used, take)]):
            note += f"; its first {SETTLING_TIME:g} s are not judged, as how the cloth hung there is lost"
        found.append(note + ".")
    return found


def incomplete_notes(notes: Sequence[str]) -> list[str]:
    """Return those notes of a result that say that a take is incomplete."""
    return [note for note in notes if IS_INCOMPLETE in note]


def _rows_of(used: Take, take: Take) -> slice:
    begin = int(np.searchsorted(take.time, used.time[0]))
    return slice(begin, begin + len(used.time))

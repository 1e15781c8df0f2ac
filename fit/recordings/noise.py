"""White noise of a recording's points and hanger path: the larger of stated and measured noise.

Sixth differences of the frames measure the noise. Below 20 frames a second, swings contribute to them as well. There
the noise is the deviation of points at rest, before the hanger first moves.
"""

from __future__ import annotations

import numpy as np

from fit.recordings.camera import FEWEST_RESTING_FRAMES, is_still
from fit.recordings.recording import Recording
from fit.recordings.smoothing import noise_of
from formats.arrays import Floats

SLOWEST_RATE = 20.0  # frames/s: below, swings contribute to sixth differences
FEWEST_FOR_DIFFERENCES = 11  # five sixth differences


def point_noise(recording: Recording) -> Floats:
    """Return each point's standard deviation per axis [m], (points,)."""
    seen = white_noise(recording)
    return recording.point_sd if seen is None else np.asarray(np.maximum(recording.point_sd, seen))


def white_noise(recording: Recording) -> Floats | None:
    """Return each point's noise per axis [m], (points,); None for a slow take that does not begin at rest."""
    if _is_fast(recording):
        return np.array([_white(recording.points[recording.valid[:, k], k]) for k in range(recording.points.shape[1])])
    count = _at_rest(recording, recording.time)
    points = np.where(recording.valid[:count, :, None], recording.points[:count], np.nan)
    known = np.isfinite(points[..., 0]).sum(0) >= FEWEST_RESTING_FRAMES
    if not known.any():
        return None
    found = np.sqrt(np.nanvar(points[:, known], axis=0, ddof=1).mean(1))
    noise = np.full(len(known), np.median(found))  # for points that are not seen at rest
    noise[known] = found
    return noise


def held_noise(recording: Recording) -> Floats:
    """Return the standard deviation of each coordinate of the held ends [m], (6,): depth is noisier than the others."""
    if _is_fast(recording):
        seen = recording.held_seen[np.isfinite(recording.held_seen[:, 0])]
        return np.array([_white(column[:, None]) for column in seen.T])
    count = _at_rest(recording, recording.time if recording.held_time is None else recording.held_time)
    seen = recording.held_seen[:count]
    seen = seen[np.isfinite(seen[:, 0])]
    if len(seen) < FEWEST_RESTING_FRAMES:
        return np.full(6, recording.held_sd)
    return np.asarray(seen.std(0, ddof=1))


def _is_fast(recording: Recording) -> bool:
    """Return whether the frame rate is high enough for sixth differences to be free of motion."""
    return (len(recording.time) - 1) / recording.duration >= SLOWEST_RATE


def _at_rest(recording: Recording, time: Floats) -> int:
    """Return the number of instants [s] before the hanger first moves."""
    moves = np.flatnonzero(~is_still(time, recording.held))
    return int(moves[0]) if len(moves) else len(time)


def _white(columns: Floats) -> float:
    """Return the root mean square deviation of white noise in columns, (frames, n); 0 for too few frames."""
    if len(columns) < FEWEST_FOR_DIFFERENCES:
        return 0.0
    return float(np.sqrt(np.mean([noise_of(column) ** 2 for column in columns.T])))

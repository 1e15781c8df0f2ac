"""White noise of a recording: of its points and of its hanger's path, the larger of what is stated and what shows."""

from __future__ import annotations

import numpy as np

from fit.recordings.recording import Recording
from fit.recordings.smoothing import noise_of
from formats.arrays import Floats

SLOWEST_RATE = 20.0  # frames/s: below, swings themselves show in sixth differences


def point_noise(recording: Recording) -> Floats:
    """Standard deviation per axis of each point [m], (points,)."""
    seen = white_noise(recording)
    return recording.point_sd if seen is None else np.asarray(np.maximum(recording.point_sd, seen))


def white_noise(recording: Recording) -> Floats | None:
    """White noise that sixth differences of each point show, per axis [m], (points,); None of too slow a take."""
    if _is_slow(recording):
        return None
    return np.array([_white(recording.points[recording.valid[:, k], k]) for k in range(recording.points.shape[1])])


def held_noise(recording: Recording) -> Floats:
    """Standard deviation of each coordinate of the held edge's ends [m], (6,): depth is noisier than the rest."""
    if _is_slow(recording):
        return np.full(6, recording.held_sd)
    seen = recording.held_seen[np.isfinite(recording.held_seen[:, 0])]
    return np.array([_white(column[:, None]) for column in seen.T])


def _is_slow(recording: Recording) -> bool:
    """Return whether motion shows in the frames' sixth differences, because frames are too far apart."""
    return (len(recording.time) - 1) / recording.duration < SLOWEST_RATE


def _white(columns: Floats) -> float:
    """Deviation of white noise in columns, (frames, n), root mean square; 0 where there are too few frames."""
    if len(columns) <= 10:
        return 0.0
    return float(np.sqrt(np.mean([noise_of(column) ** 2 for column in columns.T])))

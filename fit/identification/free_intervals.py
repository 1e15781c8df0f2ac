"""90 % intervals for searches that minimise a distance, from the residuals of one more batch of free rollouts.

The model is linearised about the search's best parameters. Each parameter moves once by a twentieth of its box
(`fit.search.least_squares.DIFFERENCE`), wider than the ripples that folds make. The jackknife over half seconds then
gives the intervals (`fit.search.intervals`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from fit.recordings.recording import Recording
from fit.search.intervals import Intervals, LinearModel, block_intervals
from fit.search.least_squares import DIFFERENCE, BoundedSpace
from formats.arrays import Floats, Integers
from formats.sights import half_seconds

Rollouts = Callable[[Floats], Sequence[Floats]]


def free_intervals(space: BoundedSpace, recordings: Sequence[Recording], points: Rollouts, best: Floats) -> Intervals:
    """Return the intervals about a vector of parameters.

    - `points`: maps (candidates, parameters) to one array [m] per recording, (candidates, frames, points, 3)
    - `best`: the search's result, (parameters,)
    """
    unit = space.to_unit(best)
    step = np.where(unit + DIFFERENCE <= 1, DIFFERENCE, -DIFFERENCE)
    candidates = space.from_unit(np.concatenate([unit[None], unit + np.diag(step)]))
    residuals = [
        (recording.points - moved)[:, recording.valid].reshape(len(candidates), -1)
        for recording, moved in zip(recordings, points(candidates), strict=True)
    ]
    stacked = np.concatenate(residuals, axis=1)
    jacobian = np.nan_to_num((stacked[1:] - stacked[0]) / step[:, None]).T
    deviation = float(np.sqrt(np.mean(stacked[0] ** 2)))
    linear = LinearModel(
        parameters=best,
        residuals=stacked[0] / deviation,
        jacobian=jacobian / deviation,
        block=np.concatenate(blocks_of(recordings)),
    )
    return block_intervals(space, linear)


def blocks_of(recordings: Sequence[Recording]) -> list[Integers]:
    """Return the half-second block of each number, per recording; different recordings share no block."""
    found, first = [], 0
    for recording in recordings:
        half_second = half_seconds(recording.time) + first
        found.append(np.repeat(half_second[np.nonzero(recording.valid)[0]], 3))
        first = int(half_second[-1]) + 1
    return found

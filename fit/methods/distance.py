"""The objective of a fit, and its first kind: the distance D of the trajectories of the tracked points.

    D(R, S) = 1/N sum_n 1/M sum_i |r_in - s_in|        [m]

There are N frames and M points. An invalid point is left out of its frame's mean. A frame without valid points is left
out of the mean over frames.

Source: "Estimating the clothes characteristics with the image and depth sensors ...", eq. 1.
"""

from __future__ import annotations

from typing import ClassVar, Protocol

import numpy as np

from fit.recordings.recording import Recording
from formats.arrays import Floats


class Objective(Protocol):
    """Interface of an objective: the error of simulated points against one recording."""

    name: ClassVar[str]
    unit: ClassVar[str]
    parts: ClassVar[tuple[str, ...]]
    remark: str  # a warning against this objective on this recording, or nothing

    def terms(self, simulated: Floats) -> Floats:
        """Return the error's parts, (candidates, parts), of simulated points [m], (candidates, frames, points, 3)."""
        ...


def total(objective: Objective, simulated: Floats) -> Floats:
    """Return the sum of an objective's parts, (candidates,); infinite for a simulation that blew up."""
    with np.errstate(invalid="ignore"):
        whole = objective.terms(simulated).sum(1)
    return np.where(np.isfinite(whole), whole, np.inf)


class TrajectoryDistance:
    """D of eq. 1 against one recording."""

    name: ClassVar[str] = "D"
    unit: ClassVar[str] = "m"
    parts: ClassVar[tuple[str, ...]] = ("distance",)

    def __init__(self, recording: Recording) -> None:
        self._real = recording.points
        self.remark = ""

    def terms(self, simulated: Floats) -> Floats:
        """Return D [m], (candidates, 1)."""
        return distance(self._real, simulated)[:, None]


def distances(real: Floats, simulated: Floats) -> Floats:
    """Return the distance of each point in each frame [m].

    real, (frames, points, 3), NaN where not seen; simulated, (..., frames, points, 3) -> (..., frames, points).
    """
    return np.asarray(np.linalg.norm(simulated - real, axis=-1))


def per_frame(real: Floats, simulated: Floats) -> Floats:
    """Return the mean distance over the seen points of each frame [m], (..., frames); NaN without seen points."""
    apart = distances(real, simulated)
    seen = np.isfinite(real).all(-1)
    with np.errstate(invalid="ignore"):  # no point seen: 0 / 0
        return np.asarray(np.where(seen, apart, 0.0).sum(-1) / seen.sum(-1))


def distance(real: Floats, simulated: Floats) -> Floats:
    """D of eq. 1 [m], (...,); infinite for a simulation that blew up."""
    by_frame = per_frame(real, simulated)
    seen = np.isfinite(real).all(-1).any(-1)
    mean = by_frame[..., seen].mean(-1)
    return np.asarray(np.where(np.isfinite(mean), mean, np.inf))

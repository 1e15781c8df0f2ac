"""Clip slip: at the hardest jerk of a take the cloth slips a little out of a clip, and stays there.

    held_k(t) = measured_k(t) - d_k h((t - t0) / 50 ms) z,     h a smooth step from 0 to 1

t0 is the instant at which the hanger's acceleration is largest.
Source: kinematics; slips of 0.5 to 10 mm are what clips allow.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from fit.effects.base import Curve, Effect, Floats
from fit.recording import Recording

DURATION = 0.05  # s that a slip takes


@dataclass(frozen=True)
class ClipSlip(Effect):
    """How far the cloth slips downwards at the left and at the right end."""

    name: ClassVar[str] = "clip_slip"
    title: ClassVar[str] = "a slip in the clips"
    acts_on: ClassVar[str] = "boundary"
    unit: ClassVar[str] = "m"
    low: ClassVar[float] = -0.002  # a little below zero, so that noise about zero is symmetric
    high: ClassVar[float] = 0.05
    typical: ClassVar[float] = 0.005
    components: ClassVar[tuple[str, ...]] = ("left", "right")

    def drive(self, path: Curve, recording: Recording, amplitude: Floats) -> Curve:
        """Return the path of the held ends, lowered after the hardest jerk."""
        time = np.arange(0.0, recording.duration, 0.005)
        middle = recording.held(time).reshape(-1, 2, 3).mean(1)
        acceleration = np.linalg.norm(np.gradient(np.gradient(middle, time, axis=0), time, axis=0), axis=1)
        at = time[2:-2][int(np.argmax(acceleration[2:-2]))]

        def drive(instants: Floats) -> Floats:
            s = np.clip((instants - at) / DURATION, 0, 1)
            step = s * s * (3 - 2 * s)
            ends = path(instants).copy()
            ends[:, 2] -= amplitude[0] * step
            ends[:, 5] -= amplitude[1] * step
            return np.asarray(ends)

        return drive

"""Clip slip: once in a take the cloth slips a little out of a clip, and stays there.

    held_k(t) = measured_k(t) - d_k h((t - t0) / 100 ms + 1/2) z,     h a smooth step from 0 to 1

The slip begins at t0, when tracked points on the held edge drop. Without tracked points on that edge, t0 is just after
the hanger's hardest jerk (`fit.recordings.held_edge`). The step takes 100 ms. A step of 50 ms shakes the cloth so
sharply that fits underestimate a slip of another course. The law leaves the slip's moment, duration and sideways part
inexact. The rest then turns the held edge: d at one end of an edge of 0.3 m turns the edge by d / 0.3 m. A third of
that angle passes for a rotation of the hanger.

The amplitude is d, for the left and for the right clip; positive is downwards.

Believe it when one take breaks off at one instant: before the slip the cloth fits, after the slip every point stays
lower. Look at the clips after that take.

Source: kinematics; slips of 0.5 to 10 mm are what clips allow.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from fit.cloth.effect import Curve, Effect
from fit.recordings.recording import Recording
from formats.arrays import Floats

DURATION = 0.1  # s that a slip takes: the module states the effect of half; double was not tried


@dataclass(frozen=True)
class ClipSlip(Effect):
    """Distance by which the cloth slips downwards at the left and at the right end."""

    name: ClassVar[str] = "clip_slip"
    title: ClassVar[str] = "a slip in the clips"
    acts_on: ClassVar[str] = "boundary"
    unit: ClassVar[str] = "m"
    low: ClassVar[float] = -0.002  # a little below zero, so that noise about zero is symmetric
    high: ClassVar[float] = 0.05  # our choice: five times the largest slip that clips allow
    typical: ClassVar[float] = 0.005  # our choice: within the 0.5 to 10 mm that clips allow
    # How abruptly cloth slips. Our choice: laws may leave 0.36 of a gap; half and double were not tried.
    law_spread: ClassVar[float] = 0.2
    components: ClassVar[tuple[str, ...]] = ("left", "right")
    brings: ClassVar[tuple[tuple[str, float], ...]] = (("hanger_rotation", 1.0),)

    def regions(self, amplitude: Floats) -> tuple[str, ...]:
        """Return the clip that slipped more, and the other one where it slipped at least half as far."""
        clips = sorted(zip(np.abs(amplitude), ("top left", "top right"), strict=True), reverse=True)
        return tuple(name for slipped, name in clips if slipped >= 0.5 * clips[0][0])

    def drive(self, path: Curve, recording: Recording, amplitude: Floats) -> Curve:
        """Return the path of the held ends, lowered from the slip on."""
        at = recording.slip_at

        def drive(instants: Floats) -> Floats:
            s = np.clip((instants - at) / DURATION + 0.5, 0, 1)
            step = s * s * (3 - 2 * s)
            ends = path(instants).copy()
            ends[:, 2] -= amplitude[0] * step
            ends[:, 5] -= amplitude[1] * step
            return np.asarray(ends)

        return drive

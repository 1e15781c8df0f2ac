"""Frame timing: each frame's time stamp is the time of its publication, delayed by a share of its processing time.

    y(t_f) = x(t_f - a (d_f - median d)),   |a (d_f - median d)| <= median d

with the interval d_f to the frame before. A stamp that is late by the same time in every frame is a time offset.
Between frames the simulated points follow cubic splines. Frames that come evenly are left as they are.

The amplitude is a, the share of the preceding interval; positive where stamps are late.

Believe it when points are late in frames that come late, at the held row as well. It needs frames that come unevenly.

Source: stamps of a public recording of swung cloth (github Alados5/tfm_matlab), late by 0.88 of the interval before.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from fit.cloth.effect import Effect
from fit.recordings.recording import Recording
from fit.recordings.timing import uneven_intervals
from formats.arrays import Floats


@dataclass(frozen=True)
class FrameTiming(Effect):
    """Share of the interval to the frame before by which a frame's stamp is late."""

    name: ClassVar[str] = "frame_timing"
    title: ClassVar[str] = "stamps that say when frames were published"
    acts_on: ClassVar[str] = "measurement"
    unit: ClassVar[str] = "1"
    low: ClassVar[float] = -0.5  # our choice: half an interval beyond no delay
    high: ClassVar[float] = 1.5  # our choice: half an interval beyond a whole one
    typical: ClassVar[float] = 0.5  # our choice: half an interval; the source shows 0.88
    # Other work of the computer between two frames. Our choice: laws may leave 0.09 of a gap; half and double untried.
    law_spread: ClassVar[float] = 0.1

    def observe(self, points: Floats, recording: Recording, amplitude: Floats) -> Floats:
        """Return the points at the true exposure times of the frames."""
        from scipy.interpolate import CubicSpline

        late = amplitude[0] * uneven_intervals(recording.time)
        if not late.any() or not np.isfinite(points).all():
            return points
        most = float(np.median(np.diff(recording.time)))
        instants = recording.time - np.clip(late, -most, most)
        inside = np.clip(instants, recording.time[0], recording.time[-1])
        return np.asarray(CubicSpline(recording.time, points)(inside))

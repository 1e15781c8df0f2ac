"""Filter lag: the tracker smooths its points in time and so runs behind.

    tau dy/dt + y = x,    y(0) = x(0)

This is a first-order low-pass of the points, exact for points that move in straight lines between frames. The filter
delays the points by tau. The simulation therefore follows a hanger path that is later by tau, as for a clock offset. An
observer then feels no pull from the delay. The rest of the filter acts on the simulated x: y(t) = (h * x)(t + tau).
Cubic splines give x between frames.

The amplitude is tau, never negative.

Believe it when the points run behind and quick motion is also smaller than in the simulation. A clock offset shifts the
motion without making it smaller.

Source: A. V. Oppenheim, A. S. Willsky, "Signals and Systems" (1997), section 6.5.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from fit.cloth.effect import Curve, Effect
from fit.recordings.recording import Recording
from formats.arrays import Floats


@dataclass(frozen=True)
class FilterLag(Effect):
    """Time constant of the tracker's smoothing."""

    name: ClassVar[str] = "filter_lag"
    title: ClassVar[str] = "a tracker that lags"
    acts_on: ClassVar[str] = "measurement"
    unit: ClassVar[str] = "s"
    low: ClassVar[float] = 0.0
    high: ClassVar[float] = 0.2  # our choice: six frames at 30 a second
    typical: ClassVar[float] = 0.02  # our choice: less than a frame at 30 a second
    # Of one pole or of more; the size is that of `Effect`. Two poles leave 0.002 of the squared effect by a lag of
    # 20 ms, and 0.02 by 120 ms. Both are measured on a swing of 0.9 and 2.2 Hz. Laws may leave 0.06.
    law_spread: ClassVar[float] = 0.08

    def drive(self, path: Curve, recording: Recording, amplitude: Floats) -> Curve:
        """Return the path of the held ends as it was tau earlier."""
        return lambda instants: path(instants - amplitude[0])

    def observe(self, points: Floats, recording: Recording, amplitude: Floats) -> Floats:
        """Return the points ahead by tau, behind a first-order low-pass."""
        tau, time = float(amplitude[0]), recording.time
        if tau == 0.0 or not np.isfinite(points).all():
            return points
        ahead = _ahead(time, points, tau)
        seen = ahead.copy()
        for k, dt in enumerate(np.diff(time), start=1):
            left = np.exp(-dt / tau)
            slope = (ahead[k] - ahead[k - 1]) / dt
            # x(t) = x0 + slope t between frames: y = x - slope tau + (y0 - x0 + slope tau) exp(-t / tau)
            seen[k] = ahead[k] - slope * tau + (seen[k - 1] - ahead[k - 1] + slope * tau) * left
        return np.asarray(seen)


def _ahead(time: Floats, points: Floats, tau: float) -> Floats:
    """Return points [m], (frames, points, 3), as they are tau [s] later; beyond the last frame they go straight on."""
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(time, points)
    beyond = np.maximum(time + tau - time[-1], 0.0)
    return np.asarray(spline(time + tau - beyond) + beyond[:, None, None] * spline(time[-1], 1))

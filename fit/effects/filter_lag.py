"""Filter lag: the tracker smooths its points in time and so runs behind.

    tau dy/dt + y = x,    y(0) = x(0)

a first-order low-pass of the simulated points, exact for points that move in straight lines between frames.
Source: A. V. Oppenheim, A. S. Willsky, "Signals and Systems" (1997), section 6.5.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from fit.effects.base import Effect, Floats
from fit.recording import Recording


@dataclass(frozen=True)
class FilterLag(Effect):
    """Time constant of the tracker's smoothing."""

    name: ClassVar[str] = "filter_lag"
    title: ClassVar[str] = "a tracker that lags"
    acts_on: ClassVar[str] = "measurement"
    unit: ClassVar[str] = "s"
    low: ClassVar[float] = 0.0
    high: ClassVar[float] = 0.2
    typical: ClassVar[float] = 0.02
    law_spread: ClassVar[float] = 0.0

    def observe(self, points: Floats, recording: Recording, amplitude: Floats) -> Floats:
        """Return the points behind a first-order low-pass."""
        tau = float(amplitude[0])
        if tau == 0.0:
            return points
        seen = points.copy()
        for k, dt in enumerate(np.diff(recording.time), start=1):
            left = np.exp(-dt / tau)
            slope = (points[k] - points[k - 1]) / dt
            # x(t) = x0 + slope t between frames: y = x - slope tau + (y0 - x0 + slope tau) exp(-t / tau)
            seen[k] = points[k] - slope * tau + (seen[k - 1] - points[k - 1] + slope * tau) * left
        return np.asarray(seen)

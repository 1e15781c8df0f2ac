"""Clock drift: the clock of the points runs at another rate than that of the hanger's markers.

    y(t) = x(t - d t)

Applied like `time_offset`. 50 parts per million are half a millisecond after ten seconds, so that short takes cannot
show an ordinary crystal's drift. Source: quartz oscillators are within 10 to 500 ppm.
"""

from dataclasses import dataclass
from typing import ClassVar

from fit.effects.base import Curve, Effect, Floats
from fit.recording import Recording


@dataclass(frozen=True)
class ClockDrift(Effect):
    """Relative rate of the clocks; positive when the points fall behind."""

    name: ClassVar[str] = "clock_drift"
    title: ClassVar[str] = "clocks that drift apart"
    acts_on: ClassVar[str] = "measurement"
    unit: ClassVar[str] = "1"
    low: ClassVar[float] = -0.03
    high: ClassVar[float] = 0.03
    typical: ClassVar[float] = 0.005
    law_spread: ClassVar[float] = 0.0

    def drive(self, path: Curve, recording: Recording, amplitude: Floats) -> Curve:
        """Return the path of the held ends on the drifting clock."""
        return lambda instants: path(instants * (1.0 - amplitude[0]))

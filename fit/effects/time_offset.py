"""Time offset: the cloth's points carry later time stamps than the hanger's markers.

    y(t) = x(t - tau)

The simulation is shifted, the noisy data never. A cloth whose hanger path is late by tau moves late by tau at every
instant.

The amplitude is tau; positive where the points come late.

Believe it when the whole cloth lags or leads by the same time in slow and in fast motion. Two sensors with clocks of
their own make it likely.

Source: RGBench corrects a camera delay of 59.8 ms in one of its takes.
"""

from dataclasses import dataclass
from typing import ClassVar

from fit.cloth.effect import Curve, Effect
from fit.recordings.recording import Recording
from formats.arrays import Floats


@dataclass(frozen=True)
class TimeOffset(Effect):
    """Delay of the points against the markers; positive when the points come late."""

    name: ClassVar[str] = "time_offset"
    title: ClassVar[str] = "a time offset between markers and points"
    acts_on: ClassVar[str] = "measurement"
    unit: ClassVar[str] = "s"
    low: ClassVar[float] = -0.1  # our choice: as far as `high`
    high: ClassVar[float] = 0.1  # our choice: beyond the 59.8 ms that RGBench corrects
    typical: ClassVar[float] = 0.02  # our choice: less than a frame at 30 a second
    law_spread: ClassVar[float] = 0.0

    def drive(self, path: Curve, recording: Recording, amplitude: Floats) -> Curve:
        """Return the path of the held ends, delayed by tau."""
        return lambda instants: path(instants - amplitude[0])

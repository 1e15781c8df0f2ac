"""Clock drift: the clock of the points runs at another rate than that of the hanger's markers.

    y(t) = x(t - d t)

The points' clock shows s = t / r with r = 1 - d. On that clock the hanger moves along path(r s). Every force of the
cloth is r^2 times as strong, and every damping time 1/r times as long. The air's force is quadratic in the velocity and
stays as it is:

    d2x/ds2 = r^2 F(x, (1/r) dx/ds) / m        gravity, stiffnesses r^2; damping rates r; damping times 1/r

Friction in bending and contact are effects of their own. They are left unscaled, an error of 6 % of the friction at
most.

Without the scaled forces, a free swing would keep its period, while the points show the swing slower by d. A drift of
50 parts per million makes half a millisecond in ten seconds. Short takes therefore cannot show an ordinary crystal's
drift.

The amplitude is d: positive where the points' clock is fast, so that the motion they show lags more and more.

Believe it in long takes alone, where the lag between hanger and cloth grows from beginning to end. A lag that stays
the same is a time offset.

Source: change of variables; quartz oscillators are within 10 to 500 ppm.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from fit.cloth import material as mat
from fit.cloth.effect import Curve, Effect
from fit.recordings.recording import Recording
from formats.arrays import Floats


@dataclass(frozen=True)
class ClockDrift(Effect):
    """Relative rate of the clocks; positive when the points fall behind."""

    name: ClassVar[str] = "clock_drift"
    title: ClassVar[str] = "clocks that drift apart"
    acts_on: ClassVar[str] = "measurement"
    unit: ClassVar[str] = "1"
    low: ClassVar[float] = -0.03  # our choice: as far as `high`
    high: ClassVar[float] = 0.03  # our choice: 60 times the 500 parts per million of quartz; short takes show no less
    typical: ClassVar[float] = 0.005  # our choice: ten times the 500 parts per million of quartz
    law_spread: ClassVar[float] = 0.0

    def drive(self, path: Curve, recording: Recording, amplitude: Floats) -> Curve:
        """Return the path of the held ends on the drifting clock."""
        return lambda instants: path(instants * (1.0 - amplitude[0]))

    def material(self, row: Floats, amplitude: Floats) -> Floats:
        """Return the material row with forces and times as the drifting clock shows them."""
        rate = 1.0 - amplitude[0]
        changed = row.copy()
        changed[mat.GRAVITY_LOG] += 2.0 * np.log(rate)
        changed[[mat.STRETCH, mat.SHEAR, mat.BENDING]] *= rate**2
        changed[mat.VELOCITY] *= rate
        changed[[mat.MEMBRANE_TIME, mat.BENDING_TIME, mat.VISCOSITY]] /= rate
        return np.asarray(changed)

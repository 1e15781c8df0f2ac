"""Gravity tilt: the direction of gravity in the rig's file differs from the true direction.

    g = 9.80665 (sin a_x, sin a_y, -sqrt(1 - sin^2 a_x - sin^2 a_y))        [m/s^2]

Only the simulation's gravity is turned; the measured path of the hanger stays as it was measured.

The amplitude is a_x and a_y; positive turns gravity towards the axis.

Believe it when cloth at rest leans by the same angle in every take and for every weight of cloth. A plumb line settles
the question.

Source: geometry. Hand-levelled sensors are off by 0.2 to 3 degrees (0.0035 to 0.05 rad). The bounds are twice as wide,
for a fit that passes through a wrong size must not stop there. A fitted tilt of 5 degrees is a draught or an unmodelled
force.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from fit.cloth import material as mat
from fit.cloth.effect import Effect
from formats.arrays import Floats


@dataclass(frozen=True)
class GravityTilt(Effect):
    """Angle of true gravity against the rig's, towards x and towards y of the world frame."""

    name: ClassVar[str] = "gravity_tilt"
    title: ClassVar[str] = "tilted gravity"
    acts_on: ClassVar[str] = "measurement"
    unit: ClassVar[str] = "rad"
    low: ClassVar[float] = -0.1  # twice as wide as the source, like `high`
    high: ClassVar[float] = 0.1  # twice the 3 degrees of the source
    typical: ClassVar[float] = 0.03  # our choice: 1.7 degrees, within the source's 0.2 to 3
    law_spread: ClassVar[float] = 0.0
    components: ClassVar[tuple[str, ...]] = ("x", "y")

    def material(self, row: Floats, amplitude: Floats) -> Floats:
        """Return the material row with gravity turned."""
        changed = row.copy()
        changed[mat.TILT_X] += amplitude[0]
        changed[mat.TILT_Y] += amplitude[1]
        return np.asarray(changed)

"""Strain stiffening: the more the cloth is stretched the stiffer it gets.

    S11 = k E11 (1 + a |E11|)        [N/m], S22 alike

The amplitude is a, never negative.

Believe it only where the cloth is jerked hard. Cloth under its own weight stretches by a few thousandths, so that its
stiffness grows by a tenth, and gentle motion shows little of it.

Source: H. Wang, J. O'Brien, R. Ramamoorthi, "Data-driven elastic models for cloth" (SIGGRAPH 2011), section 5. Measured
stiffness grows 5 to 10 times over 15 % strain, an a of 30 to 60.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from fit.cloth import material as mat
from fit.cloth.effect import Effect
from formats.arrays import Floats


@dataclass(frozen=True)
class StrainStiffening(Effect):
    """Relative growth of the stretch stiffness per strain."""

    name: ClassVar[str] = "strain_stiffening"
    title: ClassVar[str] = "strain stiffening"
    acts_on: ClassVar[str] = "cloth"
    unit: ClassVar[str] = "1"
    low: ClassVar[float] = 0.0
    high: ClassVar[float] = 200.0  # our choice: about three times the largest that was measured, 60
    typical: ClassVar[float] = 40.0  # within the 30 to 60 that was measured

    def material(self, row: Floats, amplitude: Floats) -> Floats:
        """Return the material row with stiffening."""
        changed = row.copy()
        changed[mat.STIFFENING] += amplitude[0]
        return np.asarray(changed)

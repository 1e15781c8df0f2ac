"""Shear stiffness: resistance of the cloth to changing the angle between warp and weft.

    S12 = (G + a) Fu . Fv        [N/m]

Many simulators build cloth of warp and weft springs only, which has no shear stiffness. Some base models have a shear
stiffness (`in_base`) and contain this effect already. The fit then finds the shear stiffness, and the diagnosis leaves
this effect out.

The amplitude is a, never negative.

Believe it when the cloth is pulled at an angle to its threads, as between two corners. Cloth that hangs from a
straight edge hardly shears.

Source: St. Venant-Kirchhoff membrane; KES shear tests give 0.2 to 4 gf/(cm deg), that is 11 to 220 N/m per radian.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from fit.cloth import material as mat
from fit.cloth.effect import Effect
from formats.arrays import Floats


@dataclass(frozen=True)
class ShearStiffness(Effect):
    """Additional shear stiffness."""

    name: ClassVar[str] = "shear_stiffness"
    title: ClassVar[str] = "shear stiffness"
    acts_on: ClassVar[str] = "cloth"
    unit: ClassVar[str] = "N/m"
    low: ClassVar[float] = 0.0
    high: ClassVar[float] = 220.0  # the largest of KES shear tests, 4 gf/(cm deg)
    typical: ClassVar[float] = 20.0  # our choice: near the lower end of KES's 11 to 220 N/m
    in_base: ClassVar[str] = "shear_stiffness"

    def material(self, row: Floats, amplitude: Floats) -> Floats:
        """Return the material row with more shear stiffness."""
        changed = row.copy()
        changed[mat.SHEAR] += amplitude[0]
        return np.asarray(changed)

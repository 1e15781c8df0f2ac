"""Bending viscosity: a moment that opposes the rate of bending.

    M = B kappa + eta dkappa/dt        [N], eta = B tau        [N m s]

Some base models have a bending damping time. Such a model contains this effect up to 0.02 s, a loss of 13 % at 1 Hz.
More viscous cloth puts the fitted damping time at its upper bound.

The amplitude is eta per width, never negative.

Believe it when small, quick folds die away sooner than the swing of the whole cloth. The base model's own bending
damping is at its bound then.

Source: Kelvin-Voigt; P. Lahey & G. Heppler, J. Text. Inst. (2004): fabric bending as viscous plus frictional.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from fit.cloth import material as mat
from fit.cloth.effect import Effect
from formats.arrays import Floats


@dataclass(frozen=True)
class BendingViscosity(Effect):
    """Additional viscosity in bending."""

    name: ClassVar[str] = "bending_viscosity"
    title: ClassVar[str] = "bending viscosity"
    acts_on: ClassVar[str] = "cloth"
    unit: ClassVar[str] = "N m s"
    low: ClassVar[float] = 0.0
    high: ClassVar[float] = 2e-5  # our choice: 1.4 s times 1.4e-5 N m, the bending stiffness by default
    typical: ClassVar[float] = 1e-6  # our choice: 0.07 s times that stiffness, beyond the base models' 0.02 s
    in_base: ClassVar[str] = "bending_damping_time"
    goes_beyond_base: ClassVar[bool] = True

    def material(self, row: Floats, amplitude: Floats) -> Floats:
        """Return the material row with a longer bending damping time."""
        changed = row.copy()
        changed[mat.BENDING_TIME] += amplitude[0] / row[mat.BENDING]
        return np.asarray(changed)

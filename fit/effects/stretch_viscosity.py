"""Stretch viscosity: tension that opposes the rate of stretching and shearing.

    S = k (E + tau dE/dt)        [N/m]

The amplitude is the damping time tau that is added to the base model's (which is as good as none).
Source: Kelvin-Voigt solid; W. N. Findley, J. S. Lai, K. Onaran, "Creep and Relaxation of Nonlinear Viscoelastic
Materials" (1976), section 5.3.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from fit.cloth import material as mat
from fit.effects.base import Effect, Floats


@dataclass(frozen=True)
class StretchViscosity(Effect):
    """Damping time of stretch and shear."""

    name: ClassVar[str] = "stretch_viscosity"
    title: ClassVar[str] = "stretch viscosity"
    acts_on: ClassVar[str] = "cloth"
    unit: ClassVar[str] = "s"
    low: ClassVar[float] = 0.0
    high: ClassVar[float] = 3e-3
    typical: ClassVar[float] = 1e-3

    def material(self, row: Floats, amplitude: Floats) -> Floats:
        """Return the material row with a longer membrane damping time."""
        changed = row.copy()
        changed[mat.MEMBRANE_TIME] += amplitude[0]
        return np.asarray(changed)

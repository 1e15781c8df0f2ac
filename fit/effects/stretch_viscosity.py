"""Stretch viscosity: tension that opposes the rate of stretching and shearing.

    S = k (E + z),   theta dz/dt + z = tau dE/dt        [N/m]

This is the standard linear solid: a spring k, and beside it a spring k tau / theta in line with a damper k tau. Strain
that changes slowly against theta gives S = k (E + tau dE/dt), the Kelvin-Voigt solid. At a frequency w the viscosity is
Kelvin-Voigt's over 1 + (w theta)^2. The stiffness k grows by tau theta w^2 / (1 + (w theta)^2).

Theta is 2 ms. A depth camera's frames show no motion beyond 10 Hz. At 10 Hz the viscosity is 1.6 % less, and the
stiffness, at a typical tau of 1 ms, 0.8 % more.

Over a step in which strain changes by dE at an even rate, exactly:
    z <- a z + tau (1 - a) dE / dt,   a = exp(-dt / theta)
The highest frequency w bounds explicit steps. Kelvin-Voigt cloth needs steps below 2 / (w^2 tau). The standard linear
solid bounds the added stiffness instead. Take the leapfrog x_n+1 - 2 x_n + x_n-1 = -dt^2 w^2 (x_n + z_n), with w for
tau = 0. The first solution to grow changes its sign every step. With x_n = (-1)^n the leapfrog is stable for
    dt^2 w^2 (1 + (2 tau / dt) tanh(dt / (2 theta))) < 4,   hence for   dt < 2 / (w sqrt(1 + tau / theta))

The amplitude is tau, never negative.

Believe it when jerks along the threads die away within some hundredths of a second. A depth camera hardly shows this
motion.

Source: W. N. Findley, J. S. Lai, K. Onaran, "Creep and Relaxation of Nonlinear Viscoelastic Materials" (1976), sections
5.3 to 5.6; the exact step: J. C. Simo, T. J. R. Hughes, "Computational Inelasticity" (1998), section 10.3.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from fit.cloth import material as mat
from fit.cloth.effect import Effect
from formats.arrays import Floats


@dataclass(frozen=True)
class StretchViscosity(Effect):
    """Viscosity of stretch and shear over their stiffness."""

    name: ClassVar[str] = "stretch_viscosity"
    title: ClassVar[str] = "stretch viscosity"
    acts_on: ClassVar[str] = "cloth"
    unit: ClassVar[str] = "s"
    low: ClassVar[float] = 0.0
    high: ClassVar[float] = 3e-3  # our choice: half as much again as theta
    typical: ClassVar[float] = 1e-3  # our choice: half of theta
    differs_by_solver: ClassVar[bool] = True

    def material(self, row: Floats, amplitude: Floats) -> Floats:
        """Return the material row with viscosity."""
        changed = row.copy()
        changed[mat.VISCOSITY] += amplitude[0]
        return np.asarray(changed)

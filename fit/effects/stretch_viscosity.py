"""Stretch viscosity: tension that opposes the rate of stretching and shearing.

    S = k (E + z),   theta dz/dt + z = tau dE/dt        [N/m]

A spring, and beside it a spring k tau / theta with a damper k tau behind it: the standard linear solid. The amplitude
is tau. Where strain changes slowly against theta it is S = k (E + tau dE/dt), the Kelvin-Voigt solid; at a frequency w
the viscosity is that one's over 1 + (w theta)^2, and k grows by tau theta w^2 / (1 + (w theta)^2). Theta is 2 ms, so
that at 10 Hz, beyond which a depth camera's frames show no motion, viscosity is 1.6 % less, and stiffness, at a typical
tau of 1 ms, 0.8 % more.

Over a step in which strain changes by dE at an even rate, exactly:
    z <- a z + tau (1 - a) dE / dt,   a = exp(-dt / theta)
Explicit steps are bounded by the highest frequency w. With Kelvin-Voigt they have to be below 2 / (w^2 tau); here all
that tau can add is stiffness. Of the leapfrog x_n+1 - 2 x_n + x_n-1 = -dt^2 w^2 (x_n + z_n), with w for tau = 0, the
solution that grows first changes its sign every step; put in x_n = (-1)^n, it is stable for
    dt^2 w^2 (1 + (2 tau / dt) tanh(dt / (2 theta))) < 4,   hence for   dt < 2 / (w sqrt(1 + tau / theta))

The amplitude is tau, never negative.

Believe it when jerks along the threads die away within some hundredths of a second. A depth camera sees almost
nothing of such motion.

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
    high: ClassVar[float] = 3e-3
    typical: ClassVar[float] = 1e-3
    differs_by_solver: ClassVar[bool] = True

    def material(self, row: Floats, amplitude: Floats) -> Floats:
        """Return the material row with viscosity."""
        changed = row.copy()
        changed[mat.VISCOSITY] += amplitude[0]
        return np.asarray(changed)

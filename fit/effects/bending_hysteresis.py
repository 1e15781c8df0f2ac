"""Bending hysteresis: threads rub on each other when cloth bends, so that the moment depends on the bending history.

    dM/dkappa = s_0 (1 - sign(dkappa) M / M_max),     s_0 = M_max / kappa_ref

This is the Dahl model with exponent 1. M_max [N] is the largest frictional moment per width, half of KES's 2HB. The
friction builds up over the change of curvature kappa_ref. M adds to the elastic moment B kappa.

The amplitude is M_max, never negative.

Believe it when cloth comes to rest in shapes that depend on how it was bent before. Viscosity ends with the motion;
friction stays.

Source: E. Miguel et al., "Modeling and estimation of internal friction in cloth" (SIGGRAPH Asia 2013), section 4;
P. R. Dahl, "A solid friction model" (1968). KES: 2HB of apparel is 1e-4 to 1e-3 N.
"""

from dataclasses import dataclass
from typing import ClassVar

from fit.cloth.effect import Effect
from formats.arrays import Floats


@dataclass(frozen=True)
class BendingHysteresis(Effect):
    """Friction in bending; the amplitude is the largest frictional moment per width."""

    name: ClassVar[str] = "bending_hysteresis"
    title: ClassVar[str] = "friction in bending"
    acts_on: ClassVar[str] = "cloth"
    unit: ClassVar[str] = "N"
    low: ClassVar[float] = 0.0
    high: ClassVar[float] = 2e-3  # our choice: four times the largest of apparel, half of 2HB's 1e-3 N (KES)
    typical: ClassVar[float] = 2e-4  # our choice: within apparel's 5e-5 to 5e-4 N, half of 2HB (KES)
    # Laws in which threads begin to slip one after the other. Two elements that slide at 4 and 16 1/m leave 0.21 of the
    # squared moment at curvatures of 2 1/m (measured). At 5 to 20 1/m they leave 0.07 to 0.09. Laws may leave 0.2.
    law_spread: ClassVar[float] = 0.15
    bends: ClassVar[bool] = True

    def friction_moment(self, amplitude: Floats) -> float:
        """Return the largest frictional moment per width [N]."""
        return float(amplitude[0])

"""Air drag: each face is slowed by the still air that it pushes aside.

    f = -1/2 rho c A |v_n| v_n n        [N], v_n = v . n

with the velocity v of the face, its unit normal n and its area A. Only motion along the normal counts. Air pushes
harder on a plate that leans into the flow. Duchemin's law gives the factor 2 c sin a / (1 + sin^2 a) for the angle of
attack a. At small angles the difference is an `air_lift` of 2 c.

The amplitude is c, never negative: the force opposes the motion.

Swayed real cloth may follow a law between v and v^2 (Mao, Xia & Wang). The best law c v |v| of a harmonic swing leaves
sqrt(1 - 512 / (54 pi^2)) = 0.2 of a force that goes with v. Over swings whose speeds stand as 1 to 3 it leaves 0.29.
Three deviations of `law_spread` cover that (`fit.gap.evidence`).

Believe it when fast swings die away more quickly than slow ones. The motion must push the cloth broadside through the
air. Linear damping takes the same share of every swing.

Source: S. F. Hoerner, "Fluid-Dynamic Drag" (1965), chapter 3. A square plate across the flow has c = 1.1 to 1.3, and a
long strip up to 2.0. Porous cloth has less. Duchemin's law: S. P. Langley, "Experiments in Aerodynamics" (1891),
chapter 3. A. Mao, M. Xia, H. Wang, "Evaluating simplified air force models for cloth simulation".
"""

from dataclasses import dataclass
from typing import ClassVar

import taichi as ti

from fit.cloth.effect import Effect
from fit.cloth.lanes import magnitude
from formats.nature import AIR_DENSITY


@ti.func
def _normal_drag(c, unused, unused_too, vx, vy, vz, nx, ny, nz, area):
    normal_speed = vx * nx + vy * ny + vz * nz
    size = -0.5 * AIR_DENSITY * c * area * magnitude(normal_speed) * normal_speed
    return size * nx, size * ny, size * nz


@dataclass(frozen=True)
class AirDrag(Effect):
    """Quadratic normal drag in still air; the amplitude is the drag coefficient."""

    name: ClassVar[str] = "air_drag"
    title: ClassVar[str] = "air drag"
    acts_on: ClassVar[str] = "air"
    unit: ClassVar[str] = "1"
    low: ClassVar[float] = 0.0
    high: ClassVar[float] = 3.0  # our choice: half as much again as a long strip's 2.0 (Hoerner)
    typical: ClassVar[float] = 1.2  # a square plate's 1.1 to 1.3 (Hoerner)
    law_spread: ClassVar[float] = 0.1  # an exponent of the speed from 1 to 2, as the module derives it
    brings: ClassVar[tuple[tuple[str, float], ...]] = (("air_lift", 2.0),)
    face_force: ClassVar = staticmethod(_normal_drag)

"""Air lift: air that flows along the cloth presses it sideways where the cloth leans into the flow.

    f = -1/2 rho c A |v_t| v_n n        [N], v_n = v . n, v_t = v - v_n n

This force is the part of a flat plate's normal force that is linear in the angle of attack. At small angles the normal
force has the coefficient C_N = c sin(angle). So 1/2 rho |v|^2 A C_N = 1/2 rho c A |v| v_n, and |v| is nearly |v_t|
there. The part that is quadratic in v_n is `air_drag`. A thin plate in potential flow has c = 2 pi. Real strips of low
aspect ratio have 2 to 4.

The amplitude is c, never negative.

Believe it when cloth that moves along itself is pushed sideways. Swings in the plane of the cloth show lift. Swings
square to the cloth show drag alone.

Source: J. Katz, A. Plotkin, "Low-Speed Aerodynamics" (2001), section 5.4; S. F. Hoerner, "Fluid-Dynamic Lift" (1975),
chapter 17 (low aspect ratio).
"""

from dataclasses import dataclass
from typing import ClassVar

import taichi as ti

from fit.cloth.effect import Effect
from formats.nature import AIR_DENSITY


@ti.func
def _lift(c, unused, unused_too, vx, vy, vz, nx, ny, nz, area):
    normal_speed = vx * nx + vy * ny + vz * nz
    tx, ty, tz = vx - normal_speed * nx, vy - normal_speed * ny, vz - normal_speed * nz
    size = -0.5 * AIR_DENSITY * c * area * ti.sqrt(tx * tx + ty * ty + tz * tz) * normal_speed
    return size * nx, size * ny, size * nz


@dataclass(frozen=True)
class AirLift(Effect):
    """Normal force from motion along the sheet; the amplitude is the slope of the lift curve."""

    name: ClassVar[str] = "air_lift"
    title: ClassVar[str] = "air lift"
    acts_on: ClassVar[str] = "air"
    unit: ClassVar[str] = "1"
    low: ClassVar[float] = 0.0
    high: ClassVar[float] = 8.0  # our choice: above a thin plate's 2 pi (Katz and Plotkin)
    typical: ClassVar[float] = 2.0  # our choice: of the 2 to 4 of real strips (Hoerner)
    # Lift with one or two cosines of the angle more, as Polhamus has it, is 30 to 50 % less at 45 degrees. Our
    # choice: the middle. Laws may then leave more than any effect may. So twice changes nothing there; at half they may
    # leave 0.36 of a gap.
    law_spread: ClassVar[float] = 0.4
    face_force: ClassVar = staticmethod(_lift)

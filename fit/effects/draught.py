"""Draught: the room's air moves steadily and pushes the cloth.

    f = -1/2 rho c A (|v_n - w_n| (v_n - w_n) - |v_n| v_n) n        [N], w_n = w . n, c = 1.2

the drag in air that moves at w less the drag in still air (which is `air_drag`), so that w = 0 is exactly off.
Source: as `air_drag`; ventilated rooms have 0.05 to 0.5 m/s (ISO 7730, section 6.2, draught rating).
"""

from dataclasses import dataclass
from typing import ClassVar

import taichi as ti

from fit.cloth.lanes import magnitude
from fit.effects.air_drag import AIR_DENSITY
from fit.effects.base import Effect

PLATE = 1.2  # 1, drag coefficient of a plate across the flow


@ti.func
def _push(wx, wy, wz, vx, vy, vz, nx, ny, nz, area):
    still = vx * nx + vy * ny + vz * nz
    moving = still - (wx * nx + wy * ny + wz * nz)
    size = -0.5 * AIR_DENSITY * PLATE * area * (magnitude(moving) * moving - magnitude(still) * still)
    return size * nx, size * ny, size * nz


@dataclass(frozen=True)
class Draught(Effect):
    """Steady wind, as a vector in the world frame."""

    name: ClassVar[str] = "draught"
    title: ClassVar[str] = "a draught"
    acts_on: ClassVar[str] = "air"
    unit: ClassVar[str] = "m/s"
    low: ClassVar[float] = -1.0
    high: ClassVar[float] = 1.0
    typical: ClassVar[float] = 0.3
    components: ClassVar[tuple[str, ...]] = ("x", "y")
    face_force: ClassVar = staticmethod(_push)

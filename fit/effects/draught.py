"""Draught: the room's air moves steadily and pushes the cloth.

    f = -(P(v - w) - P(v)) n        [N],   P(u) = 1/2 rho c A |u| u_n 2 |u|^2 / (|u|^2 + u_n^2),   u_n = u . n, c = 1.2

The force is the pressure in air that moves at w, less the pressure in still air. The pressure in still air is
`air_drag`, so w = 0 is exactly off. P is the pressure on a plate at any angle a to the flow, sin a = u_n / |u|.
Duchemin's law gives a leaning plate 2 sin a / (1 + sin^2 a) of the pressure on a plate across the flow. A law of the
normal velocity alone would miss most of a draught on cloth that swings along itself. On such cloth the push grows with
|v| w_n, not with w_n^2.

The amplitude is the wind w [m/s] along the level axes x and y; positive blows along the axis.

Believe it when cloth that should hang straight leans to one side in every take. A tilt of gravity leans heavy and
light cloth alike; a draught leans light cloth more.

Source: as `air_drag`. Duchemin's law and experiments that agree with it: S. P. Langley, "Experiments in Aerodynamics"
(1891), chapters 3 and 4. Ventilated rooms have 0.05 to 0.5 m/s (ISO 7730, section 6.2, draught rating).
"""

from dataclasses import dataclass
from typing import ClassVar

import taichi as ti

from fit.cloth.effect import Effect
from formats.nature import AIR_DENSITY

PLATE = 1.2  # 1, drag coefficient of a plate across the flow: a square plate's 1.1 to 1.3 (Hoerner, as in `air_drag`)


STILL_AIR = 1e-12  # m^2/s^2: still air presses on nothing


@ti.func
def _pressure(ux, uy, uz, nx, ny, nz):
    along = ux * nx + uy * ny + uz * nz
    square = ux * ux + uy * uy + uz * uz
    return 2.0 * ti.sqrt(square) * along * square / (square + along * along + STILL_AIR)


@ti.func
def _push(wx, wy, wz, vx, vy, vz, nx, ny, nz, area):
    moving, still = _pressure(vx - wx, vy - wy, vz - wz, nx, ny, nz), _pressure(vx, vy, vz, nx, ny, nz)
    size = -0.5 * AIR_DENSITY * PLATE * area * (moving - still)
    return size * nx, size * ny, size * nz


@dataclass(frozen=True)
class Draught(Effect):
    """Steady wind, as a vector in the world frame."""

    name: ClassVar[str] = "draught"
    title: ClassVar[str] = "a draught"
    acts_on: ClassVar[str] = "air"
    unit: ClassVar[str] = "m/s"
    low: ClassVar[float] = -1.0  # our choice: as far as `high`
    high: ClassVar[float] = 1.0  # our choice: twice the strongest draught of ventilated rooms (ISO 7730)
    typical: ClassVar[float] = 0.3  # our choice: within the 0.05 to 0.5 m/s of ventilated rooms (ISO 7730)
    # Plates at an angle, gusts; the push grows with the square of the wind. Hoerner's plate in place of Duchemin's
    # leaves 0.001 of the squared push (measured). Gusts of 15 % leave (2 x 0.15)^2 / 2 = 0.045. Our choice: eight times
    # both, 0.36 of a gap, at half 0.09. At twice laws may leave more than a gap.
    law_spread: ClassVar[float] = 0.2
    components: ClassVar[tuple[str, ...]] = ("x", "y")
    face_force: ClassVar = staticmethod(_push)

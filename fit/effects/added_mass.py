"""Added mass: air that is carried along with the cloth's normal motion has inertia.

    (m I + m_a n n') a = F,   m_a = mu A s(x, y),   s = sqrt(1 - xi^2) sqrt(1 - eta^2)

for a node of area A. The added mass per area mu [kg/m^2] holds in the middle of the sheet. It falls to zero at the
edges, like the potential flow about a plate. The places xi and eta run from -1 to 1 across and along the sheet. A rigid
strip of chord L has mu = pi rho_air L / 4 on average.

The amplitude is mu, never negative.

Believe it when light cloth turns round more slowly than its weight explains, in swings of any speed. Drag grows with
speed, added mass does not. In takes of one speed the two are nearly collinear.

Source: C. E. Brennen, "A Review of Added Mass and Fluid Inertial Forces" (1982), table of two-dimensional bodies.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from fit.cloth.effect import Effect
from fit.cloth.mesh import ClothMesh
from formats.arrays import Floats


@dataclass(frozen=True)
class AddedMass(Effect):
    """Inertia of the air along the normal; the amplitude is the added mass per area in the middle."""

    name: ClassVar[str] = "added_mass"
    title: ClassVar[str] = "the air's added mass"
    acts_on: ClassVar[str] = "air"
    unit: ClassVar[str] = "kg/m^2"
    low: ClassVar[float] = 0.0
    high: ClassVar[float] = 0.6  # our choice: a rigid strip 0.63 m wide has as much
    typical: ClassVar[float] = 0.1  # our choice: a rigid strip 0.1 m wide has as much
    adds_mass: ClassVar[bool] = True

    def added_mass(self, mesh: ClothMesh, amplitude: Floats) -> Floats:
        """Return the mass that moves along with each node's normal motion [kg], (nodes,)."""
        middle, half = (mesh.rest.max(0) + mesh.rest.min(0)) / 2, np.ptp(mesh.rest, axis=0) / 2
        place = np.clip((mesh.rest - middle) / half, -1, 1)
        return np.asarray(amplitude[0] * mesh.node_area * np.sqrt(np.prod(1 - place**2, axis=1)))

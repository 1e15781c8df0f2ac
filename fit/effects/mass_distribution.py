"""Mass distribution: the cloth is heavier towards one side or towards the bottom.

    rho(x, y) = rho (1 + a_x xi + a_y eta),   xi, eta from -1 to 1 across and downwards

at unchanged total mass (the garment was weighed as a whole).

The amplitude is a_x and a_y; positive is heavier on the side of +x, and towards the bottom.

Believe it when the cloth twists as it swings, or lags more at one side. Heavy markers on light cloth make such a
slope.

Source: conservation of the weighed mass; markers of 0.05 to 0.3 g each make 10 to 40 % of a swatch.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from fit.cloth.effect import Effect
from fit.cloth.mesh import ClothMesh
from formats.arrays import Floats

# Of its mass that every node keeps. Our choice: the step is then 0.32 times as long, and at half 0.22 times. At twice,
# slopes whose sum is beyond 0.8 would be cut.
LEAST_MASS = 0.1


@dataclass(frozen=True)
class MassDistribution(Effect):
    """Relative slope of the areal density across and down the garment."""

    name: ClassVar[str] = "mass_distribution"
    title: ClassVar[str] = "uneven mass"
    acts_on: ClassVar[str] = "cloth"
    unit: ClassVar[str] = "1"
    low: ClassVar[float] = -0.8  # our choice: as far as `high`
    high: ClassVar[float] = 0.8  # our choice: along one axis the light side keeps a fifth of the density
    typical: ClassVar[float] = 0.3  # our choice: within the 10 to 40 % that markers make of a swatch
    components: ClassVar[tuple[str, ...]] = ("across", "down")

    def node_mass(self, mass: Floats, mesh: ClothMesh, amplitude: Floats) -> Floats:
        """Return the nodes' masses [kg], (nodes,), tilted across and down."""
        if not amplitude.any():
            return mass
        middle, half = (mesh.rest.max(0) + mesh.rest.min(0)) / 2, np.ptp(mesh.rest, axis=0) / 2
        place = (mesh.rest - middle) / half * [1.0, -1.0]
        tilted = mass * np.maximum(1 + place @ amplitude, LEAST_MASS)
        return np.asarray(tilted * (mass.sum() / tilted.sum()))

"""Hem: cloth turned up and sewn along the bottom edge makes the edge heavier than the rest.

    m_i = rho' a_i + mu l_i,        rho' = rho - mu L / A

with the extra mass per length mu [kg/m], the node's share l_i of the bottom edge, and the edge's length L. The garment
was weighed as a whole, so the rest loses the mass that the hem gains.

The amplitude is mu, never negative.

Believe it when the bottom edge hangs straighter than the rest, and the air slows it less. Look at the garment: a hem
can be seen and weighed.

Source: conservation of the weighed mass; sizes (1 to 3 times the cloth over 10 to 30 mm) from tailoring practice.
"""

from dataclasses import dataclass
from typing import ClassVar

from fit.cloth.effect import Effect
from fit.cloth.mesh import ClothMesh
from formats.arrays import Floats

LARGEST_MASS_SHARE = 0.8  # of the garment's mass that may sit in the hem, so that every node keeps some mass


@dataclass(frozen=True)
class Hem(Effect):
    """Extra mass along the bottom edge at unchanged total weight."""

    name: ClassVar[str] = "hem"
    title: ClassVar[str] = "a heavier hem"
    acts_on: ClassVar[str] = "cloth"
    unit: ClassVar[str] = "kg/m"
    low: ClassVar[float] = 0.0
    high: ClassVar[float] = 0.05  # our choice: about three times the heaviest of tailoring, see `typical`
    typical: ClassVar[float] = 0.01  # our choice: 1 to 3 times 0.2 kg/m^2 over 10 to 30 mm is 0.002 to 0.018
    # A hem is stiffer as well. Our choice: laws may leave 0.13 of a gap; half and double were not tried.
    law_spread: ClassVar[float] = 0.12

    def regions(self, amplitude: Floats) -> tuple[str, ...]:
        """Return the whole bottom edge."""
        return ("bottom left", "bottom centre", "bottom right")

    def node_mass(self, mass: Floats, mesh: ClothMesh, amplitude: Floats) -> Floats:
        """Return the nodes' masses [kg], (nodes,), with the hem's share moved to the bottom edge."""
        if amplitude[0] == 0.0:
            return mass
        total, length = float(mass.sum()), float(mesh.hem_length.sum())
        in_hem = min(float(amplitude[0]) * length, LARGEST_MASS_SHARE * total)
        return mass * (1.0 - in_hem / total) + mesh.hem_length * (in_hem / length)

"""What an effect is: a piece of physics or measurement that the base model leaves out and that can be switched on.

An effect has one amplitude; 0 is exactly off. It acts through hooks, each with a do-nothing default:
`face_force` in the step, `node_mass` on the mass of the nodes, `held_times` on the clock of the hanger's path.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from fit.cloth.mesh import ClothMesh

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Effect:
    """One unmodelled effect: name, unit, physical range, typical size and hooks."""

    name: ClassVar[str]
    title: ClassVar[str]
    acts_on: ClassVar[str]  # "cloth", "boundary", "air" or "measurement"
    unit: ClassVar[str]
    low: ClassVar[float]
    high: ClassVar[float]
    typical: ClassVar[float]
    face_force: ClassVar[Callable[..., Any] | None] = None

    def node_mass(self, mass: Floats, mesh: ClothMesh, amplitude: float) -> Floats:
        """Return the nodes' masses [kg], (nodes,), with this effect."""
        return mass

    def held_times(self, times: Floats, amplitude: float) -> Floats:
        """Return the instants [s] of the hanger's path that drive the cloth at `times` [s]."""
        return times

    @property
    def is_one_sided(self) -> bool:
        """Whether physics allows only amplitudes of one sign."""
        return self.low >= 0.0

    def stiffest(self, areal_density: float, mesh: ClothMesh, amplitude: float) -> float:
        """Return the factor by which this effect lowers the lightest node's mass (for the stable step)."""
        mass = areal_density * mesh.node_area
        return float(np.min(self.node_mass(mass, mesh, amplitude) / mass))

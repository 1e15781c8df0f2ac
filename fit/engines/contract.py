"""Name the one question that a fit asks of a simulator: the tracked points for vectors of parameters.

Both published methods claim that any simulator will do. An engine is made for one recording and one method. Its own
cloth gives the method's numbers their meaning.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from fit.cloth.effect import Effect
from fit.cloth.model import Resolution
from fit.cloth.simulator import Simulator
from fit.methods import Parameterisation
from fit.recordings.recording import Recording
from formats.arrays import Floats


class Engine(Protocol):
    """A simulator of one recording for one method."""

    @property
    def version(self) -> str:
        """Return the version of the simulator, empty where Hangtime itself simulates."""
        ...

    def points(self, vectors: Floats) -> Floats:
        """Return the points [m], (candidates, frames, points, 3), in the recording's world frame.

        vectors, (candidates, parameters), the method's own and then the effects'; NaN for a candidate that blew up.
        """
        ...


EngineMaker = Callable[[Recording, Parameterisation, tuple[Effect, ...], Resolution], Engine]


class OwnEngine:
    """Hangtime's own cloth behind the contract; its version is that of the physics (`fit.provenance`)."""

    version = ""

    def __init__(
        self, recording: Recording, method: Parameterisation, effects: tuple[Effect, ...], resolution: Resolution
    ) -> None:
        self.simulator = Simulator(recording, effects, resolution=resolution)
        self._method = method
        self._density = recording.garment.mass_kg / self.simulator.mesh.area

    def points(self, vectors: Floats) -> Floats:
        """Simulate the vectors' SI materials side by side."""
        count = len(self._method.parameters)
        materials = self._method.to_materials(vectors[:, :count], self._density)
        return self.simulator.run(materials, vectors[:, count:]).points

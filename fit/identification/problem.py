"""The least squares problem of a fit: residuals of tracked points as a function of the parameters."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from fit.cloth.effect import Effect
from fit.cloth.model import Resolution
from fit.methods import Parameterisation
from fit.observer.residuals import Observer
from fit.recordings.recording import Recording, Windows
from fit.search.least_squares import BoundedSpace
from formats.arrays import Floats

Distances = Callable[[list[Floats]], Floats]


class ObservedProblem:
    """Residuals of recordings as a function of a method's parameters and the amplitudes of effects."""

    def __init__(
        self,
        recordings: list[Recording],
        method: Parameterisation,
        effects: tuple[Effect, ...],
        space: BoundedSpace,
        resolution: Resolution,
        *,
        windows: Windows | None = None,
        distances: Distances | None = None,
    ) -> None:
        """Prepare the observer of the recordings, and the simulation of each of them.

        - `windows`: the observer's pull acts only inside these stretches of time
        - `distances`: returns D [m], (candidates,), of free rollouts' points, (candidates, frames, points, 3) [m] a
          take
        """
        cut = [dataclasses.replace(recording, windows=windows) for recording in recordings]
        self.free = Observer(cut, method, effects, frequency=0.0, resolution=resolution)
        self.space = space
        self.count = len(method.parameters)
        self._distances = distances

    def simulate(self, vectors: Floats, pull: float) -> tuple[Floats, Floats]:
        """Return residuals, (candidates, numbers), not finite after a blow-up, and D [m], (candidates,) or empty."""
        observer = self.free.with_frequency(pull)
        points = observer.trajectories(vectors[:, : self.count], vectors[:, self.count :])
        residuals = observer.sound_residuals_of(points)
        is_free = pull == 0 and self._distances is not None
        return residuals, self._distances(points) if is_free and self._distances else np.zeros(0)

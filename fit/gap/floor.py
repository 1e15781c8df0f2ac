"""The noise floor: the error that would be left if the model were perfect.

Simulation-extrapolation: add the estimated noise to the data once more and score again with the same parameters; the
growth of the squared error is the noise's own share, as seen by the whole pipeline:

    floor^2 = E^2(one more) - E^2(0)

The noise of each point is the larger of what the take states and what sixth differences show.
Source: J. R. Cook & L. A. Stefanski, "Simulation-extrapolation estimation ...", JASA 89 (1994).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fit.gap.observer import Observer
from fit.recording import Recording, noise_of

Floats = NDArray[np.float64]

REPLICAS = 3
SLOWEST_RATE = 20.0  # frames/s: below, swings themselves show in sixth differences


def point_noise(recording: Recording) -> Floats:
    """Standard deviation per axis of each point [m], (points,)."""
    stated = recording.point_sd
    rate = (len(recording.time) - 1) / recording.duration
    if rate < SLOWEST_RATE:
        return stated
    seen = np.array(
        [
            np.sqrt(np.mean([noise_of(recording.points[recording.valid[:, k], k, c]) ** 2 for c in range(3)]))
            if recording.valid[:, k].sum() > 10
            else 0.0
            for k in range(recording.points.shape[1])
        ]
    )
    return np.asarray(np.maximum(stated, seen))


def noise_floor(
    observer: Observer, vector: Floats, amplitudes: Floats, rng: np.random.Generator
) -> tuple[float, float]:
    """Return the noise floor of the observer's error [mm] and its standard error over replicas."""
    before = float(observer.in_mm(observer.residuals(vector[None], amplitudes[None])[0])) ** 2
    grown = []
    for _ in range(REPLICAS):
        noisy = [
            r.with_points(r.points + rng.normal(size=r.points.shape) * point_noise(r)[:, None])
            for r in observer.recordings
        ]
        again = Observer(
            noisy,
            observer.parameterisation,
            observer.effects,
            frequency=observer.frequency,
            resolution=observer.resolution,
        )
        grown.append(float(again.in_mm(again.residuals(vector[None], amplitudes[None])[0])) ** 2 - before)
    floors = np.sqrt(np.maximum(grown, 0.0))
    return float(floors.mean()), float(floors.std(ddof=1) / np.sqrt(REPLICAS))

"""Residuals of the simulator run as an observer: weakly pulled to the measured points, so that chaos cannot grow.

    pull = w^2 (y - x) + 2 zeta w (ydot - v),   w = 2 pi f, zeta = 1        [m/s^2]

With a perfect model and no noise the pull is zero; what it needs is the missing force. f = 0 is a free rollout.
Residuals are y - x at the frames, divided by each point's standard deviation. A constant offset of each point (a
silhouette tracker's corners sit a little inside the true ones) is a nuisance of the measurement and is taken out:
the mean over the take is removed from data and signatures alike.
Source: D. G. Luenberger, "An introduction to observers", IEEE TAC 16 (1971); synchronisation of chaotic models,
H. D. I. Abarbanel et al., "Dynamical state and parameter estimation", SIAM J. Appl. Dyn. Syst. 8 (2009).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.cloth.simulator import Resolution, Simulator
from fit.effects.base import Effect
from fit.parameterisations import Parameterisation
from fit.recording import Recording

Floats = NDArray[np.float64]

BLOCK = 0.5  # s: residuals further apart than half a swing count as independent
LOST = 1e3  # standard deviations that a candidate is charged per number when it blew up


@dataclass(frozen=True)
class Layout:
    """Where each number of a stacked residual vector comes from; all arrays (numbers,)."""

    take: NDArray[np.int64]
    block: NDArray[np.int64]
    frame: NDArray[np.int64]
    point: NDArray[np.int64]
    axis: NDArray[np.int64]
    sd: Floats


class Observer:
    """Evaluate the residuals of many candidates on one or more recordings."""

    def __init__(
        self,
        recordings: list[Recording],
        parameterisation: Parameterisation,
        effects: tuple[Effect, ...],
        *,
        frequency: float,
        resolution: Resolution | None = None,
    ) -> None:
        self.recordings, self.parameterisation, self.effects = recordings, parameterisation, effects
        self.frequency = frequency
        self.resolution = resolution or Resolution()
        self._simulators = [Simulator(r, effects, resolution=self.resolution) for r in recordings]
        self.densities = [
            r.garment.mass_kg / float(s.mesh.area.sum()) for r, s in zip(recordings, self._simulators, strict=True)
        ]
        self.layout = _layout(recordings)
        self.mesh = self._simulators[0].mesh

    @property
    def simulations(self) -> int:
        """Simulations run so far."""
        return sum(s.simulations for s in self._simulators)

    def with_frequency(self, frequency: float) -> Observer:
        """Return the same observer at another frequency [Hz]; simulators are shared."""
        other = object.__new__(Observer)
        other.__dict__.update(self.__dict__)
        other.frequency = frequency
        return other

    def trajectories(self, vectors: Floats, amplitudes: Floats, *, frequency: float | None = None) -> list[Floats]:
        """Simulated points per recording, each (candidates, frames, points, 3) [m]."""
        hertz = self.frequency if frequency is None else frequency
        return [
            s.run(self.parameterisation.to_materials(vectors, rho), amplitudes, observer_hz=hertz).points
            for s, rho in zip(self._simulators, self.densities, strict=True)
        ]

    def residuals(self, vectors: Floats, amplitudes: Floats) -> Floats:
        """Whitened residuals, (candidates, numbers), in the order of `layout`."""
        parts = []
        for recording, simulated in zip(self.recordings, self.trajectories(vectors, amplitudes), strict=True):
            apart = recording.points - simulated
            apart = apart - np.nanmean(apart, axis=1, keepdims=True) if np.isfinite(apart).any() else apart
            scaled = apart / _deviations(recording)[:, None]
            parts.append(scaled[:, recording.valid].reshape(len(vectors), -1))
        whole = np.concatenate(parts, axis=1)
        return np.where(np.isfinite(whole), np.clip(whole, -LOST, LOST), LOST)

    def in_mm(self, residuals: Floats) -> Floats:
        """Root mean square distance of a point [mm] from whitened residuals, (..., numbers) -> (...,)."""
        return np.asarray(1e3 * np.sqrt(3 * ((residuals * self.layout.sd) ** 2).mean(-1)))


def _deviations(recording: Recording) -> Floats:
    """Standard deviation per point [m], never below a tenth of a millimetre."""
    return np.maximum(recording.point_sd, 1e-4)


def _layout(recordings: list[Recording]) -> Layout:
    columns: list[list[NDArray[np.int64]]] = [[], [], [], [], []]
    deviations = []
    first_block = 0
    for number, recording in enumerate(recordings):
        frame, point = np.nonzero(recording.valid)
        frame, point = np.repeat(frame, 3), np.repeat(point, 3)
        block = (recording.time[frame] / BLOCK).astype(np.int64) + first_block
        first_block = int(block.max()) + 1
        axis = np.tile(np.arange(3), len(frame) // 3)
        for column, values in zip(columns, (np.full(len(frame), number), block, frame, point, axis), strict=True):
            column.append(values)
        deviations.append(_deviations(recording)[point])
    take, block, frame, point, axis = (np.concatenate(c) for c in columns)
    return Layout(take, block, frame, point, axis, np.concatenate(deviations))

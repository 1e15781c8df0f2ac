"""An observer with residuals linear in parameters and amplitudes, for figures worked by hand."""

from __future__ import annotations

import dataclasses

import numpy as np

from fit.cloth.effect import amplitudes_of, columns_of
from fit.effects import LIBRARY
from fit.gap.fitting import Fitted
from fit.methods import SI
from fit.observer.residuals import Layout

FRAMES, POINTS, IN_BLOCK = 60, 6, 5


def layout_of(frames=FRAMES, points=POINTS, in_block=IN_BLOCK):
    """One take, every point judged in every frame, without means and edges; millimetre noise."""
    frame, point = (a.ravel() for a in np.mgrid[:frames, :points])
    frame, point = np.repeat(frame, 3), np.repeat(point, 3)
    count = len(frame)
    return Layout(
        take=np.zeros(count, int), block=frame // in_block, frame=frame, point=point,
        axis=np.tile(np.arange(3), count // 3),
        sd=np.full(count, 1e-3), is_judged=np.ones(count, bool), is_edge=np.zeros(count, bool),
        static_of=np.full(count, -1),
    )  # fmt: skip


class LinearObserver:
    """Residual r = missed + J (theta - theta_0) + sum of signatures times amplitudes, in noise's deviations."""

    parameterisation = SI

    def __init__(self, missed, jacobian, signatures, *, effects=LIBRARY, layout=None):
        """signatures: {effect: rows per unit, (components, numbers)}; other effects move nothing."""
        self.layout = layout or layout_of()
        self.missed, self.jacobian, self.effects = missed, jacobian, effects
        self.library = {effect.name: effect for effect in effects}
        self.columns = dict(zip(self.library, columns_of(effects), strict=True))
        self.rows = np.zeros((len(self.off), len(missed)))
        for name, rows in signatures.items():
            self.rows[self.columns[name]] = rows
        self.frequency, self.recordings = 0.0, [Recorded()]

    @property
    def off(self):
        return amplitudes_of(self.effects)

    def residuals(self, vectors, amplitudes):
        return self.missed + (vectors - SI.initial) @ self.jacobian.T + amplitudes @ self.rows

    def in_mm(self, residuals):
        return np.sqrt(3 * (residuals**2).mean(-1))

    def by_place(self, values):
        grid = np.full((FRAMES, POINTS, 3), np.nan)
        grid[self.layout.frame, self.layout.point, self.layout.axis] = values
        return [grid]

    def fitted(self):
        """A fit that ended at the initial parameters, without any effect."""
        zeros = np.zeros(self.jacobian.shape[1])
        return Fitted(SI.initial, self.off, (), self.missed, self.jacobian, zeros, True)


@dataclasses.dataclass
class Recorded:
    time: np.ndarray = dataclasses.field(default_factory=lambda: np.arange(FRAMES) / 30)

    @property
    def duration(self):
        return float(np.ptp(self.time))


def white(rng, layout=None):
    return rng.normal(size=len((layout or layout_of()).take))


def flat(rows):
    """Rows of every frame, (frames,), as those of every number."""
    return np.asarray(rows, float)[layout_of().frame]

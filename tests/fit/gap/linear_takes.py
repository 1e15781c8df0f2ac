"""Takes with residuals linear in base parameters and amplitudes, without simulation and with known truth."""

from __future__ import annotations

import functools

import numpy as np

from fit.effects import LIBRARY
from fit.gap.fitting import Fitted, fit
from fit.gap.likelihood import shapes_of
from fit.gap.posterior import Search
from fit.methods import SI
from fit.observer.residuals import Observer
from fit.recordings.recording import prepare
from tests.fit.scenes import hung, sheet, swing, take_of

NOISE, MESH = 1e-3, 0.5  # m; mm
NAMES = ("air_drag", "gravity_tilt", "time_offset", "filter_lag", "hem", "draught")


@functools.cache
def swung(frames):
    """A recording of a stiff sheet that follows its hanger."""
    time = np.arange(frames) / 15.0
    garment, displacement = sheet(grid=4), swing(time, start=0.0)
    points = hung(garment, time) + displacement[:, None]
    return prepare(take_of(garment, time, displacement, points, sd=NOISE))


class LinearTakes(Observer):
    """An observer of two takes whose residual is linear in base parameters and amplitudes.

    Each effect moves the lowest modes of the sheet at its own frequency; `filter_lag` is nearly collinear with
    `time_offset`.
    """

    def __init__(self, seed=0):
        effects = tuple(e for e in LIBRARY if e.name in NAMES)
        super().__init__([swung(frames) for frames in (45, 40)], SI, effects, frequency=0.0)
        self.rng = np.random.default_rng(seed)
        self.rows = {name: np.stack([self.moved(6e-3) for _ in e.components]) for name, e in self.library.items()}
        self.rows["filter_lag"] = 0.9 * self.rows["time_offset"] + 0.1 * self.rows["filter_lag"]
        self.sensitivity = np.stack([self.moved(3e-3) for _ in SI.initial])
        self.missed = np.zeros(len(self.layout.take))

    def moved(self, size):
        """Residual of a motion of the cloth of so many metres rms."""
        shapes = shapes_of(self.recordings[0])[:, :3] @ self.rng.normal(size=(3, 3))
        hertz, phase = self.rng.uniform(0.3, 1.6), self.rng.uniform(0, 2 * np.pi)
        fields = [np.sin(2 * np.pi * hertz * r.time + phase)[:, None, None] * shapes for r in self.recordings]
        fields = [size / np.sqrt((fields[0][:, self.recordings[0].judged] ** 2).sum(2).mean()) * f for f in fields]
        seen = [(r.points - f)[None] for r, f in zip(self.recordings, fields, strict=True)]
        return np.where(self.layout.is_edge, 0.0, self.residuals_of(seen)[0])

    def noisy(self):
        """White noise of points, and of the numbers of the held edge."""
        seen = [(r.points - self.rng.normal(0, NOISE, r.points.shape))[None] for r in self.recordings]
        noise = self.residuals_of(seen)[0]
        return np.where(self.layout.is_edge, self.rng.normal(size=len(noise)), noise)

    def residuals(self, vectors, amplitudes):
        rows = np.concatenate([self.rows[name] / self.library[name].typical for name in self.library])
        return self.missed + (np.log(vectors / SI.initial)) @ self.sensitivity + amplitudes @ rows

    def base(self):
        """A fit of the base parameters alone."""
        count = len(SI.initial)
        inverse = np.linalg.inv(self.sensitivity @ self.sensitivity.T + np.eye(count) / 1.5**2)
        step = np.clip(-inverse @ self.sensitivity @ self.missed, -1.0, 1.0)
        vector = SI.initial * np.exp(step)
        residual = self.residuals(vector[None], self.off[None])[0]
        return Fitted(vector, self.off, (), residual, self.sensitivity.T, np.zeros(count), True)

    def search(self):
        """The search from the base fit, and the names of what it refitted."""
        asked = []

        def refit(wanted, tasks):
            asked.extend(wanted)
            return fit(self, tasks)

        noise = [np.full(r.points.shape[1], NOISE) for r in self.recordings]
        base = self.base()
        return Search(self, noise, base, dict(self.rows), MESH, refit, lambda about: {}), asked


def best_of(found):
    """The fitted subset of the largest mass."""
    weights = dict(zip(found.mass.among, found.mass.total, strict=True))
    return max(found.fits, key=lambda one: float(weights.get(one, -np.inf)))

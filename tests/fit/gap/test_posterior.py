"""The search for subsets of effects, in linear worlds whose truth is known: noise, mesh and effects are drawn."""

from __future__ import annotations

import numpy as np
import pytest

from fit.effects import LIBRARY
from fit.gap.fitting import Fitted, fit
from fit.gap.likelihood import Likelihood, shapes_of
from fit.gap.posterior import SCALES, UNKNOWN, Linear, Search
from fit.methods import SI
from fit.observer.residuals import Observer
from fit.recordings.recording import prepare
from tests.fit.scenes import hung, sheet, swing, take_of

NOISE, MESH = 1e-3, 0.5  # m; mm
NAMES = ("air_drag", "gravity_tilt", "time_offset", "filter_lag", "hem", "draught")


class LinearTakes(Observer):
    """An observer of two takes whose residual is linear in base parameters and amplitudes.

    Each effect moves the lowest shapes of the sheet in its own rhythm; a lag does what a late clock does, nearly.
    """

    def __init__(self, seed=0):
        recordings = []
        for frames in (45, 40):
            time = np.arange(frames) / 15.0
            garment, displacement = sheet(grid=4), swing(time, start=0.0)
            points = hung(garment, time) + displacement[:, None]
            recordings.append(prepare(take_of(garment, time, displacement, points, sd=NOISE)))
        super().__init__(recordings, SI, tuple(e for e in LIBRARY if e.name in NAMES), frequency=0.0)
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


@pytest.fixture
def world():
    """Takes with noise and with an error of the mesh of half a millimetre."""
    made = LinearTakes()
    made.missed = made.noisy() + made.moved(1e-3 * MESH)
    return made


def test_nothing_is_named_nor_refitted_where_noise_and_mesh_are_all(world):
    search, asked = world.search()
    found = search.go()
    assert found.best() == ()
    assert asked == []
    known, wide = found.shares()[()]
    assert known > 0.8
    assert wide < UNKNOWN


def test_one_effect_is_named_for_little_more_than_one_refit(world):
    world.missed = world.missed - 1.5 * world.rows["air_drag"][0]
    search, asked = world.search()
    found = search.go()
    assert found.best() == ("air_drag",)
    assert found.shares()[("air_drag",)][0] > 0.8
    assert len({one for one in asked if one}) <= 3
    size = found.fits[("air_drag",)].amplitudes[world.columns["air_drag"]][0] / world.library["air_drag"].typical
    assert size == pytest.approx(1.5, abs=0.15)


def test_two_effects_are_named_together(world):
    world.missed = world.missed - world.rows["air_drag"][0] - 0.8 * world.rows["hem"][0]
    search, _ = world.search()
    found = search.go()
    assert found.best() == ("air_drag", "hem")
    assert found.shares()[("air_drag", "hem")][0] > 0.7


def test_twins_share_the_mass_and_are_never_named_together(world):
    world.missed = world.missed - 0.5 * world.rows["time_offset"][0]
    search, _ = world.search()
    found = search.go()
    assert frozenset(("filter_lag", "time_offset")) in found.twins
    assert not any({"filter_lag", "time_offset"} <= set(one) for one in found.mass.among)
    shares = found.shares()
    assert shares[("time_offset",)][0] + shares[("filter_lag",)][0] > 0.8


def test_a_cause_that_no_effect_imitates_is_a_wide_discrepancy(world):
    world.missed = world.missed + sum(world.moved(5e-3) for _ in range(4))
    search, _ = world.search()
    wide = sum(share for _, share in search.go().shares().values())
    assert wide > 0.8


def test_what_the_mesh_may_make_is_no_evidence(world):
    """An effect's motion of a third of the mesh's error has no more evidence than the odds of an effect."""
    noise = [np.full(r.points.shape[1], NOISE) for r in world.recordings]
    world.missed = world.missed - 0.03 * world.rows["air_drag"][0]  # 0.18 mm, a third of MESH
    search, _ = world.search()
    base = search.about
    linear = Linear(world, Likelihood(world, noise, base.residual, SCALES), base, dict(world.rows))
    mass = linear.masses([(), ("air_drag",)], MESH)
    assert mass.total[1] < mass.total[0] - 2.0


def test_what_lowers_no_cost_when_it_is_fitted_truly_is_refuted(world):
    """A secant promises that drag explains the residual, and no size of the effect does."""
    world.missed = world.missed - 1.5 * world.rows["air_drag"][0]
    search, asked = world.search()
    world.rows["air_drag"] = 0.0 * world.rows["air_drag"]
    found = search.go()
    assert ("air_drag",) in asked
    assert max(sum(found.shares().get(one, (0.0, 0.0))) for one in found.mass.among if "air_drag" in one) < 1e-9
    assert "air_drag" not in found.best()

"""Cloth that answers linearly to base parameters and effects, beneath the real observer and the real diagnosis.

Only the simulator is replaced: recordings, residuals, held edges, fits, screening, verdict and records are the real
ones. The cloth follows the hanger's path. Each base parameter's logarithm moves a field of its own, and so does each
component of an effect, in proportion to its amplitude. So the truth of a take is known, and an effect is one column.
"""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from fit.cloth.effect import columns_of
from fit.cloth.mesh import build_mesh
from fit.cloth.model import Resolution
from fit.effects import LIBRARY
from fit.gap import base_fit, diagnosis, screening
from fit.methods import SI
from fit.observer import residuals
from fit.observer.residuals import Observer
from fit.recordings.recording import prepare
from tests.fit.scenes import hung, sheet, swing, take_of

NAMES = (
    "air_drag", "gravity_tilt", "anisotropy", "hem", "strain_stiffening", "draught", "time_offset", "clock_drift",
)  # fmt: skip
EFFECTS = tuple(effect for effect in LIBRARY if effect.name in NAMES)
MESH = Resolution(spacing=0.1)
OF_VECTOR = [1, 2, 3, 5, 6]  # columns of a row of materials that the base parameters are
RATE = 20.0  # frames/s
BASE = np.array([0.0, 0.8, 0.0, 0.5, -1.0])  # logs of the true base parameters over the initial ones


@dataclasses.dataclass
class World:
    """What the cloth does: sizes [m rms] of fields, errors of the mesh, and what no model knows.

    - `parameter`: of a factor of e in one base parameter; `effect`: of one effect at its typical size
    - `alike`: {effect: another one}, whose field it has but for the share `apart` of its own
    - `mesh`: of the error on a mesh of 0.1 m, which falls with the square of the spacing
    - `on_edge`: effects that move the held edge and hardly the cloth below
    """

    parameter: float = 3e-3
    effect: float = 6e-3
    mesh: float = 0.3e-3
    apart: float = 0.1
    alike: dict[str, str] = dataclasses.field(default_factory=dict)
    on_edge: tuple[str, ...] = ()

    def field(self, recording, number, size):
        """A field of the cloth, (frames, points, 3), still at the held edge, of this rms at the lower points."""
        rng = np.random.default_rng(number)
        at = np.array([p.at_m for p in recording.garment.points])
        across, down = at[:, 0] / np.ptp(at[:, 0]), -at[:, 1] / np.ptp(at[:, 1])
        modes = np.stack([down, down * np.cos(2 * np.pi * across), down * np.sin(np.pi * across)], 1)
        shape = modes @ rng.normal(size=(3, 3))
        hertz, phase = rng.uniform(0.4, 1.6), rng.uniform(0, 2 * np.pi)
        swings = np.sin(2 * np.pi * hertz * recording.time + phase)
        scale = np.sqrt((shape[down > 0] ** 2).sum(1).mean() / 2)
        return size / scale * swings[:, None, None] * shape

    def columns(self, recording):
        """Fields of a factor of e in each base parameter, and of each effect's components per unit."""
        base = [self.field(recording, 100 + k, self.parameter) for k in range(len(OF_VECTOR))]
        made = {}
        for number, effect in enumerate(LIBRARY):
            own = [self.field(recording, 1000 + 10 * number + c, self.effect) for c in range(len(effect.components))]
            if effect.moves_edge:
                slow = np.sin(2 * np.pi * (0.3 + 0.11 * number) * recording.time)[:, None, None]
                shift = 0.5 * self.effect * slow * [0.0, 1.0, 0.0]
                still = effect.name in self.on_edge
                own = [0.2 * one + (~recording.judged)[:, None] * shift if still else one + shift for one in own]
            made[effect.name] = np.stack(own) / effect.typical
        for name, other in self.alike.items():
            kinds = {effect.name: effect for effect in LIBRARY}
            share = kinds[other].typical / kinds[name].typical
            made[name] = (1 - self.apart) * share * made[other][: len(made[name])] + self.apart * made[name]
        return np.stack(base), made


class LinearCloth:
    """A simulator of one recording."""

    world, runs, last_runs = World(), 0, 0

    def __init__(self, recording, effects, *, resolution):
        self.recording, self.effects, self.simulations = recording, effects, 0
        self.mesh = build_mesh(recording.garment, resolution.spacing)
        self.base, made = self.world.columns(recording)
        self.rows = np.concatenate([made[effect.name] for effect in effects])
        share = (self.mesh.spacing / 0.1) ** 2
        self.off = self.world.field(recording, 1, self.world.mesh * share)

    @staticmethod
    def columns_of(name):
        """Columns of an effect of `EFFECTS` in a row of amplitudes."""
        return dict(zip([effect.name for effect in EFFECTS], columns_of(EFFECTS), strict=True))[name]

    def groups(self, materials, amplitudes, *, shapes):
        """Answer `fit.cloth.simulator.run_together`, to which nothing is left to run."""
        return self.run(materials, amplitudes, shapes=shapes), []

    def finish(self, candidates):
        return candidates

    def run(self, materials, amplitudes, *, observer_hz=0.0, shapes=False):
        recording, count = self.recording, len(materials)
        self.simulations += count
        LinearCloth.runs += count
        middle = recording.held(recording.time).reshape(-1, 2, 3).mean(1)
        still = hung(recording.garment, recording.time) + middle[:, None] + self.off
        logs = np.log(materials[:, OF_VECTOR] / SI.initial)
        points = still + np.tensordot(logs, self.base, 1) + np.tensordot(amplitudes, self.rows, 1)
        nodes = None
        if shapes:
            flat = np.insert(self.mesh.rest, 1, 0.0, axis=1) if self.mesh.rest.shape[1] == 2 else self.mesh.rest
            nodes = np.broadcast_to(flat + middle[:, None], (count, len(middle), *flat.shape))
        return SimpleNamespace(points=points, shapes=nodes)


def a_take(name, world, sizes, *, seconds=3.0, noise=1e-3, seed=0, unknown=0.0, hz=0.7, off=0.0, more=None, base=0.8):
    """A take of a cloth whose effects have these sizes, all in a true world.

    - `unknown` [m rms]: of a motion that no column makes; `off` [m]: by which the held edge leaves the hanger's path
    - `more`: sizes of effects that move the cloth in addition and not the held edge
    - `base`: of the base parameters' distance from their initial values
    """
    time = np.arange(0, seconds, 1 / RATE)
    garment = sheet(grid=5)
    moved = swing(time, amplitude=0.05, hz=hz, sideways=0.02, stop=seconds - 1)
    recording = prepare(take_of(garment, time, moved, name=name))
    columns, made = world.columns(recording)
    points = hung(garment, time) + moved[:, None] + base * np.tensordot(BASE, columns, 1)
    points = points + world.field(recording, 7, unknown)
    points = points + off * np.sin(2 * np.pi * 0.6 * time)[:, None, None] * [1.0, 0.0, 0.0]
    for effect, size in sizes.items():
        points = points + np.tensordot(np.atleast_1d(size), made[effect], 1)
    for effect, size in (more or {}).items():
        points = points + recording.judged[:, None] * np.tensordot(np.atleast_1d(size), made[effect], 1)
    points = points + np.random.default_rng(seed).normal(0, noise, points.shape)
    return take_of(garment, time, moved, points, sd=noise, name=name)


def three_takes(world, sizes, **options):
    """Two takes to fit to, with 1 mm of noise, and one to judge on, longer and with 1.5 mm."""
    fitted = [a_take(name, world, sizes, seed=n, hz=0.7 + 0.3 * n, **options) for n, name in enumerate("ab")]
    return fitted, [a_take("c", world, sizes, seed=3, noise=1.5e-3, seconds=3.5, hz=0.85, **options)]


def of_effects_that_are_off(observer, fitted, chosen, secants_of=screening.secants_of):
    """Secants as ever, of effects that are not in the fit: at an upper bound a step would be 0."""
    assert not set(chosen) & set(fitted.active)
    assert all(not fitted.amplitudes[observer.columns[name]].any() for name in chosen)
    return secants_of(observer, fitted, chosen)


def diagnosed(training, held_out, world, *, effects=EFFECTS, **options):
    """Diagnose takes in a linear world; return the findings."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(residuals, "Simulator", LinearCloth)
        patch.setattr(LinearCloth, "world", world)
        patch.setattr(LinearCloth, "runs", 0)
        patch.setattr(screening, "secants_of", of_effects_that_are_off)
        # Every start leads to the same end, so that few candidates serve.
        patch.setattr(base_fit, "FIRST_SAMPLES", 14)
        patch.setattr(base_fit, "SAMPLES", 2)
        found = diagnosis.diagnose(training, held_out, effects=effects, resolution=MESH, **options)
        last = LinearCloth.runs
    LinearCloth.last_runs = last
    return found


def observer_of(takes, world, *, effects=EFFECTS):
    """An observer of takes in a linear world, apart from any diagnosis."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(residuals, "Simulator", LinearCloth)
        patch.setattr(LinearCloth, "world", world)
        return Observer([prepare(take) for take in takes], SI, effects, frequency=0.0, resolution=MESH)


def points_of(take, world, vector, sizes=None):
    """The model's points in a take, (frames, points, 3), worked out from its fields."""
    recording = prepare(take)
    columns, made = world.columns(recording)
    middle = recording.held(recording.time).reshape(-1, 2, 3).mean(1)
    spacing = build_mesh(recording.garment, MESH.spacing).spacing
    points = hung(recording.garment, recording.time) + middle[:, None]
    points = points + world.field(recording, 1, world.mesh * (spacing / 0.1) ** 2)
    points = points + np.tensordot(np.log(np.asarray(vector) / SI.initial), columns, 1)
    for effect, size in (sizes or {}).items():
        points = points + np.tensordot(np.atleast_1d(size), made[effect], 1)
    return points


def misses_by(take, points):
    """Root mean square distance [mm] of a take's judged points from points, (frames, points, 3)."""
    recording = prepare(take)
    apart = (recording.points - points)[:, recording.judged]
    return 1e3 * float(np.sqrt((apart**2).sum(2).mean()))

"""Small analytic recordings for tests of the solver and the diagnosis."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np

from fit.cloth import material as mat
from fit.cloth.model import Resolution
from fit.cloth.simulator import Simulator
from fit.recordings.recording import Recording, prepare
from formats.garment import Garment, TrackedPoint
from formats.rig import Rig
from formats.take import Take

CORNERS = ("top_left", "top_right", "bottom_right", "bottom_left")


def sheet(width=0.4, height=0.45, held="edge", mass=0.036, grid=None):
    """A rectangular swatch with five tracked points, or a grid of `grid` x `grid`."""
    half = width / 2
    outline = ((-half, 0.0), (half, 0.0), (half, -height), (-half, -height))
    if grid is None:
        points = tuple(TrackedPoint(name=n, at_m=p) for n, p in zip(CORNERS, outline, strict=True))
        points += (TrackedPoint(name="centre", at_m=(0.0, -height / 2)),)
    else:
        points = tuple(
            TrackedPoint(name=f"row{r}_col{c}", at_m=(float(x), float(y)))
            for r, y in enumerate(np.linspace(0, -height, grid))
            for c, x in enumerate(np.linspace(-half, half, grid))
        )
    return Garment(
        format="hangtime-garment/1",
        name="sheet",
        kind="swatch",
        mass_kg=mass,
        outline_m=outline,
        held=held,
        points=points,
    )


def swing(time, *, amplitude=0.08, hz=0.8, start=0.5, stop=1e9, sideways=0.0):
    """Displacement of the hanger, (frames, 3): along y (through the cloth), ramped in and stopped smoothly."""
    ramp = np.clip((time - start) / 0.6, 0, 1)
    ramp = ramp**3 * (10 - 15 * ramp + 6 * ramp**2)
    fade = 1 - np.clip((time - stop) / 0.3, 0, 1)
    fade = fade**3 * (10 - 15 * fade + 6 * fade**2)
    wave = np.sin(2 * np.pi * hz * (time - start)) * ramp * fade
    return np.stack(
        [sideways * np.sin(2 * np.pi * 1.3 * hz * (time - start)) * ramp * fade, amplitude * wave, 0 * time], 1
    )


def take_of(garment, time, displacement, points=None, *, sd=0.001, name="scene"):
    """A take in a frame with z up whose held ends follow `displacement`, (frames, 3) or (frames, 2, 3)."""
    top = np.array(garment.outline_m)[:2]
    ends = np.array([[top[0, 0], 0, 0.0], [top[1, 0], 0, 0.0]])
    held = ends[None] + displacement.reshape(len(time), -1, 3)
    count = len(garment.points)
    if points is None:
        points = np.zeros((len(time), count, 3))
    seen = np.isfinite(points).all(2)
    rig = Rig(format="hangtime-rig/1", name="test", gravity=(0.0, 0.0, -1.0))
    return Take(
        take_id=name, created="2026-01-01T00:00:00Z", rig=rig,
        garment=garment, time=time, held=held, held_valid=np.ones((len(time), 2), bool),
        held_sd=np.full((len(time), 2, 3), 1e-4), points=points, points_valid=seen,
        points_sd=np.full((len(time), count, 3), sd), state=np.zeros(len(time), np.uint16), markers=held,
    )  # fmt: skip


def hung(garment, time):
    """Points of the garment hanging flat and still, (frames, points, 3)."""
    rest = np.array([[p.at_m[0], 0.0, p.at_m[1]] for p in garment.points])
    return np.broadcast_to(rest, (len(time), *rest.shape)).copy()


def as_rows(materials):
    """Material rows, (candidates, parameters), columns in the order of `MATERIAL_NAMES`."""
    return np.array([dataclasses.astuple(one) for one in materials], float)


def material(garment, **changes):
    """Material row of a garment of median fabric, with changes."""
    base = mat.Material(areal_density=garment.areal_density)
    return as_rows([dataclasses.replace(base, **changes)])


def simulate_take(garment, time, displacement, materials, *, effects=(), amplitudes=None, noise=0.0, seed=0,
                  resolution=None, name="scene"):  # fmt: skip
    """A take whose points our own solver made, with white noise [m]."""
    recording = prepare(take_of(garment, time, displacement, name=name))
    # Settling is drawn to the first observed shape, which does not exist yet: aim it at the hanging sheet.
    recording = recording.with_points(hung(garment, time) + displacement[:1].reshape(1, -1, 3).mean(1, keepdims=True))
    simulator = Simulator(recording, effects, resolution=resolution or Resolution())
    points = simulator.run(materials, amplitudes).points[0]
    points = points + np.random.default_rng(seed).normal(0, noise, points.shape) if noise else points
    return take_of(garment, time, displacement, points, sd=max(noise, 1e-4), name=name)


def shared(make):
    """Make each take once for all tests. Its arrays cannot be written, so that no test changes another's take."""

    @functools.cache
    def once(*words, **options):
        take = make(*words, **options)
        for field in dataclasses.fields(take):
            value = getattr(take, field.name)
            if isinstance(value, np.ndarray):
                value.flags.writeable = False
        return take

    return once


def recording_of(take: Take) -> Recording:
    """The take in the world frame."""
    return prepare(take)

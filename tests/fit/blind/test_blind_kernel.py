"""The generator's kernel against the same steps in NumPy: elastic forces from energies, the others as documented."""

from __future__ import annotations

import numpy as np
import pytest

from fit.blind import kernel
from fit.blind.engine import (
    HANGING_DAMPING,
    SAMPLES_A_SECOND,
    Cloth,
    Engine,
    _air_mass,
    held_fraction,
    hung,
    magnet_spot,
    resample,
)
from fit.blind.foreign.workers.outside_forces import OutsideForces
from fit.blind.sheet import place_on
from fit.runtime import JITTER_VARIABLE

DURATION, SETTLE = 0.1, 0.02  # s
NUDGE = 1e-6  # m, of a central difference

EVERYTHING = Cloth(
    width=0.2, height=0.2, stretch=60.0, shear=8.0, bending=2e-4, damping=1.5, stretch_ratio=0.5, bending_ratio=0.4,
    stiffening=40.0, stretch_time=2e-4, bend_viscosity=2e-6, friction=2e-3, curl=(6.0, -4.0), hem=0.02,
    mass_slope=(0.3, 0.2), gravity_tilt=(0.1, -0.2), drag=1.1, lift=2.0, wind=(1.5, 2.0, 0.5), gust_phase=0.7,
    added_mass=0.1, wake=2.0, wake_time=0.05, bob=0.004, bob_length=0.02, thread=5.0, magnet=0.3, corner=-1,
)  # fmt: skip


def ends_of(samples):
    """A bar that is pushed through the cloth, aside and up, and turns."""
    time = np.linspace(0, DURATION, samples)
    s = time**2 / (time**2 + 0.03**2)
    middle = np.stack([0.02 * s, 0.06 * s, 0.03 * s], 1)
    half = 0.1 * np.stack([np.cos(0.3 * s), np.sin(0.3 * s), 0.1 * s], 1)
    return np.concatenate([middle - half, middle + half], 1)


def columns(sheet, x):
    """The deformation gradient's columns u and w of every triangle, (..., triangles, 3)."""
    corners = x[..., sheet.triangles, :]
    q, r = corners[..., 1, :] - corners[..., 0, :], corners[..., 2, :] - corners[..., 0, :]
    b = sheet.inverse.reshape(-1, 4)[..., None]
    return b[:, 0] * q + b[:, 2] * r, b[:, 1] * q + b[:, 3] * r


def stretching(engine, x):
    """Energy [J] of ground and stiffening fibres, (...,), of positions (..., nodes, 3)."""
    u, w = columns(engine.sheet, x)
    j = np.linalg.norm(np.cross(u, w), axis=-1)
    mu, lam, s = engine.cloth.shear, engine.lam, engine.cloth.stiffening
    density = mu / 2 * ((u**2 + w**2).sum(-1) - 2 * j) + (lam + mu) / 2 * (j - 1) ** 2
    for stiffness, column in zip(engine.fibres, (w, u), strict=True):  # warp runs down the sheet
        e = np.linalg.norm(column, axis=-1) - 1
        density += stiffness * (e**2 / 2 + s * np.abs(e) ** 3 / 3 + s**2 * e**4 / 8)
    return (density * engine.sheet.area).sum(-1)


def elastic(engine, x):
    """Minus the gradient of `stretching` [N], (nodes, 3)."""
    moved = np.concatenate([x + sign * NUDGE * np.eye(x.size).reshape(-1, *x.shape) for sign in (1, -1)])
    above, below = stretching(engine, moved).reshape(2, -1)
    return -((above - below) / (2 * NUDGE)).reshape(x.shape)


def viscous(engine, x, v):
    """Forces [N] of fibres that resist the rate of their length."""
    sheet, force = engine.sheet, np.zeros_like(x)
    b = sheet.inverse.reshape(-1, 2, 2)
    for stiffness, column, rate, of in zip(
        engine.fibres, columns(sheet, x)[::-1], columns(sheet, v)[::-1], (b[:, :, 1], b[:, :, 0]), strict=True
    ):
        along = column / np.linalg.norm(column, axis=1, keepdims=True)
        pull = (engine.cloth.stretch_time * stiffness * sheet.area * (along * rate).sum(1))[:, None] * along
        for corner in (1, 2):
            np.add.at(force, sheet.triangles[:, corner], -of[:, corner - 1, None] * pull)
            np.add.at(force, sheet.triangles[:, 0], of[:, corner - 1, None] * pull)
    return force


def bending(engine, x, v, slip):
    """Forces [N] of hinges: stiffness, viscosity, rest curvature, and friction of two elements in parallel."""
    sheet, cloth, force = engine.sheet, engine.cloth, np.zeros_like(x)
    weights, area = sheet.hinge_cotangents, sheet.hinge_area
    corners = x[sheet.hinges]
    s, rate = ((weights[..., None] * of[sheet.hinges]).sum(1) for of in (x, v))
    edge = corners[:, 1] - corners[:, 0]
    sides = [np.cross(edge, corners[:, k] - corners[:, 0]) for k in (2, 3)]
    left, right = (side / np.linalg.norm(side, axis=1, keepdims=True) for side in sides)
    n = (left - right) / np.linalg.norm(left - right, axis=1, keepdims=True)
    kappa = 3 * (s * n).sum(1) / area
    most = 0.5 * 2.25 * cloth.friction
    for element, slides_at in enumerate((4.0, 16.0)):
        slip[element] = np.clip(slip[element] + most / slides_at * (kappa - slip[2]), -most, most)
    slip[2] = kappa
    extra = slip[0] + slip[1] - engine.hinge_bending * engine.hinge_curl
    moment = (engine.hinge_bending[:, None] * s + cloth.bend_viscosity * rate) / area[:, None] + extra[:, None] / 3 * n
    for k in range(4):
        np.add.at(force, sheet.hinges[:, k], -weights[:, k, None] * moment)
    return force


def in_numpy(engine, ends):
    """Positions [m] and velocities [m/s], (samples, nodes, 6), of the same steps."""
    sheet, cloth, p = engine.sheet, engine.cloth, engine.numbers()
    every = int(np.ceil(1 / (SAMPLES_A_SECOND * engine.stable_step)))
    dt = 1 / (SAMPLES_A_SECOND * every)
    steps = round(DURATION * SAMPLES_A_SECOND) * every
    path = resample(ends[None], DURATION, np.linspace(0, steps * dt, steps + 1))[0]
    x = hung(path[None, 0], sheet)[0]
    tied, pole = engine.poles(x[None])[0].reshape(2, 3)
    p |= {f"{name}_{axis}": value for name, place in (("thread", tied), ("magnet", pole))
          for axis, value in zip("xyz", place, strict=True)}  # fmt: skip
    outside = OutsideForces(p, sheet.triangles, magnet_spot(sheet), x, dt)
    mass, air = engine.node_mass[:, None], cloth.added_mass * _air_mass(sheet)[:, None]
    gravity = np.array([p[f"gravity_{axis}"] for axis in "xyz"])
    share = held_fraction(sheet)[:, None]
    v, a, slip = np.zeros_like(x), np.zeros_like(x), [np.zeros(len(sheet.hinges)) for _ in range(3)]
    seen = []
    for step in range(-round(SETTLE / dt), steps + 1):
        kept = np.exp(-0.5 * dt * (cloth.damping + (HANGING_DAMPING if step < 0 else 0.0)))
        v = kept * v + dt / 2 * a
        x = x + dt * v
        here, was = ((1 - share) * path[at, :3] + share * path[at, 3:] for at in (max(step, 0), max(step - 1, 0)))
        x[sheet.held], v[sheet.held] = here, (here - was) / dt
        force = elastic(engine, x) + viscous(engine, x, v) + bending(engine, x, v, slip)
        a = gravity + (force + outside.at(max(step, 0) * dt, x, v)) / mass
        u, w = columns(sheet, x)
        lot = np.cross(u, w)
        lot *= (sheet.area / np.linalg.norm(lot, axis=1))[:, None]
        n = np.zeros_like(x)
        for corner in range(3):
            np.add.at(n, sheet.triangles[:, corner], lot)
        a = a - (a * n).sum(1, keepdims=True) / (n**2).sum(1, keepdims=True) * air / (mass + air) * n
        v = kept * (v + dt / 2 * a)
        a[sheet.held] = 0.0
        if step >= 0 and step % every == 0:
            seen.append(np.concatenate([x, v], 1))
    return np.array(seen)


def test_every_force_and_every_step_is_as_documented(monkeypatch):
    """All effects at once, 21 samples of a sheet of 3 x 3 nodes and more; a central difference leaves nanometres."""
    monkeypatch.delenv(JITTER_VARIABLE, raising=False)  # which moves the kernel's start alone
    engine, ends = Engine(EVERYTHING, side=0.1), ends_of(41)
    places = np.array([[0.03, -0.07], [-0.08, -0.19]])
    found = engine.run(ends[None], DURATION, places, settle=SETTLE, shapes=True)
    expected = in_numpy(engine, ends)
    moved = np.abs(expected[..., :3] - expected[0, :, :3]).max()
    assert moved > 0.05
    assert found.shapes[0, ..., :3] == pytest.approx(expected[..., :3], abs=1e-7)
    assert found.shapes[0, ..., 3:] == pytest.approx(expected[..., 3:], abs=1e-5)
    corners, weights = place_on(engine.sheet, places)
    between = (weights[..., None] * expected[:, corners, :3]).sum(2)
    assert found.points[0] == pytest.approx(between, abs=1e-7)
    assert (weights[0] > 0.01).all()
    assert len(kernel.NUMBER_NAMES) == len(engine.numbers())

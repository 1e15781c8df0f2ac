"""Random hand-like motions of a hanger: smooth, with bounded jerk, and gentle enough for predictable cloth.

Each motion starts and ends at rest, ramped by quintic smooth steps, with slow tremor in every direction. The component
of the motion perpendicular to the sheet makes it swing. This component is scaled by the predicted first mode of a
hanging sheet,

    q'' + c q' + omega^2 q = -1.602 a,   omega = 1.2024 sqrt(g / L)

The mode should reach an angle drawn between 12 and 26 degrees. The prediction knows the base cloth only, so the motion
does not reveal the planted effect.
Source: H. Lamb, "Hydrodynamics" (1932), section 196 (the hanging chain's J0 and its participation 2 / (j J1(j)));
quintic steps: T. Flash & N. Hogan, J. Neurosci. 5 (1985), section 2 (least jerk).
"""

from __future__ import annotations

import numpy as np

from fit.blind.engine import SAMPLES_A_SECOND
from formats.arrays import Floats
from formats.nature import GRAVITY

TRAINING = ("chirp", "sideways", "twist")  # motions of the fitted takes
HELD_OUT = ("ellipse", "oblique")  # motions of the held-out takes
ANGLES = (12.0, 26.0)  # degrees; our choice: swings of a hand, far from 0 and from a fall; half and double untried
# Of that angle where the bar stops abruptly; our choice: less, as limp cloth flutters after a stop.
SHARE_WHERE_STOPPED = 0.75
MOST_ACCELERATION = 3.0  # m/s^2, a third of gravity, so that the cloth stays taut and its motion predictable


def course(rng: np.random.Generator, samples: int, band: tuple[float, float]) -> Floats:
    """Return a smooth random signal of mean 0 and rms 1, (samples,), of eight sines within a band [Hz]."""
    time = np.arange(samples) / SAMPLES_A_SECOND
    hertz, phase = rng.uniform(*band, 8), rng.uniform(0, 2 * np.pi, 8)
    wave = np.sin(2 * np.pi * hertz * time[:, None] + phase).sum(1)
    wave -= wave.mean()
    return np.asarray(wave / np.sqrt(np.mean(wave**2)))


def step(time: Floats, start: float, length: float) -> Floats:
    """Return a quintic smooth step from 0 to 1."""
    s = np.clip((time - start) / length, 0, 1)
    return np.asarray(s**3 * (10 - 15 * s + 6 * s**2))


def swing_angle(displacement: Floats, height: float, damping: float) -> float:
    """Return the predicted largest angle [rad] of a hanging sheet's first mode."""
    omega2, dt = 1.2024**2 * GRAVITY / height, 1 / SAMPLES_A_SECOND
    push = -1.602 * np.gradient(np.gradient(displacement)) * SAMPLES_A_SECOND**2
    q, speed, most = 0.0, 0.0, 0.0
    for a in push.tolist():
        speed = (speed + dt * (a - omega2 * q)) / (1 + damping * dt)
        q += dt * speed
        most = max(most, abs(q))
    return float(np.arctan(most / height))


def move(rng: np.random.Generator, kind: str, duration: float, width: float, height: float, damping: float) -> Floats:
    """Draw a motion of the held edge's two ends [m], (samples, 6), world frame: x along the bar, y away, z up."""
    samples = round(duration * SAMPLES_A_SECOND) + 1
    time = np.arange(samples) / SAMPLES_A_SECOND
    start, stop = rng.uniform(0.25, 0.4), duration - rng.uniform(0.5, 0.8)
    window = step(time, start, 0.5) * (1 - step(time, stop - 0.4, 0.4))
    x, y, z, yaw = _shape(rng, kind, time, start, stop)
    tremor = window[:, None] * np.stack([course(rng, samples, (0.4, 1.2)) for _ in range(5)], 1)
    y = y * (window if kind not in {"twist", "oblique"} else 1.0)
    angle = np.radians(rng.uniform(*ANGLES)) * (SHARE_WHERE_STOPPED if kind in {"twist", "oblique"} else 1.0)
    y = y * np.tan(angle) / max(np.tan(swing_angle(y, height, damping)), 1e-6)
    place = np.stack([x * window, y, z * window], 1)
    for axis in range(3):
        most = np.abs(np.gradient(np.gradient(place[:, axis])) * SAMPLES_A_SECOND**2).max()
        limit = MOST_ACCELERATION * (0.5, 1.0, 0.5)[axis]
        place[:, axis] *= min(1.0, limit / max(most, 1e-9))
    place += tremor[:, :3] * rng.uniform(0.002, 0.004, 3)
    yaw = yaw * window + tremor[:, 3] * rng.uniform(0.004, 0.012)
    roll = tremor[:, 4] * rng.uniform(0.004, 0.012)
    c, s = np.cos(yaw), np.sin(yaw)
    arm = 0.5 * width * np.stack([c * np.cos(roll), s, c * np.sin(roll)], 1)
    arm *= (0.5 * width / np.linalg.norm(arm, axis=1))[:, None]
    return np.concatenate([place - arm, place + arm], 1)


def _shape(rng: np.random.Generator, kind: str, time: Floats, start: float, stop: float) -> tuple[Floats, ...]:
    """Return unscaled x, y, z [m] and yaw [rad] of one kind of motion."""
    since, none = np.maximum(time - start, 0), 0 * time
    side = rng.choice([-1.0, 1.0])
    if kind == "chirp":  # face-on, from slow to fast, twice: weak, then strong
        centre, low, high = (start + stop) / 2, rng.uniform(0.5, 0.8), rng.uniform(1.4, 2.0)
        part = np.where(time < centre, time - start, time - centre)
        sweep = np.sin(2 * np.pi * (low * part + (high - low) * part**2 / (stop - start)))
        weak, strong = rng.uniform(0.3, 0.5), 1.0
        first = step(time, start, 0.3) * (1 - step(time, centre - 0.3, 0.3))
        second = step(time, centre, 0.3) * (1 - step(time, stop - 0.3, 0.3))
        return none, 0.05 * sweep * (weak * first + strong * second), none, none
    if kind == "sideways":  # along the bar, with a bounce; a little of it face-on
        hertz, bounce = rng.uniform(0.8, 1.3), rng.uniform(1.0, 1.4)
        x = rng.uniform(0.03, 0.06) * np.sin(2 * np.pi * hertz * since)
        z = rng.uniform(0.02, 0.035) * np.sin(2 * np.pi * bounce * since + rng.uniform(0, 6))
        return x, 0.02 * np.sin(2 * np.pi * rng.uniform(0.5, 0.8) * since), z, none
    if kind == "twist":  # turn to and fro, then flick and stop
        yaw = rng.uniform(0.06, 0.14) * np.sin(2 * np.pi * rng.uniform(0.5, 0.8) * since)
        flick = (start + stop) / 2 + rng.uniform(-0.2, 0.2)
        return none, side * rng.uniform(0.06, 0.1) * step(time, flick, rng.uniform(0.45, 0.65)), none, yaw
    if kind == "ellipse":
        hertz, phase = rng.uniform(0.55, 0.85), rng.uniform(0.8, 2.2)
        turn = 2 * np.pi * hertz * since
        return rng.uniform(0.03, 0.06) * np.sin(turn + phase), 0.05 * np.sin(turn), none, none
    # oblique: two least-jerk reaches with a pause between, at an angle to the bar
    reaching, pause = rng.uniform(0.45, 0.65), rng.uniform(0.2, 0.4)
    there = step(time, start, reaching)
    back = rng.uniform(0.6, 1.4) * step(time, start + reaching + pause, rng.uniform(0.45, 0.65))
    reach = there - back
    z = 0.015 * np.sin(2 * np.pi * rng.uniform(0.8, 1.2) * since)
    return side * rng.uniform(0.03, 0.05) * reach, rng.uniform(0.07, 0.1) * reach, z, none

"""Hand-like motions of a hanger: smooth, randomised, gentle enough that the cloth's motion can be predicted.

Each motion gives the displacement of the bar's middle [m], (n, 3), x along the bar, y through the cloth, z up, and
its yaw
and roll [rad], (n,). All start and end at rest in position, ramped with the minimum-jerk polynomial 10 s^3 - 15 s^4 +
6 s^5. Source: T. Flash, N. Hogan, "The coordination of arm movements", J. Neuroscience 5 (1985), equation 11.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class HandMotion:
    """Displacement and turns as functions of time [s]."""

    displacement: Callable[[Floats], Floats]
    yaw: Callable[[Floats], Floats]
    roll: Callable[[Floats], Floats]


def minimum_jerk(s: Floats) -> Floats:
    """Return the smooth step from 0 to 1 over s from 0 to 1."""
    s = np.clip(s, 0, 1)
    return np.asarray(s**3 * (10 - 15 * s + 6 * s * s))


def _nothing(t: Floats) -> Floats:
    return np.asarray(0 * t)


def _wave(rng: np.random.Generator, low: float, high: float, size: float) -> Callable[[Floats], Floats]:
    """A sine of random frequency, phase and nearly constant size, ramped in."""
    hertz, phase, start = rng.uniform(low, high), rng.uniform(0, 2 * np.pi), rng.uniform(0.1, 0.3)
    size = size * rng.uniform(0.8, 1.2)

    def wave(t: Floats) -> Floats:
        ramp = minimum_jerk((t - start) / 0.6)
        return np.asarray(size * ramp * np.sin(2 * np.pi * hertz * (t - start) + phase))

    return wave


def _joined(x: Callable[[Floats], Floats], y: Callable[[Floats], Floats], z: Callable[[Floats], Floats]):  # type: ignore[no-untyped-def]
    return lambda t: np.stack([x(t), y(t), z(t)], 1)


def face_on(rng: np.random.Generator) -> HandMotion:
    """A chirp through the cloth whose size doubles half-way."""
    rate, size = rng.uniform(0.10, 0.2), rng.uniform(0.025, 0.035)

    def y(t: Floats) -> Floats:
        grown = 1 + minimum_jerk((t - 1.6) / 0.6)
        return np.asarray(size * grown * minimum_jerk((t - 0.2) / 0.5) * np.sin(2 * np.pi * (0.55 * t + rate * t * t)))

    return HandMotion(_joined(_nothing, y, _nothing), _nothing, _nothing)


def sideways(rng: np.random.Generator) -> HandMotion:
    """Along the bar and up and down."""
    return HandMotion(
        _joined(_wave(rng, 0.7, 1.0, 0.05), _wave(rng, 0.5, 0.8, 0.012), _wave(rng, 1.1, 1.5, 0.025)),
        _nothing,
        _nothing,
    )


def twist_and_flick(rng: np.random.Generator) -> HandMotion:
    """A twist of the bar, and a flick that stops dead."""
    at, size = rng.uniform(1.3, 1.6), rng.uniform(0.05, 0.08)

    def y(t: Floats) -> Floats:
        return np.asarray(size * minimum_jerk((t - at) / 0.35))

    return HandMotion(_joined(_nothing, y, _nothing), _wave(rng, 0.6, 0.9, 0.18), _nothing)


def mixed(rng: np.random.Generator) -> HandMotion:
    """A bit of everything."""
    y1, y2 = _wave(rng, 0.6, 0.85, 0.03), _wave(rng, 1.1, 1.4, 0.018)
    return HandMotion(
        _joined(_wave(rng, 0.9, 1.2, 0.025), lambda t: y1(t) + y2(t), _wave(rng, 0.8, 1.1, 0.015)),
        _wave(rng, 0.5, 0.8, 0.06), _wave(rng, 0.5, 0.8, 0.03),
    )  # fmt: skip


def swing_and_stop(rng: np.random.Generator) -> HandMotion:
    """A swing through the cloth that fades out and rings down."""
    y, stop = _wave(rng, 0.75, 1.0, 0.05), rng.uniform(1.8, 2.2)
    x = _wave(rng, 0.5, 0.7, 0.03)
    return HandMotion(
        _joined(x, lambda t: y(t) * (1 - minimum_jerk((t - stop) / 0.5)), _nothing),
        _nothing,
        _wave(rng, 0.6, 0.9, 0.03),
    )


TRAINING = (face_on, sideways, twist_and_flick)
HELD_OUT = (mixed, swing_and_stop)

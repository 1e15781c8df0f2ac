"""Swing a strip as a hanging chain; imported in other engines' Pythons, from this folder, with NumPy alone."""

import numpy as np

SETTLE, SWING = 0.6, 2.6  # s
SETTLING = 20.0  # 1/s of velocity, while the strip settles
AMPLITUDE = 0.01  # m/s per unit of the mode: swings of some millimetres


def first_mode(height):
    """Return J0(2.404826 sqrt(height)), the first mode of a chain, from its power series."""
    z = -((2.404826**2) * height) / 4
    total, term = np.ones_like(z), np.ones_like(z)
    for k in range(1, 20):
        term = term * z / k**2
        total += term
    return total


def frequency(track, dt):
    """Return how often a second the track swings, from its crossings of zero."""
    at = np.flatnonzero(np.diff(np.sign(track[1:]))) + 1
    exact = (at + track[at] / (track[at] - track[at + 1])) * dt
    return float((len(exact) - 1) / 2 / (exact[-1] - exact[0]))

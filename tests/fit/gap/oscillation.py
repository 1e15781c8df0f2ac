"""Damped oscillations driven by noise, whose autocorrelation is known: exp(-|t| / T) cos(2 pi f t)."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

RATE = 30.0  # frames/s
SHAPES, POINTS = 3, 4


def oscillation(rng, frames, decay, hertz, *, shapes=None):
    """A stationary oscillation of variance about 1 in a few shapes of the cloth, (frames, POINTS, 3)."""
    shapes = rng.normal(size=(SHAPES, POINTS * 3)) if shapes is None else shapes
    pole = np.exp(-1 / RATE / decay + 2j * np.pi * hertz / RATE)
    before = int(6 * decay * RATE)
    driven = rng.normal(size=(2, frames + before, SHAPES)) * np.sqrt((1 - abs(pole) ** 2) / SHAPES)
    moved = lfilter([1.0], [1.0, -pole], driven[0] + 1j * driven[1], axis=0)[before:].real
    return (moved @ shapes).reshape(frames, POINTS, 3)

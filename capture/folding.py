"""How probable it is that a corner in doubt is folded away and cannot be seen: a logistic regression on seven traces.

    P = 1 / (1 + exp(-(c_0 + sum_k c_k x_k)))

    x = ln(beyond / B) by all anchors, and by the held ends alone      `capture.coverage`
        ln(1 + peeking / A), ln(1 + before / L)        `capture.other_layers`, where the outline has the corner
        the same two where the seen cloth comes nearest to it
        1 for a corner that the outline has not, else 0

Cloth that is missing speaks for a fold; another layer there, behind the rim or before it, says that the corner may be
seen on that layer. In doubt is a corner whose ways to the others are too short or too long, or that was not found.

The coefficients are those that `benchmarks/hidden_corners.py` prints for the hard swings of the development sets; none
of the sets on which figures are stated went into them. The threshold is where precision and recall, on cloths left out
of the fit, miss their targets (95 and 90 %) by equally much.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from capture.other_layers import Layers

Floats = NDArray[np.float64]

BEYOND, LEAST_BEYOND, MOST_BEYOND = 0.035, 0.003, 0.3  # m: B, and the limits beyond which it says nothing more
PEEKING = 2e-5  # m^2: A, a pixel and a half at 2 m
BEFORE = 0.02  # m: L
WEIGHTS = {
    "beyond, by all": 2.05,
    "beyond, by the held ends": 1.91,
    "peeking, at the outline": -0.90,
    "before, at the outline": -0.21,
    "peeking, at the nearest cloth": -0.70,
    "before, at the nearest cloth": -0.59,
    "not on the outline": 1.08,
}
TRACES = tuple(WEIGHTS)
COEFFICIENTS = np.array([WEIGHTS[name] for name in TRACES])
CONSTANT = 0.60
THRESHOLD = 0.54  # probability from which a corner is told as hidden


def traces(by_all: float, by_ends: float, outline: Layers, nearest: Layers, is_missing: bool) -> Floats:
    """Return what speaks for and against a fold, (7,): distances [m] beyond the seen cloth, and other layers."""
    distances = np.log(np.clip([by_all, by_ends], LEAST_BEYOND, MOST_BEYOND) / BEYOND)
    layers = [(np.log1p(seen.peeking / PEEKING), np.log1p(seen.before / BEFORE)) for seen in (outline, nearest)]
    return np.array([*distances, *layers[0], *layers[1], float(is_missing)])


def probability(found: Floats) -> Floats:
    """Return the probability that a corner with these traces, (..., 7), is hidden by a fold."""
    return np.asarray(1.0 / (1.0 + np.exp(-(CONSTANT + found @ COEFFICIENTS))))

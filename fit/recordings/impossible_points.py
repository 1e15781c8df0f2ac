"""Find points where their cloth cannot be: a marker that jumps, or two markers that are taken for each other.

Cloth hardly stretches. So no two points are further apart than along the flat cloth. Stretch, glue and noise of
deviation s per axis are allowed for:

    |x_i - x_j| <= 1.25 d_ij + 5 mm + 6 sqrt(s_i^2 + s_j^2)

In a frame that breaks this rule, one point is left out: the point furthest beyond d_ij from all others together. This
repeats until the rule holds. Of two points alone, both are left out. Two markers a grid's pitch h apart that are taken
for each other are 2 h from their outer neighbours. The rule finds them for s below (0.75 h - 5 mm) / 8.5.
"""

from __future__ import annotations

import numpy as np

from formats.arrays import Booleans, Floats
from formats.judged_cloth import MOST_STRETCHED

GLUE = 5e-3  # m between a marker's middle and its place on the cloth, two of them
DEVIATIONS = 6.0  # of both points' noise
PAIRS_AT_ONCE = 1 << 20  # of points, in as many frames as that takes
MOST_LEFT_OUT = 0.05  # of a take's sightings; with more, the points are those of another marker set


def find_impossible(points: Floats, seen: Booleans, sd: Floats, places: Floats) -> Booleans:
    """Return which sightings are too far from others of the same frame, (frames, points).

    points and their noise's sd [m], (frames, points, 3); seen, (frames, points); places [m], (points, 2), on the flat
    cloth
    """
    flat = np.linalg.norm(places[:, None] - places, axis=2)
    found = np.zeros(seen.shape, bool)
    each = max(PAIRS_AT_ONCE // flat.size, 1)
    for begin in range(0, len(points), each):
        some = slice(begin, begin + each)
        at, noise = points[some], np.sqrt(np.mean(sd[some] ** 2, axis=2))
        apart = np.linalg.norm(at[:, :, None] - at[:, None], axis=3)
        too_far = apart > MOST_STRETCHED * flat + GLUE + DEVIATIONS * np.hypot(noise[:, :, None], noise[:, None])
        too_far &= seen[some, :, None] & seen[some, None]
        for frame in np.flatnonzero(too_far.any((1, 2))):
            beyond = np.where(seen[begin + frame] & seen[begin + frame, :, None], apart[frame] - flat, 0.0)
            found[begin + frame] = _left_out(too_far[frame], np.maximum(beyond, 0.0))
    return found


def _left_out(too_far: Booleans, beyond: Floats) -> Booleans:
    """Return which points of a frame, (points,), are left out, one after the other, until no pair is too far apart.

    - `too_far`: pairs, (points, points); emptied
    - `beyond` [m], (points, points): how much further apart than along the cloth; emptied
    """
    found = np.zeros(len(too_far), bool)
    while too_far.any():
        whole = np.where(too_far.any(1), beyond.sum(1), 0.0)
        worst = whole == whole.max()
        found |= worst
        for of_pairs in (too_far, beyond):
            of_pairs[worst], of_pairs[:, worst] = 0, 0
    return found


def describe_impossible(share: float) -> str:
    """Say the meaning of a share of impossible sightings, and the next step."""
    if share == 0.0:
        return "No point is further from the others than the cloth reaches."
    found = (
        f"{100 * share:.2g} % of a take's sightings of points are further from the others than the cloth reaches: "
        "markers that jump or are taken for each other."
    )
    if share <= MOST_LEFT_OUT:
        return f"{found} They are left out."
    return f"{found} At most {100 * MOST_LEFT_OUT:.0f} % may be: check the markers' names and the tracker."

"""Classify a hanger's motion in a word, such as sideways, so that takes of one kind can be held out.

The held edge has the centre m and the mean horizontal direction b; u points up, and n = u x b. Each kind of motion has
a share of the variance about the mean:

    sideways  b.m      face-on  n.m      up-and-down  u.m      twist  (half the edge's length) x angle about u

The kind with more than the share DOMINANT_SHARE of the sum names the motion. Otherwise the motion is `mixed`.
"""

from __future__ import annotations

import numpy as np

from formats.arrays import Floats
from formats.take import Take

HARDEST_PULL = 150.0  # m/s^2, 15 times gravity: no hand moves a hanger harder
STILL_MOTION = 0.004  # m, root mean square: sensors' noise is 1 to 3 mm
DOMINANT_SHARE = 0.7  # of the variance; our choice: at half, two ways of nearly equal size could name one
WAYS = ("sideways", "face-on", "up-and-down", "twist")
MOTION_KINDS = (*WAYS, "mixed", "still")


def axes_of(take: Take) -> dict[str, Floats]:
    """Return the unit vectors of the three translations, (3,) each; zeros where the hanger was never seen."""
    ends = take.held[take.held_valid.all(1)]
    up = -np.asarray(take.rig.gravity, float)
    up /= np.linalg.norm(up)
    bar = ends[:, 1] - ends[:, 0]
    along = (bar - np.outer(bar @ up, up)).sum(0)
    along /= max(float(np.linalg.norm(along)), 1e-12)
    return {"sideways": along, "face-on": np.cross(up, along), "up-and-down": up}


def reach_of(take: Take) -> dict[str, float]:
    """Root mean square of the hanger's motion [m] in each of the four ways; zeros where it was hardly seen."""
    ends = take.held[take.held_valid.all(1)]
    if len(ends) < 2:
        return dict.fromkeys(WAYS, 0.0)
    along, through, up = axes_of(take).values()
    bar = ends[:, 1] - ends[:, 0]
    level = bar - np.outer(bar @ up, up)
    middle = ends.mean(1)
    angle = np.unwrap(np.arctan2(level @ through, level @ along))
    half = 0.5 * float(np.median(np.linalg.norm(bar, axis=1)))
    moved = (middle @ along, middle @ through, middle @ up, half * angle)
    return {way: float(np.std(values)) for way, values in zip(WAYS, moved, strict=True)}


def kind_of(take: Take) -> str:
    """Return one of `MOTION_KINDS`."""
    reach = reach_of(take)
    total = sum(r**2 for r in reach.values())
    if total < STILL_MOTION**2:
        return "still"
    way = max(reach, key=reach.__getitem__)
    return way if reach[way] ** 2 > DOMINANT_SHARE * total else "mixed"

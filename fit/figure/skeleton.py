"""Skeleton of a figure: motion of its joints, and its proportions.

World frame: z up, metres. A figure that stands at rest faces -y; its left is at +x. The proportions are shares of its
height.

Source: R. Drillis, R. Contini, "Body Segment Parameters" (1966), as in D. A. Winter, "Biomechanics and Motor Control of
Human Movement" (4th edition 2009), figure 4.1: lengths of the segments. A. L. Bell, D. R. Pedersen, R. A. Brand, "A
comparison of the accuracy of several hip center location prediction methods", J. Biomech. 23 (1990): distance of the
hips' centres. It is 72 % of the width between the iliac spines, 0.10 of the height for a spine width of 0.24 m.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from formats.arrays import Floats

THIGH, SHANK, ANKLE_HEIGHT = 0.245, 0.246, 0.039  # of the height, Drillis and Contini 1966
HIP_OFFSET = 0.050  # from the middle to either hip
HEEL_BEHIND, BALL = 0.035, 0.090  # from the ankle back to the heel, and on to the ball of a foot 0.152 long
FOOT_RADIUS = 0.020  # of the height; our choice: 35 mm of 1.75 m
TRUNK = 0.818 - 0.530  # from the hips to the shoulders
SHOULDER_OFFSET = 0.115  # from the middle to either shoulder's centre
NECK, HEAD = 0.870 - 0.818, 0.130  # from the shoulders to the chin, and on to the top
UPPER_ARM, FOREARM, HAND = 0.186, 0.146, 0.108  # of the height, Drillis and Contini 1966
STANDARD_HEIGHT = 1.70  # m; our choice: between women's and men's means

SIDES = ("left", "right")


@dataclass(frozen=True, eq=False)
class SkeletonMotion:
    """Joints of a figure at even instants from 0 on.

    - `spacing` [s] of the instants
    - `height` [m] of the figure
    - `joints` [m]: name -> (instants, 3), world frame
    - `pelvis`, (instants, 3, 3): rows to its left, to its back and up
    """

    spacing: float
    height: float
    joints: dict[str, Floats]
    pelvis: Floats

    @property
    def seconds(self) -> float:
        """Duration of the motion [s]."""
        return self.spacing * (len(self.pelvis) - 1)

    def length(self, one: str, other: str) -> float:
        """Return the mean distance of two joints [m]."""
        return float(np.linalg.norm(self.joints[one] - self.joints[other], axis=1).mean())


def unit(vectors: Floats) -> Floats:
    """Return vectors, (..., 3), normalised to length 1."""
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12))


def knee_between(hip: Floats, ankle: Floats, forward: Floats, thigh: float, shank: float) -> Floats:
    """Return the position of a knee that bends towards `forward` [m], (n, 3); a leg too short to reach is straight."""
    way = ankle - hip
    far = np.clip(np.linalg.norm(way, axis=1), abs(thigh - shank) + 1e-6, thigh + shank - 1e-6)
    along = unit(way)
    ahead = unit(forward - (forward * along).sum(1, keepdims=True) * along)
    share = (thigh**2 - shank**2 + far**2) / (2 * far)
    out = np.sqrt(np.maximum(thigh**2 - share**2, 0.0))
    return np.asarray(hip + share[:, None] * along + out[:, None] * ahead)

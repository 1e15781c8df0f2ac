"""Eroded outline: the far border of a silhouette is eroded, the more the further the cloth leans.

    y_p = x_p - a g_f (v_p / l) t_p,   g_f = sum_p v_p t_p . n_f / sum_p v_p

The unit vector t_p goes from a point's foot on the held edge to the point. The way v_p goes from that edge to the point
on the flat cloth, and l is the largest such way. The level normal of the held edge is n_f. The loss has the sign of the
lean. Cloth that swings to one side loses its border, cloth that swings to the other seems longer.

The amplitude is a, the loss [m] at the border per unit of lean; positive eats cloth that leans along the normal.

Believe it when the cloth looks shorter on one side of its swing than on the other, and its length at rest is right. A
loss that stays the same is `corner_erosion`. Points that the garment file states as material are left as they are.

Source: a re-gridded silhouette (github Alados5/tfm_matlab) whose length is 262 mm moving away and 309 mm approaching.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from fit.cloth.effect import Effect
from fit.recordings.hanger_path import level_normal
from fit.recordings.recording import Recording
from formats.arrays import Floats


@dataclass(frozen=True)
class ErodedOutline(Effect):
    """Loss of the far border per unit of the cloth's lean."""

    name: ClassVar[str] = "eroded_outline"
    title: ClassVar[str] = "an outline that is eroded by pose"
    acts_on: ClassVar[str] = "measurement"
    unit: ClassVar[str] = "m"
    low: ClassVar[float] = -0.15  # our choice: as far as `high`
    high: ClassVar[float] = 0.15  # our choice: about three times the 47 mm between the source's two lengths
    typical: ClassVar[float] = 0.03  # our choice: about two thirds of those 47 mm
    # How the loss grows with the lean, and how far into the cloth it reaches. Our choice: laws may leave 0.36 of a gap;
    # half and double were not tried.
    law_spread: ClassVar[float] = 0.2

    def observe(self, points: Floats, recording: Recording, amplitude: Floats) -> Floats:
        """Return the points drawn towards the held edge, or away from it, by pose."""
        if amplitude[0] == 0.0 or recording.garment.points_are == "material":
            return points
        outline = np.asarray(recording.garment.outline_m[:2], float)
        edge = outline[1] - outline[0]
        places = np.array([p.at_m for p in recording.garment.points]) - outline[0]
        share, way = places @ edge / (edge @ edge), places @ np.array([edge[1], -edge[0]]) / np.linalg.norm(edge)
        held = recording.held(recording.time)
        normal, ends = level_normal(held), held.reshape(-1, 2, 3)
        apart = points - (ends[:, None, 0] + share[None, :, None] * (ends[:, None, 1] - ends[:, None, 0]))
        down = apart / np.maximum(np.linalg.norm(apart, axis=2, keepdims=True), 1e-9)
        far = np.maximum(way, 0.0) / max(float(way.max()), 1e-9)
        lean = np.einsum("fpx,fx,p->f", down, normal, far / max(float(far.sum()), 1e-9))
        return np.asarray(points - amplitude[0] * lean[:, None, None] * far[:, None] * down)

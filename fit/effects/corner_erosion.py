"""Corner erosion: a silhouette loses its corners or its whole border, so points appear too far inside.

    corners:  y = x + a (c - x) / |c - x|                for points at the free corners of the outline
    border:   y = x + (b / half) (c - x)                 for every point, b at the middle of the border

with the middle c of the simulated points and half the garment's smaller side.

The amplitude is how far [m] points move inwards, at the corners and at the border; positive is inwards.

Believe it when points at free corners or borders lie inside the cloth even while the cloth hangs still. The loss
stays the same however the cloth moves.

Source: opening of a silhouette by a disc removes its corners; P. Soille, "Morphological Image Analysis" (2003),
section 4.2.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from fit.cloth.effect import Effect
from fit.recordings.recording import Recording
from formats.arrays import Floats

AT_CORNER = 0.12  # of the garment's smaller side: points nearer to a corner of the outline than this sit at it


@dataclass(frozen=True)
class CornerErosion(Effect):
    """Distance by which free corners, and the whole border, are seen inside their true positions."""

    name: ClassVar[str] = "corner_erosion"
    title: ClassVar[str] = "an eroded silhouette"
    acts_on: ClassVar[str] = "measurement"
    unit: ClassVar[str] = "m"
    low: ClassVar[float] = -0.005  # our choice: a border seen 2 px too far out, at 1.6 m and f = 576 px
    high: ClassVar[float] = 0.04  # our choice: 14 px, at 1.6 m and f = 576 px
    typical: ClassVar[float] = 0.008  # our choice: 3 px, at 1.6 m and f = 576 px
    # How far into the border the loss reaches. Our choice: laws may leave 0.36 of a gap, half and double untried.
    law_spread: ClassVar[float] = 0.2
    components: ClassVar[tuple[str, ...]] = ("corners", "border")

    def regions(self, amplitude: Floats) -> tuple[str, ...]:
        """Return the free corners, or nothing where the whole border is eroded more than they are."""
        return ("bottom left", "bottom right") if abs(amplitude[0]) >= abs(amplitude[1]) else ()

    def observe(self, points: Floats, recording: Recording, amplitude: Floats) -> Floats:
        """Return the points drawn inwards."""
        outline = np.array(recording.garment.outline_m)
        places = np.array([p.at_m for p in recording.garment.points])
        half = 0.5 * float(np.ptp(outline, axis=0).min())
        free = outline[outline[:, 1] < outline[:, 1].max() - half]
        at_corner = (np.linalg.norm(places[:, None] - free[None], axis=2) < AT_CORNER * half * 2).any(1)
        inwards = points.mean(1, keepdims=True) - points
        unit = inwards / np.maximum(np.linalg.norm(inwards, axis=2, keepdims=True), 1e-9)
        return np.asarray(points + amplitude[0] * at_corner[:, None] * unit + amplitude[1] / half * inwards)

"""Sliding points: a grid is laid evenly over what the camera sees of the cloth, so its points slide along it.

    y_p = x_p + a s_f v_p t_p,   s_f = l_f / l - 1

A point has the way v_p from the held edge, and t_p is the downward tangent of the simulated cloth there. The flat grid
has the length l, and the tracked grid the length l_f in frame f. Points without a grid are left as they are. Likewise
left are points that keep their lengths within 1 %, and points at their material positions.

The amplitude is a, the share of the sliding that the grid's length shows; 1 is all of it.

Believe it when lengths between neighbours shrink and stretch together. Markers cannot do so.

Source: a re-gridded silhouette (github Alados5/tfm_matlab) whose length is 262 mm moving away and 309 mm approaching.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from fit.cloth.effect import Effect
from fit.recordings.grids import Grid
from fit.recordings.recording import Recording
from formats.arrays import Floats

# Of its length, root mean square, by which a grid of material points changes at most. Our choice: the source's grid
# changes by 8 % to either side. Half and double were not tried.
GRID_STAYS = 0.01


@dataclass(frozen=True)
class SlidingPoints(Effect):
    """Share of the sliding that the tracked grid's length shows."""

    name: ClassVar[str] = "sliding_points"
    title: ClassVar[str] = "points that slide over the cloth"
    acts_on: ClassVar[str] = "measurement"
    unit: ClassVar[str] = "1"
    low: ClassVar[float] = 0.0
    high: ClassVar[float] = 1.5  # our choice: half as much again as all of the sliding
    typical: ClassVar[float] = 0.5  # our choice: half of the sliding
    # How evenly a grid is laid. Our choice: laws may leave 0.36 of a gap; half and double were not tried.
    law_spread: ClassVar[float] = 0.2

    def observe(self, points: Floats, recording: Recording, amplitude: Floats) -> Floats:
        """Return the points where the grid has slid to."""
        if amplitude[0] == 0.0 or recording.camera.is_placed:
            return points
        grid = recording.grid
        slide = None if grid is None else slides(recording, grid)
        if grid is None or slide is None:
            return points
        laid = points[:, grid.at]
        tangent = np.gradient(laid, grid.down, axis=1)
        tangent /= np.maximum(np.linalg.norm(tangent, axis=3, keepdims=True), 1e-9)
        moved = points.copy()
        moved[:, grid.at] = laid + amplitude[0] * slide[:, None, None, None] * grid.down[:, None, None] * tangent
        return moved


def slides(recording: Recording, grid: Grid) -> Floats | None:
    """Return the share by which the tracked grid is longer than the flat one, (frames,); None of a grid that stays."""
    length = recording.grid_length
    seen = np.isfinite(length)
    if seen.sum() < 2:
        return None
    share = np.interp(recording.time, recording.time[seen], length[seen]) / grid.down[-1] - 1
    return np.asarray(share) if np.sqrt(np.mean((share - share.mean()) ** 2)) > GRID_STAYS else None

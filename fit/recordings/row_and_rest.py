"""Two errors that a camera leaves in a silhouette: an error of the held row, and the lean of cloth at rest.

The held row follows the hanger. After late time stamps are corrected, its position across the cloth still varies in the
hanger's frame. No cloth model explains this error, which all points of a frame share.

Limp cloth at rest hangs along gravity. It may lean out of the vertical, along the level normal of the held edge. The
reason is a tilt of the rig's gravity or of the camera, or a steady draught. The lean is a robust mean over the frames
at rest (`fit.recordings.robust_line`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fit.recordings.grids import Grid
from fit.recordings.hanger_path import in_hanger_frame
from fit.recordings.outline import lean_of
from fit.recordings.robust_line import interval_of, robust_line, seconds_apart
from fit.recordings.timing import row_middle
from formats.arrays import Floats

FEWEST_AT_REST = 3  # half seconds; our choice: a spread of two has one degree of freedom; double was not tried
LOST_ROW = 5.0  # times the median distance: beyond, the row of a frame counts as lost


@dataclass(frozen=True)
class Lean:
    """Lean of cloth at rest [rad], with its 90 % interval; positive along the level normal of the held edge."""

    angle: float
    interval: tuple[float, float]


def row_off(points: Floats, ends: Floats, grid: Grid) -> float:
    """Return the error of the held row across the cloth [m], the root mean square deviation over frames.

    points [m], (frames, points, 3), NaN where not seen; ends [m], (frames, 6), of the held edge
    """
    row = row_middle(points[:, grid.at[0]], grid.across - grid.across.mean())
    there = np.isfinite(row).all(1)
    if not there.any():
        return 0.0
    away = in_hanger_frame(row, ends)[there, 2]
    away = np.abs(away - np.median(away))
    kept = away <= max(LOST_ROW * float(np.median(away)), 1e-6)
    return float(np.sqrt(np.mean(away[kept] ** 2)))


def find_lean(time: Floats, points: Floats, ends: Floats, grid: Grid) -> Lean | None:
    """Return the lean of the cloth in frames in which the hanger is at rest; None for too few frames.

    time [s], (frames,); points [m], (frames, points, 3), NaN where not seen; ends [m], (frames, 6)
    """
    lean = lean_of(points, ends, grid)
    seen = np.isfinite(lean)
    if not seen.any() or len(np.unique(block := seconds_apart(time[seen]))) < FEWEST_AT_REST:
        return None
    angles = np.arcsin(np.clip(lean[seen], -1.0, 1.0))
    (middle,), (half,) = robust_line(np.ones((len(angles), 1)), angles, block)
    return Lean(float(middle), interval_of(middle, half))

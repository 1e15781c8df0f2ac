"""Estimate the error across the cloth that all points of a silhouette's frame share, from the held row.

The held row follows the hanger, whatever the cloth does. After late time stamps are corrected, its position on the
hanger still has an error while the hanger moves. All points of a frame share this error: over time they are smoother
about the row than about the hanger's path (`benchmarks/real_cloth_frames.py`). A delay of the single frame causes such
an error, and so does a late registration of the picture. Both move the row and the cloth alike. So the row's error is
subtracted from the whole frame, whatever its cause.

An error proportional to the hanger's position is a scale or a turn. It is left for the diagnosis: e_f is the residual
of a line through the position of the hanger's middle. With the hanger's speed v_f,

    e_f = n_f + d_f,   n_f ~ N(0, n^2),   d_f ~ N(0, (k v_f)^2)
    k^2 = sum (e_f^2 - n^2) / sum v_f^2

n is the row's noise while the hanger stands still, and k [s] belongs to the mean square. The conditional mean of d_f is
subtracted. Its variance remains, and that of the line's four coefficients:

    mean = g_f e_f,   variance = g_f n^2 + 4 sd(e)^2 / frames,   g_f = (k v_f)^2 / ((k v_f)^2 + n^2)

Nothing is subtracted unless k^2 is certain. Its deviation combines that of its half-second parts and that of n^2. The
latter, from a median absolute deviation of m frames, is n^2 sqrt(2 / (0.37 m)). In the plane of the cloth the row is
eroded like every border, so its errors there are no information on the frame. Source: B. Efron & C. Morris, "Stein's
estimation rule and its competitors", J. Am. Stat. Assoc. 68 (1973).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fit.recordings.hanger_path import Curve, hanger_axes, in_hanger_frame
from fit.recordings.robust_line import robust_line, seconds_apart
from fit.recordings.timing import (
    CLOSEST,
    FEWEST_NOISE_FRAMES,
    LEAST_NOISE,
    MEDIAN_TELLS,
    STILL,
)
from formats.arrays import Floats
from formats.held_row import FEWEST_BLOCKS

CERTAIN = 3.0  # standard errors of k^2: 2 of 100 recordings without offsets exceed it, because the error is skewed
# deviations: beyond, the row of a frame counts as lost. Gaussian noise lies beyond once in 2 million frames. On the 16
# public recordings of swung cloth half makes the offsets 3 % smaller, and double leaves them as they are.
LOST = 5.0


@dataclass(frozen=True)
class FrameOffsets:
    """Errors that all points of a frame share.

    - `moved` [m], (frames, 3): world frame; 0 where the row is not seen
    - `rms` [m]: over the frames in which the hanger moves
    - `left` [m]: root mean square deviation of the subtracted offsets
    """

    moved: Floats
    rms: float
    left: float


def find_frame_offsets(time: Floats, row: Floats, path: Curve) -> FrameOffsets | None:
    """Return the errors of whole frames across the cloth; None if they are not certain or the row is hardly seen.

    time [s], (frames,); row [m], (frames, 3): its middle, NaN where not seen; path: of the held ends
    """
    ends = path(time)
    speed = np.linalg.norm(path(time + CLOSEST) - path(time - CLOSEST), axis=1) / (2 * CLOSEST * np.sqrt(2))
    across = in_hanger_frame(row, ends)[:, 2]
    seen = np.isfinite(across)
    still, moving = seen & (speed < STILL), seen & (speed >= STILL)
    block = seconds_apart(time)
    if still.sum() < FEWEST_NOISE_FRAMES or len(np.unique(block[moving])) < FEWEST_BLOCKS:
        return None
    place = ends.reshape(-1, 2, 3).mean(1)
    line = np.column_stack([np.ones(len(place)), place - place.mean(0)])
    error = across - line @ robust_line(line[seen], across[seen], block[seen])[0]
    noise = max(1.4826 * float(np.median(np.abs(error[still] - np.median(error[still])))), LEAST_NOISE)
    usual = np.hypot(noise, 1.4826 * float(np.median(np.abs(error[moving]) / speed[moving])) * speed)
    seen &= np.abs(error) <= LOST * usual
    used = seen & moving
    excess, weight = error[used] ** 2 - noise**2, speed[used] ** 2
    square = float(excess.sum() / weight.sum())
    parts = np.bincount(block[used], excess - square * weight) / weight.sum()
    of_noise = noise**2 * np.sqrt(2 / (MEDIAN_TELLS * still.sum())) * len(weight) / weight.sum()
    if not square > CERTAIN * float(np.sqrt((parts**2).sum() + of_noise**2)):
        return None
    own = square * speed**2
    gain = np.where(seen, own / (own + noise**2), 0.0)
    taken = np.where(seen, gain * error, 0.0)
    of_line = (1.4826 * float(np.median(np.abs(error[used])))) ** 2 * line.shape[1] / used.sum()
    return FrameOffsets(
        moved=taken[:, None] * hanger_axes(ends)[:, :, 2],
        rms=float(np.sqrt((taken[used] ** 2).mean())),
        left=float(np.sqrt(noise**2 * gain[seen].mean() + of_line)),
    )

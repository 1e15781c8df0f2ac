"""Reject outliers among the garment's points: accelerations are bounded, and a true point is detected twice.

    |p(t) - p'(t)| <= 4 sd + a dt (dt + dt') / 2           p' extrapolates the last two detections, dt' apart
    |p(t) - p(t - dt)| <= 4 sd + a dt^2 / 2 + v dt         where only one detection is known

The mean velocity between two detections is the velocity halfway between them. So the first bound is a dt^2 at a steady
frame rate, the second difference of an evenly accelerated point.

A point that was lost for longer than `POINT_MEMORY` counts again from its second detection on. So a fold that looks
like a corner for one frame does not count. In the first detections after any gap, only the image can reveal a wrong
corner. So its deviation is larger by a share of `UNSETTLED_SD` along each axis. A wrong corner moves the centre by a
share of its own error, and the centre's deviation grows by that share. Rejected points are marked as missing; nothing
replaces them.
"""

from __future__ import annotations

import numpy as np

from formats.arrays import Booleans, Floats

# m/s^2, a free corner that reverses at the end of a hard swing. On nine scenes at 1.6 m (`benchmarks/tracking.py --set
# development-11`) 96.7 % of the visible corners are located. Half gives 94.8 %, and double 97.1 % with a 95 % error
# that is 0.05 mm larger.
HARDEST_WHIP = 60.0
# m/s, the hem in the hardest swing by hand. Half and double change the corners' 95 % by at most 0.02 mm there.
FASTEST_POINT = 6.0
# s, after which a point may be anywhere. Half puts the corners' 95 % at 9.6 mm in place of 9.9 there, and double at
# 10.2 mm; they locate 96.5 and 97.2 %.
POINT_MEMORY = 0.2

# consecutive detections after which a prediction is trusted. Our choice: the fewest that have a speed. Double changes
# stated deviations alone: those of the centre are then 7 % larger.
SETTLED = 2
# m in depth: on the sets `development` and `development-2` of `benchmarks/stated_noise.py` such corners err by 12 mm
# rms, and state 8 mm without it. Half and double change the deviation of the corners' z by at most 0.005 on the nine
# scenes.
UNSETTLED_SD = 0.010


class MotionGate:
    """Rejects detections that contradict the motion of their point."""

    def __init__(self, points: int, shares: Floats | None = None) -> None:
        """Prepare for points; shares, (points, 3): of a wrong corner's error in depth along each axis, 1 by default."""
        self._unsettled = UNSETTLED_SD * (np.ones((points, 3)) if shares is None else shares)
        self._place = np.full((points, 3), np.nan)
        self._velocity = np.full((points, 3), np.nan)  # NaN where only one detection is known
        self._time = np.full(points, -np.inf)
        self._interval = np.zeros(points)  # s over which the velocity was found
        self._frame = -np.inf  # time of the frame before
        self._in_a_row = np.full(points, SETTLED)

    def admit(self, places: Floats, sd: Floats, time: float, weak: Booleans | None = None) -> tuple[Booleans, Floats]:
        """Return which points agree with their earlier motion, and all standard deviations [m], (points, 3).

        - `places` [m], (points, 3): positions, NaN if not detected
        - `sd` [m], (points, 3)
        - `time` [s], increasing
        - `weak`, (points,): detections that do not count while their point is lost, or has just come back
        """
        seen, is_first = np.isfinite(places).all(1), np.isinf(self._time)
        gone = time - self._time
        missed = self._time < self._frame
        if weak is not None:
            seen &= ~(weak & (missed | (self._in_a_row < SETTLED)))
        self._frame = time
        # One detection predicts a position for the next frame only.
        fresh = is_first | (missed & (np.isnan(self._velocity).any(1) | (gone > POINT_MEMORY)))
        dt = np.where(fresh, 0.0, gone)
        leap = np.linalg.norm(places - self._place - np.nan_to_num(self._velocity) * dt[:, None], axis=1)
        unknown = np.where(np.isnan(self._velocity).any(1), FASTEST_POINT * dt, 0.0)
        whipped = 0.5 * HARDEST_WHIP * dt * (dt + self._interval)
        follows = seen & ~fresh & (leap <= 4.0 * np.linalg.norm(sd, axis=1) + whipped + unknown)
        moved, begins = follows & (dt > 0), seen & fresh
        self._velocity[moved] = (places - self._place)[moved] / dt[moved, None]
        self._interval[moved] = dt[moved]
        self._velocity[begins], self._interval[begins] = np.nan, 0.0
        self._in_a_row[seen & missed & ~is_first] = 0
        unsettled = np.where((self._in_a_row < SETTLED)[:, None], self._unsettled, 0.0)
        self._in_a_row[follows] += 1
        self._place = np.where((follows | begins)[:, None], places, self._place)
        self._time = np.where(follows | begins, time, self._time)
        return follows | (begins & is_first), np.hypot(sd, unsettled)

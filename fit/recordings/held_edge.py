"""Rotation and slip of the held edge against the hanger's path, from tracked points on this edge.

These points measure the boundary, not the cloth.

The displacements of the edge's points are measured from the straight line between the held ends, perpendicular to the
bar: level, and upwards. They give

    turn     slopes over the position along the edge: yaw and roll of the edge against the path
    slip     the instant at which one side drops and stays down: the largest step of the mean height of a side's
             points, |sum_k<=m (z_k - mean z)| / (sigma sqrt(m (n - m) / n)), where it is beyond what slow noise makes;
             else, and where no point of the edge is tracked, just after the hanger's hardest jerk

Source: E. S. Page, Biometrika 41 (1954) and 42 (1955) (cumulative sums, a change of the mean at an unknown point).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fit.recordings.smoothing import noise_of, smoothing_spline
from formats.arrays import Booleans, Floats
from formats.findings import FEWEST_SEEN

Curve = Callable[[Floats], Floats]

CERTAIN_STEP = 8.0  # standard errors: noise correlated over a third of a second reaches 5 to 6
LEAST_EDGE_SPREAD = 0.25  # of the spread of all edge points: least spread of the seen ones in a frame that counts
OUTER = 0.6  # of the edge's length from the other end: points beyond show the motion of an end
# At either end of a take, where no step can be detected. Our choice: a mean of five frames has 0.45 times the noise of
# one. With 2, 5 and 10 one of 2000 columns of noise exceeds `CERTAIN_STEP` (measured, 4 s at 30 frames a second).
FRAMES_ASIDE = 5
JERK_STEP = 0.005  # s between instants in the search of the hardest jerk; our choice: a sixth of a frame at 30 a second
# s from a jerk to the middle of the slip that it causes. Our choice: the step of `fit.effects.clip_slip` follows the
# blind check's slip, of 40 ms, best when it is half complete after 32 ms. For 20 ms after 18, and for 80 ms after 58
# (measured).
SLIP_DELAY = 0.03


@dataclass(frozen=True)
class HeldEdge:
    """Tracked points on the held edge.

    - `time` [s], (frames,)
    - `points` [m], (frames, points, 3), NaN where not seen
    - `across` [m], (points,): their positions along the edge
    - `held`: maps (n,) instants [s] to (n, 6), the edge's ends [m]
    """

    time: Floats
    points: Floats
    across: Floats
    held: Curve

    def turn(self) -> tuple[Curve, Floats]:
        """Return yaw and roll against the path [rad] at instants [s], (n,) -> (n, 2), and their rms, (2,)."""
        arm = self._arm()
        sides = self._displacements
        seen = np.isfinite(sides).all(2)
        # Slopes are about the middle of a frame's seen points, so that a shifted edge shows no rotation at gaps.
        apart = seen * (arm - (seen * arm).sum(1, keepdims=True) / np.maximum(seen.sum(1, keepdims=True), 1))
        spread = (apart**2).sum(1)
        usable = spread > LEAST_EDGE_SPREAD * (arm**2).sum()
        if usable.sum() < FEWEST_SEEN:
            return lambda instants: np.zeros((len(instants), 2)), np.zeros(2)
        slopes = (np.nan_to_num(sides) * apart[..., None]).sum(1)[usable] / spread[usable, None]
        scale = np.maximum(np.sqrt((slopes**2).mean(0)), 1e-6)
        splines = smoothing_spline(self.time[usable], slopes / scale)
        first, last = self.time[usable][0], self.time[usable][-1]
        return lambda instants: np.asarray(scale * splines(np.clip(instants, first, last))), scale

    def slip_at(self) -> float:
        """Return the instant at which a slip in the clips would be half complete [s]."""
        steps = [self._step(side) for side in self._sides()]
        certainty, instant = max(steps, default=(0.0, 0.0))
        return instant if certainty > CERTAIN_STEP else self._hardest_jerk() + SLIP_DELAY

    def _arm(self) -> Floats:
        """Return positions along the edge from their middle [m], (points,)."""
        return np.asarray(self.across - self.across.sum() / max(len(self.across), 1))

    @cached_property
    def _displacements(self) -> Floats:
        """Return level and upward displacements from the line between the ends [m], (frames, points, 2)."""
        held = self.held(self.time).reshape(-1, 2, 3)
        bar = held[:, 1] - held[:, 0]
        length = np.linalg.norm(bar, axis=1, keepdims=True)
        level = np.cross([0.0, 0.0, 1.0], bar / np.maximum(length, 1e-9))
        apart = self.points - held.mean(1)[:, None]
        upwards = apart[..., 2] - self._arm() * (bar[:, 2:] / np.maximum(length, 1e-9))
        return np.stack([np.einsum("fpc,fc->fp", apart, level), upwards], 2)

    def _sides(self) -> list[Booleans]:
        """Return which points show the left and the right end, each (points,), or nothing without points."""
        if len(self.across) == 0:
            return []
        share = (self.across - self.across.min()) / max(float(np.ptp(self.across)), 1e-9)
        return [share <= 1 - OUTER, share >= OUTER]

    def _step(self, chosen: Booleans) -> tuple[float, float]:
        """Return the largest step of the points' mean height, in standard errors, and its instant [s]."""
        heights = self._displacements[:, chosen, 1]
        seen = np.isfinite(heights).any(1)
        if seen.sum() < FEWEST_SEEN:
            return 0.0, 0.0
        height, time = np.nanmean(heights[seen], axis=1), self.time[seen]
        count = len(height)
        before = np.arange(1, count + 1)
        sums = np.abs(np.cumsum(height - height.mean()))
        errors = np.sqrt(before * (count - before) / count) * max(noise_of(height), 1e-6)
        inside = slice(FRAMES_ASIDE, -FRAMES_ASIDE)
        steps = sums[inside] / errors[inside]
        place = int(np.argmax(steps))
        return float(steps[place]), float(time[inside][place])

    def _hardest_jerk(self) -> float:
        instants = np.arange(0.0, self.time[-1], JERK_STEP)
        middle = self.held(instants).reshape(-1, 2, 3).mean(1)
        acceleration = np.linalg.norm(np.gradient(np.gradient(middle, instants, axis=0), instants, axis=0), axis=1)
        return float(instants[2:-2][int(np.argmax(acceleration[2:-2]))])


def place_along(places: Floats, ends: Floats) -> tuple[Floats, Booleans]:
    """Return each position's share of the distance between two ends, (n,), and whether it lies on the line."""
    way = ends[1] - ends[0]
    share = (places - ends[0]) @ way / (way @ way)
    aside = np.linalg.norm(places - ends[0] - share[:, None] * way, axis=1)
    near = 1e-6 * float(np.linalg.norm(way))
    return share, (aside < near) & (share > -1e-6) & (share < 1 + 1e-6)

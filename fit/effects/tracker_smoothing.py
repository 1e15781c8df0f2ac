"""Tracker smoothing: a tracker with a smoothness prior flattens the wrinkles of its points.

    y_p = (1 - a) x_p + a mean_{q near p} x_q

The points q near p are the nearest pair that lies opposite each other on the flat garment, and the nearest pair across.
On a grid of any pitch these are the four neighbours. Points on the border use only neighbours along the border, so flat
cloth stays where it is. Some trackers smooth over more than the nearest points. Their smoothing removes more than this
mean and looks like a share above 1.

The amplitude is a, never negative.

Believe it when folds are flatter in the points than in the simulation, in rest and in motion alike. Stiffer cloth
folds less too, but swings otherwise.

Source: Laplacian smoothing, G. Taubin, "A signal processing approach to fair surface design" (SIGGRAPH 1995), section
2.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from fit.cloth.effect import Effect
from fit.recordings.recording import Recording
from formats.arrays import Floats

ACROSS_BELOW = 0.7  # cosine of 45 degrees: a pair of neighbours further from another pair crosses that pair
# Times as far as the nearest pair, within which one across it is a neighbour. Our choice: on a grid of any such pitch
# the four neighbours count. Half would leave only the nearest pair; double was not tried.
FARTHEST_PAIR = 2.0


@dataclass(frozen=True)
class TrackerSmoothing(Effect):
    """Share of each point that is replaced by the mean of its neighbours."""

    name: ClassVar[str] = "tracker_smoothing"
    title: ClassVar[str] = "a tracker that smooths out wrinkles"
    acts_on: ClassVar[str] = "measurement"
    unit: ClassVar[str] = "1"
    low: ClassVar[float] = 0.0
    high: ClassVar[float] = 1.5  # our choice: trackers that smooth over more points look like a share above 1
    typical: ClassVar[float] = 0.4  # our choice: close to half of each point
    # Trackers differ in their neighbours and weights. Our choice: laws may leave 0.81 of a gap, more than any effect
    # may (`fit.gap.evidence.MOST_UNEXPLAINED`). So twice changes nothing there; at half they may leave 0.2.
    law_spread: ClassVar[float] = 0.3

    def observe(self, points: Floats, recording: Recording, amplitude: Floats) -> Floats:
        """Return the smoothed points."""
        if amplitude[0] == 0.0:
            return points
        mixing = opposite_neighbours(np.array([p.at_m for p in recording.garment.points]))
        return np.asarray(points + amplitude[0] * (np.einsum("pq,fqc->fpc", mixing, points) - points))

    def unobserved(self, targets: Floats, recording: Recording, amplitude: Floats) -> Floats:
        """Return targets with the smoothing inverted to first order; the lost wrinkles stay lost."""
        known = recording.has_curve  # points without a curve have no targets
        mixing = opposite_neighbours(np.array([p.at_m for p in recording.garment.points])[known])
        share, found = min(float(amplitude[0]), 1.0), targets.copy()
        found[:, known] += share * (targets[:, known] - np.einsum("pq,fqc->fpc", mixing, targets[:, known]))
        return found


def opposite_neighbours(places: Floats) -> Floats:
    """Return the mean of opposite neighbours as a matrix, (points, points): pairs q, r with p in their middle."""
    count = len(places)
    mixing = np.zeros((count, count))
    tolerance = 1e-3 * max(float(np.ptp(places, axis=0).max()), 1e-9)
    for p in range(count):
        mirrored = 2 * places[p] - places
        apart = np.linalg.norm(places[None] - mirrored[:, None], axis=2)
        q = np.nonzero(apart < tolerance)[0]
        reach = np.linalg.norm(places[q] - places[p], axis=1)
        other = reach > tolerance
        if not other.any():
            mixing[p, p] = 1.0
            continue
        chosen = other & (reach <= 1.01 * reach[other].min())
        along = (places[q] - places[p]) / np.maximum(reach, tolerance)[:, None]
        across = (
            other
            & (np.abs(along @ along[chosen].T).max(1) < ACROSS_BELOW)
            & (reach < FARTHEST_PAIR * reach[chosen].min())
        )
        if across.any():
            chosen |= across & (reach <= 1.01 * reach[across].min())
        np.add.at(mixing[p], q[chosen], 1.0 / chosen.sum())
    return mixing

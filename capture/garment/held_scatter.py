"""Measure the errors of held corners from the held edge, whose ends the markers show ten times as well.

A held corner is found in the image beside a side of the cloth, and its depth from the cloth below. Its distance d from
the end of the held edge, along each axis, is therefore nearly its error. One distance says little of the deviation s.
So the variance is the mean of what is stated and of what recent frames showed, with a memory of tau:

    s'^2 = s^2 (n_0 + sum_k w_k d_k^2 / s_k^2) / (n_0 + sum_k w_k),    w_k = exp(-(t - t_k) / tau)

The sum includes the frame itself. A frame whose distance is far beyond is wrong at once, so that s' is no less than

    |d| - 2 s

Along y the held edge is itself the cloth's side, so that distances are short there
whatever the error is. So the variance never falls along y, and grows at least by the part (y / z)^2 of depth's growth.
"""

from __future__ import annotations

import math

import numpy as np

from formats.arrays import Booleans, Floats

# frames, the weight n_0 of the stated variance. On the sets `development` and `development-2` of
# `benchmarks/stated_noise.py` single recordings state 0.91 to 1.16 of their error along x. Half gives 0.93 to 1.24, and
# double 0.88 to 1.06.
STATED_FRAMES = 3.0
# s, of the memory: a swing's hardest part is about as long. Half and double give 0.90 to 1.13 and 0.90 to 1.14.
HELD_MEMORY = 0.2
# own deviations along each axis by which a held corner and the held edge's end differ from noise alone: 95 % do
SURPRISE = 2.0


class HeldScatter:
    """Remembers how far held corners were from the ends of the held edge, in stated deviations."""

    def __init__(self, corners: int) -> None:
        self._sum = np.zeros((corners, 3))
        self._weight = np.zeros(corners)
        self._time = -math.inf

    def stated(self, places: Floats, apart: Floats, sd: Floats, is_held: Booleans, time: float) -> Floats:
        """Return the standard deviations [m], (corners, 3), of corners in a frame at a time [s].

        places, apart, sd [m], (corners, 3): positions, distances from the ends of the held edge, stated deviations;
        is_held, (corners,): which corners are such ends. The others' deviations stay.
        """
        fade = math.exp(-(time - self._time) / HELD_MEMORY)
        self._time = time
        self._sum *= fade
        self._weight *= fade
        self._sum[is_held] += (apart[is_held] / sd[is_held]) ** 2
        self._weight[is_held] += 1.0
        grown = (STATED_FRAMES + self._sum) / (STATED_FRAMES + self._weight)[:, None]
        surprise = np.maximum(np.nan_to_num(np.abs(apart)) - SURPRISE * sd, 0.0)
        variance = np.maximum(sd**2 * grown, surprise**2)
        by_depth = (places[:, 1] / places[:, 2]) ** 2 * (variance[:, 2] - sd[:, 2] ** 2)
        variance[:, 1] = np.maximum(variance[:, 1], sd[:, 1] ** 2 + np.maximum(by_depth, 0.0))
        return np.where(is_held[:, None], np.sqrt(variance), sd)

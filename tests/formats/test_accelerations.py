"""How hard a held end may be accelerated between sights at uneven steps: the noise of a second difference."""

from __future__ import annotations

import numpy as np
import pytest

from formats.motion import HARDEST_PULL
from formats.sights import accelerations

TIME = np.array([0.0, 0.1, 0.3, 0.4, 0.5])  # steps of 0.1, 0.2, 0.1 and 0.1 s


def of_one_off(sight, metres):
    """Accelerations of ends that rest, but for one sight of the first end."""
    ends = np.zeros((len(TIME), 2, 3))
    ends[sight, 0, 1] = metres
    return accelerations(TIME, ends)


def test_noise_of_uneven_steps_is_that_of_three_independent_positions():
    """A position of 1 m at the third of five sights; second differences weigh it and its neighbours.

        0.1 and 0.2 s   2/0.3 (10, -15, 5)     2/0.3 sqrt(350)    5 of them, 33.3 m/s^2
        0.2 and 0.1 s   2/0.3 (5, -15, 10)     2/0.3 sqrt(350)    15 of them, 100 m/s^2
        0.1 and 0.1 s   2/0.2 (10, -20, 10)    10 sqrt(600)       10 of them, 100 m/s^2

    The deviations that would make these are 5 and 15 over sqrt(350) and 1 over sqrt(6). The last one is the median.
    """
    pull, most = of_one_off(2, 1.0)
    assert pull[:, 0] == pytest.approx([100 / 3, 100.0, 100.0])
    gains = np.sqrt([350.0, 350.0, 600.0]) * [20 / 3, 20 / 3, 10.0]
    assert most[:, 0] == pytest.approx(np.hypot(HARDEST_PULL, 10 * gains / np.sqrt(6)))
    assert most[:, 1] == pytest.approx(HARDEST_PULL)  # the other end rests


def test_the_noise_of_an_acceleration_adds_what_each_sight_alone_moves_it_by():
    """Independent positions of deviation 1: the root of the sum of squares over the five sights."""
    moved = np.stack([of_one_off(sight, 1.0)[0][:, 0] for sight in range(len(TIME))])
    gains = np.sqrt((moved**2).sum(0))
    path = np.random.default_rng(3).normal(0, 0.05, (len(TIME), 2, 3))
    pull, most = accelerations(TIME, path)
    noise = np.median(pull / gains[:, None], axis=0)
    assert most == pytest.approx(np.hypot(HARDEST_PULL, 10 * gains[:, None] * noise))

"""How many residuals are independent, against white noise, a swing and a first-order autoregression."""

from __future__ import annotations

import numpy as np
import pytest

from fit.search.correlation import independent


def autoregression(rho, shape, seed=0):
    """r_t = rho r_t-1 + e_t, begun in its stationary spread, (series, frames)."""
    random = np.random.default_rng(seed)
    rows = random.normal(size=shape)
    for t in range(1, shape[1]):
        rows[:, t] = rho * rows[:, t - 1] + np.sqrt(1 - rho**2) * rows[:, t]
    return rows


def as_take(rows):
    """Series, (series, frames), as a take's (frames, points, 3)."""
    return np.moveaxis(rows.reshape(-1, 3, rows.shape[1]), -1, 0)


@pytest.mark.parametrize("shape", [(9, 300), (15, 180)])
def test_white_noise_counts_every_number(shape):
    assert independent([as_take(np.random.default_rng(1).normal(size=shape))]) == pytest.approx(
        shape[0] * shape[1], rel=0.03
    )


@pytest.mark.parametrize("rho", [0.5, 0.8])
def test_points_that_move_together_count_once_by_their_time(rho):
    """Its squares go together for (1 + rho^2) / (1 - rho^2) frames; chance doubles the sum or more."""
    rows = autoregression(rho, (1, 2000))
    found = independent([as_take(np.repeat(rows, 15, axis=0) * np.linspace(1, 3, 15)[:, None])])
    assert found == pytest.approx(independent([rows.T]), rel=1e-6)
    assert 0.35 < found / (2000 * (1 - rho**2) / (1 + rho**2)) < 1.0


def test_an_error_that_swings_to_and_fro_counts_once_a_take():
    """The mean square of 15 swings of 40 frames each is that of one number or two, whatever the points."""
    swing = np.sin(2 * np.pi * np.arange(600) / 40)
    assert 1.0 < independent([np.outer(swing, np.ones(15))]) < 3.5


def test_frames_that_are_not_seen_change_nothing_but_the_spread():
    rows = autoregression(0.8, (1, 2000)) * np.ones((15, 1))
    whole = independent([as_take(rows)])
    gaps = np.random.default_rng(2).random(rows.shape) < 0.3
    assert independent([as_take(np.where(gaps, np.nan, rows))]) == pytest.approx(whole, rel=0.15)
    unseen = np.concatenate([as_take(rows), np.full((7, 5, 3), np.nan)])
    assert independent([unseen]) == pytest.approx(whole)


def test_takes_add_and_a_take_without_residuals_counts_its_numbers():
    white = as_take(np.random.default_rng(3).normal(size=(15, 200)))
    slow = as_take(autoregression(0.8, (15, 200)))
    assert independent([white, slow]) == pytest.approx(independent([white]) + independent([slow]))
    assert independent([np.zeros((20, 3))]) == 60


def test_the_number_by_hand():
    """Residuals 2, 2, 2, 1: chance leaves (13 / 4)^2 = 10.56, so lag 0 counts 13^2 / 4 - 10.56 = 31.69.

    Lag 1 has 10^2 / 3 = 33.33, more than twice chance; lag 2 has 6^2 / 2 = 18, and lag 3 has 2^2 = 4, less.
    """
    assert independent([np.array([[2.0], [2.0], [2.0], [1.0]])]) == pytest.approx(169 / (31.6875 + 2 * 100 / 3))

"""How long residuals go together, against the closed form of a first-order autoregression."""

from __future__ import annotations

import numpy as np
import pytest

from fit.search.correlation import correlation_time, independent


def autoregression(rho, shape, seed=0):
    """r_t = rho r_t-1 + e_t, begun in its stationary spread, (series, frames)."""
    random = np.random.default_rng(seed)
    rows = random.normal(size=shape)
    for t in range(1, shape[1]):
        rows[:, t] = rho * rows[:, t - 1] + np.sqrt(1 - rho**2) * rows[:, t]
    return rows


@pytest.mark.parametrize("rho", [0.5, 0.8, 0.95])
def test_an_autoregression_goes_together_for_one_plus_rho_over_one_minus_rho(rho):
    rows = autoregression(rho, (15, 2000))
    assert correlation_time(rows) == pytest.approx((1 + rho) / (1 - rho), rel=0.15)


def test_white_noise_counts_every_number_and_errors_that_swing_no_more_than_that():
    random = np.random.default_rng(1)
    assert correlation_time(random.normal(size=(15, 300))) == pytest.approx(1.0, abs=0.1)
    assert correlation_time(autoregression(-0.6, (15, 300))) == 1.0
    assert correlation_time(np.zeros((3, 20))) == 1.0


def test_what_stays_the_same_goes_together_for_the_whole_take():
    assert correlation_time(np.ones((4, 100))) == pytest.approx(99.0)


def test_frames_that_are_not_seen_change_nothing_but_the_spread():
    rows = autoregression(0.8, (15, 2000))
    rows[np.random.default_rng(2).random(rows.shape) < 0.3] = np.nan
    assert correlation_time(rows) == pytest.approx(9.0, rel=0.15)


def test_each_take_counts_by_its_own_time():
    """15 series each, as five points' axes: one take is white, one has a time of nine frames and begins unseen."""
    rows = [np.random.default_rng(3).normal(size=(15, 1000)), autoregression(0.8, (15, 1000))]
    white, slow = (np.moveaxis(r.reshape(5, 3, 1000), -1, 0) for r in rows)
    found = independent([white, np.concatenate([np.full((7, 5, 3), np.nan), slow])])
    assert found == pytest.approx(15_000 + 15_000 / 9, rel=0.05)

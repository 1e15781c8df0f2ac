"""The effective number of independent residuals, for white noise, a swing and a first-order autoregression."""

from __future__ import annotations

import numpy as np
import pytest

from fit.search.correlation import independent


def autoregression(rho, shape, seed=0):
    """r_t = rho r_t-1 + e_t from its stationary distribution, (series, frames)."""
    random = np.random.default_rng(seed)
    rows = random.normal(size=shape)
    for t in range(1, shape[1]):
        rows[:, t] = rho * rows[:, t - 1] + np.sqrt(1 - rho**2) * rows[:, t]
    return rows


def as_take(rows):
    """Series, (series, frames), as a take's (frames, points, 3)."""
    return np.moveaxis(rows.reshape(-1, 3, rows.shape[1]), -1, 0)


@pytest.mark.parametrize(
    ("series", "frames", "unseen", "share"),
    [
        (1, 200, 0, 0.98),
        (3, 200, 0, 0.96),
        (6, 200, 0, 0.93),
        (9, 200, 0, 0.97),
        (15, 100, 0, 0.97),
        (9, 200, 0.3, 0.94),
    ],
)
def test_white_noise_counts_whole_with_few_series_and_with_gaps(series, frames, unseen, share):
    """Of one point, of several, and with a hole wherever chance has it; the share has an error of 0.02 of 30 takes."""
    random = np.random.default_rng(series)
    found = []
    for _ in range(30):
        take = random.normal(size=(frames, series))
        take[random.random(take.shape) < unseen] = np.nan
        found.append(independent([take]) / np.isfinite(take).sum())
    assert np.mean(found) == pytest.approx(share, abs=0.06)
    assert max(found) <= 1.0


def test_series_of_other_spread_count_by_their_variance():
    """Variances 1 to 9 in white noise: (sum variance)^2 / sum variance^2 series of one spread, of 7 of 9."""
    spread = np.linspace(1, 3, 9)
    takes = np.random.default_rng(5).normal(size=(20, 200, 9)) * spread
    whole = 200 * (spread**2).sum() ** 2 / (spread**4).sum()
    assert np.mean([independent([take]) for take in takes]) == pytest.approx(whole, rel=0.08)


@pytest.mark.parametrize("rho", [0.5, 0.8])
def test_points_that_move_together_count_once_by_their_time(rho):
    """Its squares go together for (1 + rho^2) / (1 - rho^2) frames; chance doubles the sum or more."""
    rows = autoregression(rho, (1, 500))
    found = independent([as_take(np.repeat(rows, 15, axis=0) * np.linspace(1, 3, 15)[:, None])])
    assert found == pytest.approx(independent([as_take(np.repeat(rows, 6, axis=0))]), rel=1e-6)
    assert 0.3 < found / (500 * (1 - rho**2) / (1 + rho**2)) < 1.0


@pytest.mark.parametrize("points", [3, 15])
def test_an_error_that_swings_to_and_fro_counts_twice_a_take(points):
    """A sine of any phase is two numbers. Swings of 40 frames, 15 of them: T^2 / sum_l (T - |l|) cos^2 is 2."""
    swing = np.sin(2 * np.pi * np.arange(600) / 40 + 0.7)
    assert independent([np.outer(swing, np.ones(points))]) == pytest.approx(2.0, rel=0.03)


def test_frames_that_are_not_seen_change_nothing_but_the_spread():
    rows = autoregression(0.8, (1, 500)) * np.ones((15, 1))
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


@pytest.mark.parametrize(("frames", "series", "number"), [(16, 1, 256 / 145), (5, 6, 900 / 648), (3, 6, 324 / 72)])
def test_the_number_of_a_constant_by_hand(frames, series, number):
    """Ones of T frames and K series: chance leaves K^2 at each lag, lag 0 counts K^2 (T - 1), and lag l K^2 (T - l).

    One series counts lags of more than 10.83 (chi square of one, 1 of 1000): 15, 14, 13, 12 and 11 pairs, 15 + 2 x 65.
    Six count those of more than 2: 144 + 2 x 36 x (4 + 3). Two pairs are twice the chance and no more: 72.
    """
    assert independent([np.ones((frames, series))]) == pytest.approx(number)


def by_pairs(take, exceeded):
    """The number of one take as the formula says, pair by pair."""
    frames, series = take.shape
    variances = np.nanmean(take**2, axis=0)
    together = 0.0
    for lag in range(frames):
        squares = chance = 0.0
        for i in range(series):
            for j in range(series):
                products = take[: frames - lag, i] * take[lag:, j]
                if pairs := np.isfinite(products).sum():
                    squares += np.nansum(products) ** 2 / pairs
                    chance += variances[i] * variances[j]
        together += squares - chance if lag == 0 else 2 * squares * (squares > exceeded * chance)
    return np.nansum(take**2) ** 2 / together


def test_the_number_of_series_of_other_variance_by_hand():
    """Constants 1 and 2, variances 1 and 4: k^2 = (25 / 17)^2 = 2.163, which 6.58 times exceeds once of 1000.

    Chance leaves 25. Each lag has 25 (T - l), so those with more than 6.58 pairs count: of 10 frames 9, 8 and 7.
    """
    assert independent([np.outer(np.ones(10), [1.0, 2.0])]) == pytest.approx(50**2 / (25 * (9 + 2 * 24)))


@pytest.mark.parametrize(("series", "exceeded"), [(1, 10.828), (2, 18.467 / 4), (3, 27.877 / 9), (7, 2.0)])
def test_the_number_of_a_swing_with_gaps_is_the_formulas(series, exceeded):
    """Quantiles of chi square, 1 of 1000, of 1, 4 and 9 degrees of freedom. The first and last point share no frame."""
    random = np.random.default_rng(series)
    take = np.sin(np.arange(40) / 5)[:, None] + 0.5 * random.normal(size=(40, series))
    take[random.random(take.shape) < 0.2] = np.nan
    if series > 1:
        take[:20, 0], take[20:, -1] = np.nan, np.nan
    take /= np.sqrt(np.nanmean(take**2, axis=0))  # equal variances, so that the degrees of freedom are whole
    number = by_pairs(take, exceeded)
    assert number < np.isfinite(take).sum()
    assert independent([take]) == pytest.approx(number, rel=1e-9)


@pytest.mark.parametrize("series", [1, 2, 5, 9])
def test_one_frame_counts_its_numbers(series):
    """Chance leaves all of its squares, so that only a rounding error is left to divide by."""
    random = np.random.default_rng(series)
    assert [independent([random.normal(size=(1, series))]) for _ in range(50)] == [series] * 50


def test_the_number_does_not_depend_on_the_unit_of_the_residuals():
    take = as_take(autoregression(0.8, (6, 200)))
    assert independent([1e-6 * take]) == pytest.approx(independent([take]))

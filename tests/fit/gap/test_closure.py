"""Closure, its interval and its significance: closed forms, and coverage on oscillations of known truth."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import norm
from scipy.stats import t as student

from fit.gap.closure import (
    BlockErrors,
    Resampling,
    block_errors,
    closure,
    error_interval,
    exceeds,
    gain_p_value,
    resample,
    share_of,
    solver_draws,
)
from fit.gap.correlation import block_correlation, ringing_of
from fit.methods import SI
from fit.observer.residuals import Observer
from tests.fit.gap.oscillation import POINTS, RATE, SHAPES, oscillation
from tests.fit.gap.test_gap_statistics import a_still_take

HUNDRED = Resampling(np.repeat(np.arange(101)[:, None], 2, 1), 1.0)  # each draw is one of 101 blocks


def errors_of(*squared, count=10.0, correlation=None):
    """Blocks of `count` points with these mean squared errors [mm^2] each."""
    sums = count * np.asarray(squared, float)
    return BlockErrors(sums, np.full(len(sums), count), np.zeros(3), correlation=correlation)


def level(squared, blocks=8):
    return errors_of(*[squared] * blocks)


def test_the_error_of_blocks_is_the_mean_over_their_points():
    """12 mm^2 in 30 points and 4 in 10: 10 mm^2."""
    errors = BlockErrors(np.array([360.0, 40.0]), np.array([30.0, 10.0]), np.zeros(3))
    assert errors.squared_mm == pytest.approx(10.0)
    picks = np.array([[0, 1], [0, 0], [1, 1]])
    assert errors.draw(Resampling(picks, 1.0)) == pytest.approx([10.0, 12.0, 4.0])
    assert errors.draw(Resampling(picks, 2.0)) == pytest.approx([10.0, 14.4, 1.6])
    assert level(0.0, 2).draw(Resampling(picks, 2.0)) == pytest.approx(np.zeros(3))
    small = replace(errors, sums=1e-3 * errors.sums)  # an error of less than a millimetre
    assert small.draw(Resampling(picks, 2.0)) == pytest.approx([0.010, 0.0144, 0.0016])


def test_closure_is_the_share_of_the_gap_that_is_removed():
    """100 mm^2 without, 36 with, floor 4 mm: (100 - 36) / (100 - 16) = 0.762, the same in every block."""
    found = closure(level(100.0), level(36.0), 4.0)
    assert found == pytest.approx((64 / 84, pytest.approx((64 / 84, 64 / 84))))


def test_closure_is_not_given_where_there_is_hardly_a_gap():
    """A twentieth of the floor's 16 mm^2: from 16.8 mm^2 on."""
    assert closure(level(16.79), level(16.0), 4.0) is None
    found = closure(level(16.81), level(16.0), 4.0)
    assert found is not None
    assert found[0] == pytest.approx(1.0)
    assert closure(level(4e-8), level(0.0), 0.0) is None  # a floor is a micrometre at least
    assert closure(level(6e-8), level(0.0), 0.0) is not None


def test_the_interval_of_closure_is_that_of_a_ratio():
    """Of 100 mm^2 each, 40 and 60 by turns are left: 0.5, sd 0.1 sqrt(8/7) / sqrt(8), t of 7 degrees of freedom."""
    value, (low, high) = closure(level(100.0), errors_of(*[40.0, 60.0] * 4), 0.0)
    assert value == pytest.approx(0.5)
    half = student.ppf(0.95, 7) * 0.1 / np.sqrt(7)
    assert (low, high) == pytest.approx((0.5 - half, 0.5 + half))
    # With n_eff = 8 / (1 + 7/2) of 1.78 three are counted.
    alike = np.full((8, 8), 0.5) + 0.5 * np.eye(8)
    base = errors_of(*[100.0] * 8, correlation=alike)
    _, (low, high) = closure(base, errors_of(*[40.0, 60.0] * 4), 0.0)
    half = student.ppf(0.95, 2) * 0.1 * np.sqrt(8 / 7 / 3)
    assert (low, high) == pytest.approx((0.5 - half, 0.5 + half))


def test_an_effect_that_closes_the_same_share_everywhere_is_sure_however_the_motion_differs():
    """1, 10 and 100 mm^2 of which 0.9 are closed; where the largest block alone closes less, few blocks decide."""
    sizes = np.array([1.0, 10.0, 100.0] * 4)
    _, (low, high) = closure(errors_of(*sizes), errors_of(*(0.1 * sizes)), 0.0)
    assert (low, high) == pytest.approx((0.9, 0.9))
    base, after = errors_of(*[1.0] * 9, 1000.0), errors_of(*[0.1] * 9, 900.0)
    assert share_of(base, after, 0.0).freedom == pytest.approx(2.0)
    assert gain_p_value(base, after, 0.0) > 0.01


def test_a_half_second_below_the_noise_is_no_independent_piece_of_the_gap():
    """Gaps of 84, 84, 84 and -12 mm^2, of which 64, 40, 50 and 0 close: three pieces, and two degrees of freedom."""
    base, left = errors_of(100.0, 100.0, 100.0, 4.0), errors_of(36.0, 60.0, 50.0, 4.0)
    gaps, gains = np.array([84.0, 84.0, 84.0, -12.0]), np.array([64.0, 40.0, 50.0, 0.0])
    value, whole = 154 / 240, 240.0
    rest = np.array([156.0, 156.0, 156.0, 240.0])  # the gap without a block; the last one has none to lose
    sd = np.sqrt(3 / 4 * (((gains - value * gaps) / rest) ** 2).sum())
    assert whole == gaps.sum()
    found = share_of(base, left, 16.0)
    assert (found.value, found.error, found.freedom) == pytest.approx((value, sd, 2.0))


def test_an_uncertain_floor_widens_the_interval_of_closure():
    """d closure / d floor = 2 x 5 x (50/75) / 75 per mm, times t of two degrees of freedom times 0.05 mm."""
    value, (low, high) = closure(level(100.0), level(50.0), 5.0, floor_error_mm=0.05, replicas=3)
    half = student.ppf(0.95, 2) * 0.05 * 10 * value / 75
    assert (low, high) == pytest.approx((value - half, value + half))


def test_the_interval_of_an_error_holds_nine_draws_in_ten():
    """Half-seconds of 1, 2, ... 101 mm, each alone in a draw."""
    assert error_interval(errors_of(*np.arange(1.0, 102.0) ** 2), HUNDRED) == pytest.approx((6.0, 96.0))


def test_an_error_is_above_a_known_one_where_both_its_mean_and_its_lowest_draws_are():
    """21 mm^2 is more than 1.2 times 17, and not of 18; with half-seconds between 1 and 41 mm^2 it may be less."""
    one = Resampling(np.zeros((10, 8), int), 1.0)
    assert exceeds(level(21.0), one, 17.0)
    assert not exceeds(level(21.0), one, 18.0)
    assert not exceeds(errors_of(*np.linspace(1, 41, 101)), HUNDRED, 17.0)
    assert not exceeds(errors_of(*np.linspace(11, 31, 101)), HUNDRED, 17.0)
    assert exceeds(errors_of(*np.linspace(18, 24, 101)), HUNDRED, 17.0)


def test_draws_are_as_wide_as_few_correlated_blocks_require():
    """sqrt(8/7) t(7) / z for eight independent blocks; with n_eff = 8 / (1 + 7/2) of 1.78 three are counted."""
    rng = np.random.default_rng(0)
    z = norm.ppf(0.95)
    assert resample(level(9.0), rng).spread == pytest.approx(np.sqrt(8 / 7) * student.ppf(0.95, 7) / z)
    assert resample(level(9.0, 2), rng).spread == pytest.approx(np.sqrt(2) * student.ppf(0.95, 2) / z)
    assert resample(level(9.0, 1), rng).spread == pytest.approx(student.ppf(0.95, 2) / z)
    alike = np.full((8, 8), 0.5) + 0.5 * np.eye(8)
    found = resample(errors_of(*[9.0] * 8, correlation=alike), rng)
    assert found.spread == pytest.approx(np.sqrt(8 / 7) * np.sqrt(8 / 3) * student.ppf(0.95, 2) / z)
    assert found.picks.shape == (1000, 8)
    assert set(np.unique(found.picks)) == set(range(8))


def gaining(gains, correlation=None):
    """Errors of half-seconds before and after something that closes so much of each."""
    counts, none = np.ones(len(gains)), np.zeros(3)
    before = BlockErrors(np.full(len(gains), 9.0), counts, none, correlation=correlation)
    return before, BlockErrors(9.0 - np.asarray(gains), counts, none, correlation=correlation)


def test_the_test_of_a_gain_is_the_interval_of_its_share():
    """At p = 0.05 the interval of 90 % ends at nothing; gains that are losses prove nothing."""
    before, gains = level(9.0), np.array([1.0, 1.0, 1.0, -1.0] * 2)
    after = BlockErrors(before.sums - gains, before.counts, np.zeros(3))
    mean, sd = 0.5, np.sqrt(8 / 7 * 0.75 / 8)
    assert gain_p_value(before, after, 0.0) == pytest.approx(student.sf(mean / sd, 7))
    assert gain_p_value(after, before, 0.0) > 0.9
    low = share_of(before, after, 0.0)
    assert (low.value > student.ppf(0.95, 7) * low.error) == (gain_p_value(before, after, 0.0) < 0.05)


def test_where_nothing_is_beyond_the_noise_the_share_is_of_the_whole_error():
    before, after = errors_of(9.0, 9.2, 8.8, 9.1), errors_of(8.9, 9.0, 8.9, 9.0)
    assert gain_p_value(before, after, 3.0) == pytest.approx(gain_p_value(before, after, 0.0))
    assert gain_p_value(before, after, 2.0) != pytest.approx(gain_p_value(before, after, 0.0))


def test_many_hypotheses_that_leave_one_residual_are_moved_as_one():
    shape = np.random.default_rng(3).normal(size=60)
    moved = solver_draws([BlockErrors(np.ones(1), np.ones(1), k * shape) for k in range(1, 13)], 1.0, 50)
    assert moved == pytest.approx(moved[:, :1] * np.arange(1, 13), rel=1e-3, abs=1e-3)


def test_a_wrong_solver_moves_squared_errors_by_twice_the_product_and_alike_ones_together():
    """2 N r / sqrt(9) with N = 3 mm and r = 2 mm rms: 4 mm^2; a residual at right angles moves on its own."""
    vectors = np.array([[2.0, 2.0, 2.0, 0, 0, 0], [2.0, 2.0, 2.0, 0, 0, 0], [0, 0, 0, 2.0, 2.0, 2.0]]) * np.sqrt(2 / 3)
    moved = solver_draws([BlockErrors(np.ones(1), np.ones(1), v) for v in vectors], 3.0, 20000)
    assert moved.std(0) == pytest.approx([4.0, 4.0, 4.0], rel=0.03)
    assert moved[:, 0] == pytest.approx(moved[:, 1], abs=1e-6)
    assert abs(np.corrcoef(moved[:, 0], moved[:, 2])[0, 1]) < 0.03
    again = solver_draws([BlockErrors(np.ones(1), np.ones(1), v) for v in vectors], 3.0, 20000)
    assert np.array_equal(again, moved)  # a diagnosis of the same takes says the same


def test_a_residual_is_gathered_by_half_seconds_in_millimetres():
    """3 mm aside in the first half-second and 1 mm later, of 20 points that are not on the edge."""
    recording = a_still_take(0.0, rate=30, seconds=2.0)
    observer = Observer([recording], SI, (), frequency=0.0)
    aside = np.where(recording.time < 0.5, 0.003, 0.001)[:, None, None] * np.array([0.0, 1.0, 0.0])
    found = block_errors(observer, observer.residuals_of([(recording.points + aside)[None]])[0])
    assert found.counts == pytest.approx([15 * 20] * 4)
    assert found.sums / found.counts == pytest.approx([9.0, 1.0, 1.0, 1.0], rel=1e-6)
    assert found.residual.shape == (60 * 20 * 3,)
    assert found.between_blocks.shape == (4, 4)


def test_half_seconds_in_which_nothing_was_seen_are_no_blocks():
    recording = a_still_take(0.001, rate=30, seconds=2.0)
    valid = recording.valid.copy()
    valid[15:30] = False
    valid[45:60, 20:] = False
    observer = Observer([replace(recording, valid=valid)], SI, (), frequency=0.0)
    found = block_errors(observer, observer.residuals_of([recording.points[None] + 0.001])[0])
    assert found.counts == pytest.approx([15 * 20, 15 * 20, 15 * 15])
    assert found.between_blocks.shape == (3, 3)


# Takes of 6 s, as many as a diagnosis has; the damped oscillation of a hanging sheet that swings at 0.8 Hz.
TAKES, FRAMES, HERTZ, NOISE = 3, 180, 0.8, 0.5
DECAYS = [1.0, pytest.param(0.5, marks=pytest.mark.slow), pytest.param(2.0, marks=pytest.mark.slow)]  # s
BLOCKS = np.arange(FRAMES) // 15
LAYOUT = SimpleNamespace(
    block=np.concatenate([BLOCKS + 12 * k for k in range(TAKES)]), take=np.repeat(np.arange(TAKES), FRAMES),
    is_judged=np.ones(TAKES * FRAMES, bool),
)  # fmt: skip


def summed(per_frame):
    """Sums over half-seconds of every take, (blocks,), of a number per frame, (takes, frames)."""
    return np.bincount(LAYOUT.block, np.concatenate(per_frame))


def ringing(rng, decay, shapes):
    return [oscillation(rng, FRAMES, decay, HERTZ, shapes=shapes) for _ in range(TAKES)]


def correlation_seen(takes):
    return block_correlation(LAYOUT, ringing_of(takes, RATE))


def errors_in(takes, correlation):
    return BlockErrors(
        summed([(one**2).sum((1, 2)) for one in takes]), np.full(12 * TAKES, 15.0 * POINTS), np.zeros(3),
        correlation=correlation,
    )  # fmt: skip


@pytest.mark.parametrize("decay", DECAYS)
def test_a_model_that_is_no_better_is_significant_as_often_as_is_said(decay):
    """Two errors that ring at 0.8 Hz, as large and unrelated: 5 % of 200, 3 to 9 %; most where they ring longest.

    One that leaves a fifth of what another one misses, and rings on its own with half the size, is always found.
    """
    rng = np.random.default_rng(int(10 * decay))
    none, real = [], []
    for _ in range(200):
        shapes = rng.normal(size=(SHAPES, POINTS * 3))
        first, second = (ringing(rng, decay, shapes) for _ in "12")
        noise = [NOISE * rng.normal(size=one.shape) for one in first]
        base = [one + n for one, n in zip(first, noise, strict=True)]
        correlation = correlation_seen(base)
        before = errors_in(base, correlation)
        for kept, share in ((none, (0.0, 1.0)), (real, (0.2, 0.5))):
            left = [share[0] * a + share[1] * b + n for a, b, n in zip(first, second, noise, strict=True)]
            p_value = gain_p_value(before, errors_in(left, correlation), NOISE * np.sqrt(3))
            kept.append(p_value < (0.05 if kept is none else 0.05 / 6))
    assert 0.03 <= np.mean(none) <= 0.09
    assert np.mean(real) > 0.95


@pytest.mark.parametrize("decay", DECAYS)
def test_the_interval_of_closure_covers_the_truth_as_often_as_is_said(decay):
    """What is left rings on its own with half the size and holds a fifth of the rest: 1 - 1/4 - 1/25 = 71 %."""
    rng = np.random.default_rng(int(10 * decay))
    covered = []
    for _ in range(200):
        shapes = rng.normal(size=(SHAPES, POINTS * 3))
        before, other = (ringing(rng, decay, shapes) for _ in "12")
        noise = [NOISE * rng.normal(size=one.shape) for one in before]
        base = [one + n for one, n in zip(before, noise, strict=True)]
        left = [0.2 * one + 0.5 * two + n for one, two, n in zip(before, other, noise, strict=True)]
        correlation = correlation_seen(base)
        both = [errors_in(takes, correlation) for takes in (base, left)]
        _, (low, high) = closure(*both, NOISE * np.sqrt(3))
        covered.append(low <= 0.71 <= high)
    assert 0.85 <= np.mean(covered) <= 0.95


def test_a_large_error_of_few_blocks_is_above_the_noise_however_correlated_they_are():
    """Half-seconds of 16 to 19 mm that are as good as two: 17.5 mm, and surely not the noise's 2."""
    alike = np.full((8, 8), 0.9) + 0.1 * np.eye(8)
    errors = errors_of(*np.linspace(16, 19, 8) ** 2, correlation=alike)
    resampling = resample(errors, np.random.default_rng(0))
    assert resampling.spread > 2.0
    assert exceeds(errors, resampling, 2.0**2)
    low, high = error_interval(errors, resampling)
    assert 15.0 < low < 17.0 < 18.0 < high < 20.0
    # Whether there is a gap is a question of the noise, whose half-seconds are independent.
    assert error_interval(errors, replace(resampling, spread=30.0))[0] ** 2 < 16.5**2 / 1.2
    assert exceeds(errors, replace(resampling, spread=30.0), 16.5**2 / 1.2)

"""Parts of the comparison of filtered copies by hand: steps, noise, smoothing, lags, and what is compared at all."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from fit.recordings import filtered_copies
from fit.recordings.filtered_copies import (
    TAPS,
    Motion,
    _lags,
    _left,
    _Near,
    _noise_in,
    _power,
    _residual,
    _Smoothed,
    _step_of,
    noise_left,
)


def shown(positions):
    """Smoothed positions of which every step is seen."""
    return _Smoothed(positions, np.ones(positions.shape[:2], bool))


def wandering(steps, points=2, seed=0):
    """Positions [m], (steps, points, 3), of smooth random motion by some tenths of a metre."""
    drawn = np.random.default_rng(seed).normal(size=(steps, points, 3))
    kernel = np.hanning(9)
    return 0.05 * np.apply_along_axis(lambda one: np.convolve(one, kernel, "same"), 0, drawn)


@pytest.mark.parametrize(("step", "found"), [(2e-4, 2e-4), (0.5, 1e-3), (1e-10, 1e-3)])
def test_the_step_of_a_file_is_the_least_difference_along_each_coordinate(step, found):
    """Between coordinates there are smaller ones, and rounding errors and large steps show none."""
    along = step * np.array([0.0, 3.0, 1.0, 6.0])[:, None, None]
    assert _step_of(along + np.array([0.0, 3e-5, 7e-5])) == pytest.approx(found)


def test_noise_is_what_sixth_differences_of_frames_in_a_row_leave():
    """Trembling by a has differences of 64 a; a frame that is not seen takes six of them away."""
    sign = (-1.0) ** np.arange(20)[:, None]
    positions = sign * np.array([1e-3, 2e-3, 0.0])
    expected = (64e-3 / 0.6745) ** 2 * (1 + 4)
    assert _noise_in(positions) == pytest.approx(expected)
    positions[10] = np.nan
    assert _noise_in(positions) == pytest.approx(expected)
    assert _noise_in(positions[7:14]) == 0.0


@pytest.mark.parametrize(("apart", "share"), [(0.0, 1.0), (2.0, math.exp(-1.0)), (1e3, 0.0)])
def test_neighbouring_smoothed_noise_is_correlated_by_a_gaussian(apart, share):
    assert _power(np.array([2.0, -3.0]), apart) == pytest.approx(4 + 9 - 2 * 6 * share)


def test_a_corner_is_rounded_by_the_gaussian_and_a_straight_way_is_kept():
    """A change of speed by 3 m/s adds 3 tau phi(0) at the corner, and nothing five tau away."""
    time = np.arange(0, 4, 0.05)
    tau, read = 0.1, np.array([1.0, 2.0, 3.0])
    bent = np.stack([time, np.maximum(time - 2.0, 0.0) * 3.0, 0 * time], 1)
    found = _Near(time, read, tau).smoothed(bent, np.ones(len(time), bool))
    assert found[:, 0] == pytest.approx(read)
    assert found[:, 1] == pytest.approx([0.0, 3 * tau / math.sqrt(2 * math.pi), 3.0], abs=1e-6)
    near = _Near(time, read, tau)
    assert near.share_seen(np.ones(len(time), bool)) * 0.05 == pytest.approx(np.ones(3), abs=1e-3)
    assert near.share_seen(time < 2.0) * 0.05 == pytest.approx([1.0, 0.5, 0.0], abs=0.11)
    assert not near.smoothed(bent[:0], np.zeros(len(time), bool)).any()


def test_repeated_frames_and_a_clock_that_goes_back_do_not_count():
    time = np.array([0.0, 0.1, 0.2, 0.15, 0.3, 0.4])
    positions = np.arange(6.0)[:, None, None] * np.ones((1, 2, 3))
    positions[2] = positions[1]  # repeated, in a frame of its own
    motion = Motion(time, positions, np.ones((6, 2), bool))
    assert motion._time == pytest.approx([0.0, 0.1, 0.3, 0.4])
    assert motion.interval == pytest.approx(0.1)
    unseen = np.ones((6, 2), bool)
    unseen[4] = False  # what is not seen is no news
    assert Motion(time, positions, unseen)._time == pytest.approx([0.0, 0.1, 0.4])
    assert not Motion(time[:1], positions[:1], np.ones((1, 2), bool)).can_be_compared


@pytest.mark.parametrize(("last", "can_be"), [(9.9, True), (10.1, False)])
def test_a_clock_that_jumps_by_ten_times_the_takes_frames_is_not_compared(last, can_be):
    time = np.append(np.arange(9) * 0.1, last)
    motion = Motion(time, np.arange(10.0)[:, None, None] * np.ones((1, 1, 3)), np.ones((10, 1), bool))
    assert motion.can_be_compared == can_be


@pytest.mark.parametrize(("ratio", "is_compared"), [(19.9, True), (20.1, False), (1 / 19.9, True), (1 / 20.1, False)])
def test_takes_of_rates_twenty_times_apart_are_not_compared(monkeypatch, ratio, is_compared):
    """Smoothed over two intervals of the slower take, or up to a fifth more: four steps an octave."""
    taus = []

    def take(interval):
        def smoothed(points, tau):
            taus.append(tau)
            return SimpleNamespace(seen=np.zeros(200))

        return SimpleNamespace(interval=interval, can_be_compared=True, smoothed=smoothed, noise=lambda *_: 0.0)

    fewest = []
    monkeypatch.setattr(filtered_copies, "_lags", lambda x, y, least: fewest.append(least) or [3, -5])
    monkeypatch.setattr(filtered_copies, "_left", lambda x, y, lag, *_: {3: 0.5, -3: 0.4, -5: 0.3, 5: 0.9}[lag])
    found = noise_left(take(0.01), take(0.01 / ratio), np.arange(2))
    assert found == (0.3 if is_compared else np.inf)
    if is_compared:
        slower = 0.01 * max(1.0, 1 / ratio)
        assert 2 * slower <= taus[0] < 2 * slower * 2**0.25
        assert fewest == [pytest.approx(max(2.0 / taus[0] * 2, 0.2 * 200))]
    assert noise_left(take(0.01), take(0.01), np.arange(0)) == np.inf


@pytest.mark.parametrize("lag", [25, -25, 0])
def test_the_likeliest_lag_is_that_of_the_second_takes_clock(lag):
    whole = wandering(400)
    x, y = whole[50:300], whole[50 - lag : 300 - lag]
    first, *others = _lags(shown(x), shown(y), 100.0)
    assert first == lag
    assert len(others) == 2
    assert all(abs(other - lag) > TAPS for other in others)
    assert all(abs(other) <= 50 for other in _lags(shown(x), shown(y), 200.0))  # 250 steps less the lag
    assert _lags(shown(x), shown(0 * y), 100.0) == []


def test_accelerations_are_seen_between_two_seen_steps_and_jumps_are_cut_off():
    """At 1 a step squared all the way; a jump's differences are cut to the 95 % quantile, which is 1."""
    positions = np.zeros((60, 1, 3))
    positions[:, 0, 0] = 0.5 * np.arange(60) ** 2
    positions[30:, 0, 1] = 1000.0
    smoothed = shown(positions)
    found = np.linalg.norm(smoothed.accelerations[:, 0], axis=1)
    assert found == pytest.approx([0.0, *58 * [1.0], 0.0])
    smoothed = shown(positions)
    smoothed.seen[10] = False
    found = np.linalg.norm(smoothed.accelerations[:, 0], axis=1)
    assert np.flatnonzero(found == 0).tolist() == [0, 9, 10, 11, 59]


def test_cloth_has_moved_where_any_point_is_off_its_first_place():
    positions = np.zeros((6, 2, 3))
    positions[3:, 1, 2] = 2 * filtered_copies.AT_REST
    positions[0, 1] = 9.0
    seen = np.ones((6, 2), bool)
    seen[0, 1] = seen[4] = False
    assert _Smoothed(positions, seen).moved.tolist() == [False, False, False, True, False, True]


def test_a_filter_and_a_turn_leave_nothing_of_a_filtered_turned_copy():
    whole = wandering(300)[:, 0]
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    shifted = np.stack([whole[50 + k : 250 + k] for k in (-1, 0, 1)])
    filtered = np.tensordot([0.2, 0.7, 0.1], shifted, 1) @ turn + [1.0, 2.0, 3.0]
    error, taps = _residual(shifted, filtered)
    assert np.abs(error).max() < 1e-3 * np.ptp(whole)
    assert taps == pytest.approx([0.2, 0.7, 0.1], abs=0.02)


@pytest.mark.parametrize(("steps", "fewest", "is_known"), [(200, 184, True), (200, 185, False), (38, 10, False)])
def test_a_lag_is_judged_on_enough_steps_and_numbers(steps, fewest, is_known):
    """Eight steps at either end are the filter's; 0.6 of 3 x 22 numbers are fewer than 80."""
    x = shown(wandering(steps, points=1))
    noises = np.full(1, 1e-6), np.full(1, 1e-6)
    assert np.isfinite(_left(x, x, 0, fewest, noises)) == is_known

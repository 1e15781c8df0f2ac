"""The delay of time stamps from the held row, and no estimate where it is not identifiable."""

from __future__ import annotations

import numpy as np
import pytest

from fit.recordings.hanger_path import held_curve
from fit.recordings.timing import find_timing, in_order, row_middle
from tests.fit.recordings.silhouettes import path, uneven

NOISE = 0.003  # m per axis of the row's middle, that of the real recordings at rest


def ends_of(middle):
    half = np.array([0.15, 0.0, 0.0])
    return np.concatenate([middle - half, middle + half], 1)


def timing_of(time, true, *, noise=NOISE, seed=0, still=False, **options):
    fine = np.linspace(time[0], time[-1], 4000)
    row = np.stack([np.interp(true, fine, axis) for axis in path(fine).T], 1) * (0.0 if still else 1.0)
    row = row + [0.004, -0.012, 0.003] + noise * np.random.default_rng(seed).standard_normal(row.shape)
    held = path(time) * (0.0 if still else 1.0)
    return find_timing(time, row, held_curve(time, ends_of(held), 4.0), **options)


@pytest.mark.parametrize("late", [-0.2, 0.0, 0.05, 0.1, 0.2, 0.33])
@pytest.mark.parametrize("is_even", [True, False])
def test_a_latency_is_found_with_its_size(late, is_even):
    """12 s at 9 frames a second and 3 mm of noise give it to 10 ms: a row of 0.4 m/s moves by 4 mm in that time."""
    time = np.arange(0, 12, 1 / 9) if is_even else uneven()
    found = timing_of(time, time - late, is_per_frame=False)
    low, high = found.latency_interval
    assert found.latency == pytest.approx(late, abs=0.008)
    assert low - 0.003 < late < high + 0.003
    assert 0.001 < high - low < 0.02
    assert found.is_late == (late != 0.0) or abs(found.latency) < 0.005


@pytest.mark.slow
def test_nine_of_ten_intervals_hold_the_truth():
    """A 90 % interval holds it in 33 to 40 of 40, the 2 % and 98 % quantiles of a binomial number being 32 and 39."""
    held = 0
    for seed in range(40):
        time = uneven(seed=seed)
        low, high = timing_of(time, time - 0.1, seed=seed, is_per_frame=False).latency_interval
        held += low < 0.1 < high
    assert held >= 32


def test_stamps_of_publishing_are_late_by_a_share_of_the_interval_before():
    time = uneven()
    step = np.concatenate([[0.0], np.diff(time) - np.median(np.diff(time))])
    found = timing_of(time, time - 0.2 - 0.9 * step, is_per_frame=False)
    low, high = found.share_interval
    assert found.latency == pytest.approx(0.2, abs=0.01)
    assert found.share == pytest.approx(0.9, abs=0.1)
    assert 0.5 < low < 0.9 < high < 1.3
    assert found.shifts[1:] == pytest.approx((0.2 + 0.9 * step)[1:], abs=0.02)


def test_the_deviation_of_frames_own_shifts_is_found():
    """Shifts of 30 ms rms show while the hanger moves; the stamps stay as they are."""
    time = np.arange(0, 12, 1 / 9)
    own = 0.03 * np.random.default_rng(5).standard_normal(len(time)).clip(-2, 2)
    found = timing_of(time, time - own)
    assert found.deviation == pytest.approx(0.03, rel=0.35)
    assert found.shifts == pytest.approx(found.latency)


def test_frames_without_shifts_get_none():
    time = np.arange(0, 12, 1 / 9)
    assert sum(timing_of(time, time - 0.1, seed=seed).deviation > 0 for seed in range(20)) <= 1


def test_a_hanger_that_stands_still_gives_no_evidence():
    time = uneven()
    assert timing_of(time, time, still=True) is None


def test_a_row_of_another_take_does_not_follow_the_hanger():
    time = uneven()
    fine = np.linspace(time[0], time[-1], 4000)
    other = np.stack([0 * fine, 0.12 * np.sin(2 * np.pi * 0.43 * fine + 1), 0 * fine], 1)
    row = np.stack([np.interp(time, fine, axis) for axis in other.T], 1)
    found = find_timing(time, row, held_curve(time, ends_of(path(time)), 4.0))
    assert found is None or not found.follows


def test_the_middle_of_a_row_does_not_depend_on_which_of_it_is_seen():
    across = np.linspace(-0.15, 0.15, 5)
    points = np.zeros((3, 5, 3))
    points[..., 0], points[..., 2] = across, 0.1 * across + 0.7
    points[1, 0], points[2, 1:] = np.nan, np.nan
    middle = row_middle(points, across)
    assert middle[:2] == pytest.approx(np.tile([0.0, 0.0, 0.7], (2, 1)))
    assert np.isnan(middle[2]).all()


def test_frames_that_a_shift_brings_out_of_order_are_left_out():
    assert in_order(np.array([0.0, 0.1, 0.05, 0.102, 0.2])).tolist() == [True, True, False, False, True]


def test_a_row_that_never_moves_does_not_follow_a_hanger_that_does():
    time = uneven()
    found = find_timing(time, np.zeros((len(time), 3)), held_curve(time, ends_of(path(time)), 4.0))
    assert found is None or not found.follows


def test_a_row_that_only_partly_moves_like_the_hanger_is_of_another_clock():
    """The path of another take: the row swings at another rate, and no shift explains 70 % of it."""
    time = uneven()
    fine = np.linspace(time[0], time[-1], 4000)
    slower = np.stack([np.interp(0.6 * time, fine, axis) for axis in path(fine).T], 1)
    found = find_timing(time, slower, held_curve(time, ends_of(path(time)), 4.0))
    assert found is not None
    assert not found.is_of_hanger

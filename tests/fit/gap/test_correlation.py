"""Autocorrelation of model errors: closed forms, and damped oscillations of known truth."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from fit.gap.correlation import (
    FREE_DIRECTIONS,
    NO_RINGING,
    Ringing,
    autocorrelation,
    block_correlation,
    correlation_of,
    effective_count,
    ringing_of,
)
from fit.methods import SI
from fit.observer.residuals import Observer
from formats.sights import BLOCK_SECONDS
from tests.fit.gap.oscillation import POINTS, RATE, oscillation
from tests.fit.gap.test_gap_statistics import a_still_take


@pytest.mark.parametrize("decay", [0.3, 1.0, 3.0])
def test_sums_of_a_decaying_square_are_correlated_as_its_integral_says(decay):
    """Without a swing k(0) = T B - T^2/2 (1 - e^(-2B/T)), k(m) = T^2/4 e^(-2mB/T) (e^(2B/T) - 1) (1 - e^(-2B/T))."""
    found = Ringing(decay, 0.0, share=0.8).between_blocks(4)
    fall = np.exp(-2 * BLOCK_SECONDS / decay)
    own = decay * BLOCK_SECONDS - decay**2 / 2 * (1 - fall)
    others = decay**2 / 4 * fall ** np.arange(1, 4) * (1 / fall - 1) * (1 - fall)
    assert found[0] == 1.0
    assert found[1:] == pytest.approx(0.8 * others / own, rel=0.02)  # twelve instants a block


def test_a_swing_of_half_the_block_rate_is_correlated_as_the_mean_of_its_square():
    """cos^2 of 1 Hz has a period of one block, so that nothing but the decay of 1000 s distinguishes blocks."""
    assert Ringing(1e3, 1.0, share=1.0).between_blocks(5) == pytest.approx(np.ones(5), abs=0.01)


@pytest.mark.parametrize(("decay", "hertz"), [(0.5, 0.7), (1.5, 1.1)])
def test_sums_of_a_swinging_square_are_correlated_as_its_double_integral_says(decay, hertz):
    """k(m) of instants a hundredth of a block apart, summed one by one."""
    instants = (np.arange(100) + 0.5) * BLOCK_SECONDS / 100
    sums = []
    for block in range(4):
        apart = block * BLOCK_SECONDS + instants - instants[:, None]
        sums.append((np.exp(-np.abs(apart) / decay) * np.cos(2 * np.pi * hertz * apart)) ** 2)
    expected = [0.7 * part.sum() / sums[0].sum() for part in sums[1:]]
    assert Ringing(decay, hertz, share=0.7).between_blocks(4)[1:] == pytest.approx(expected, rel=0.03)


PERIOD = 1200  # frames, 40 s: after it the longest oscillation has fallen to e^-10


def series_of(kernel, frames):
    """Points whose autocorrelation, pooled, is exactly a periodic one: a cosine and a sine of each frequency."""
    power = np.fft.rfft(kernel).real / PERIOD
    power[1:-1] *= 2
    angle = 2 * np.pi * np.arange(frames)[:, None] * np.arange(len(power)) / PERIOD
    columns = np.concatenate([np.sqrt(power) * np.cos(angle), np.sqrt(power) * np.sin(angle), angle[:, :1]], axis=1)
    return columns.reshape(frames, -1, 3)  # 1203 numbers a frame, the last of them 0


def kernel_of(decay, hertz, share):
    time = np.minimum(np.arange(PERIOD), PERIOD - np.arange(PERIOD)) / RATE
    return share * np.exp(-time / decay) * np.cos(2 * np.pi * hertz * time) + (1 - share) * (time == 0)


@pytest.mark.parametrize(("decay", "hertz"), [(0.1, 0.7), (0.1 * 40 ** (10 / 23), 0.7), (4.0, 0.3), (4.0, 3.0)])
def test_an_oscillation_on_the_grid_of_those_tried_is_found_exactly(decay, hertz):
    """a = 0.05 in 1203 numbers: weight 0.05^2 (1203/9) 30 T/2 (1 + 1 / (1 + (2 pi f T)^2)) beside 1 - 0.05^2.

    Of 24 decay times, each longer than the one before by the same factor, these are the first, eleventh and last.
    """
    kernel = kernel_of(decay, hertz, 0.05)
    kernel[[92, 95, -92, -95]] += 0.1  # lags beyond three seconds do not count
    found = ringing_of([series_of(kernel, 300), series_of(kernel, 5)], RATE)
    integral = decay / 2 * (1 + 1 / (1 + (2 * np.pi * hertz * decay) ** 2))
    weight = 0.05**2 * 1203 / 9 * RATE * integral
    assert (found.decay, found.hertz) == pytest.approx((decay, hertz))
    assert found.share == pytest.approx(weight / (weight + 1 - 0.05**2), rel=1e-3)


def test_a_few_points_count_as_one_direction_and_a_short_oscillation_as_one_frame():
    """Three numbers a frame, and 0.1 s of 5 frames/s, are no more than one of each: a^2 / (a^2 + 1 - a^2) = a^2."""
    series = series_of(kernel_of(0.1 * 5 / RATE, 0.0, 0.5), 61)
    assert ringing_of([series[:, k : k + 1] for k in range(401)], 5.0).share == pytest.approx(0.25, rel=1e-3)


def test_lags_are_tried_up_to_half_the_longest_take_and_three_seconds(monkeypatch):
    """200 frames: 90 lags beside that of none; 40 and 100: 50; of four frames two are enough, of three one is not."""
    asked = []
    monkeypatch.setattr(
        "fit.gap.correlation.autocorrelation", lambda grids, lags: asked.append(lags) or autocorrelation(grids, lags)
    )
    for frames in ((200,), (40, 100), (4,), (3,)):
        ringing_of([np.ones((n, 2, 3)) for n in frames], 30.0)
    assert asked == [91, 51, 3]


@pytest.mark.parametrize(("decay", "hertz"), [(0.5, 0.8), (1.0, 0.8), (0.8, 1.5)])
def test_the_decay_and_the_frequency_of_an_oscillation_are_found_in_its_residual(decay, hertz):
    rng = np.random.default_rng(4)
    grids = [oscillation(rng, 900, decay, hertz) + 0.3 * rng.normal(size=(900, POINTS, 3)) for _ in range(4)]
    found = ringing_of(grids, RATE)
    assert found.decay == pytest.approx(decay, rel=0.35)  # 120 s of three shapes
    assert found.hertz == pytest.approx(hertz, abs=0.11)  # frequencies are tried in steps of 0.1 Hz
    assert found.share > 0.95


def test_white_noise_leaves_blocks_independent():
    rng = np.random.default_rng(5)
    assert ringing_of([rng.normal(size=(200, 25, 3)) for _ in range(3)], RATE).share < 0.05
    assert ringing_of([rng.normal(size=(3, 25, 3))], RATE) == NO_RINGING
    assert NO_RINGING.between_blocks(3) == pytest.approx([1.0, 0.0, 0.0])


def test_the_oscillations_share_of_block_sums_grows_with_the_points_that_share_it():
    """a = 1/2, T = 1 s without a swing, 30 frames/s: (1/4)(75/9)(30) = 62.5 beside 3/4; of three points 15."""
    time = np.arange(-1500, 1500) / RATE
    kernel = np.exp(-np.abs(time)) * 0.5 + 0.5 * (time == 0)
    spectrum = np.sqrt(np.abs(np.fft.fft(np.fft.ifftshift(kernel))))
    rng = np.random.default_rng(6)
    series = np.fft.ifft(spectrum[:, None] * np.fft.fft(rng.normal(size=(3000, 75)), axis=0), axis=0).real
    for points, weight in ((25, 62.5), (3, 7.5)):
        grid = series[:, : 3 * points].reshape(3000, points, 3)
        found = ringing_of([grid], RATE)
        expected = weight / (weight + 0.75)
        assert found.share == pytest.approx(expected, abs=0.05)
    assert FREE_DIRECTIONS == 9


def test_gaps_in_a_residual_do_not_count():
    """1, -1, 1, -1: correlation -1 after one frame, and 1 after two, whatever is not seen."""
    grid = np.tile([1.0, -1.0], 50)[:, None, None] * np.ones((100, 2, 3))
    grid[10:20, 0] = grid[35, 1] = np.nan
    assert autocorrelation([grid, grid[:1]], 3) == pytest.approx([1.0, -1.0, 1.0])


def test_takes_are_pooled_by_their_products():
    """1, -1, 1 ... beside 2, 2, 2 ...: (1 + 4) / 2, (-1 + 4) / 2 and (1 + 4) / 2, of which the first is one."""
    swing = np.tile([1.0, -1.0], 50)[:, None, None] * np.ones((100, 2, 3))
    assert autocorrelation([swing, 2 * np.ones((100, 2, 3))], 3) == pytest.approx([1.0, 0.6, 1.0])


def test_lags_at_which_nothing_is_seen_and_residuals_of_nothing_are_uncorrelated():
    grid = np.full((4, 1, 3), np.nan)
    grid[[0, 3]] = 2.0
    assert autocorrelation([grid], 4) == pytest.approx([1.0, 0.0, 0.0, 1.0], abs=1e-12)
    assert autocorrelation([np.zeros((9, 1, 3))], 3) == pytest.approx(np.zeros(3))


def test_the_rate_of_an_observers_frames_is_the_median_of_its_takes(monkeypatch):
    """30, 30 and 60 frames a second, from the intervals between frames."""
    asked = []
    monkeypatch.setattr("fit.gap.correlation.ringing_of", lambda grids, rate: asked.append(rate) or NO_RINGING)
    takes = [SimpleNamespace(time=np.arange(61) / rate, duration=60 / rate) for rate in (30, 30, 60)]
    layout = SimpleNamespace(block=np.arange(2), take=np.zeros(2, int), is_judged=np.ones(2, bool))
    observer = SimpleNamespace(recordings=takes, layout=layout, by_place=lambda values: [values])
    assert correlation_of(observer, np.zeros(2)) == pytest.approx(np.eye(2))
    assert asked == [pytest.approx(30.0)]


def test_blocks_of_other_takes_and_means_over_a_take_are_independent():
    layout = SimpleNamespace(
        block=np.array([0, 0, 1, 2, 3, 3, 4, 5]), take=np.array([0, 0, 0, 1, 1, 1, 0, 0]),
        is_judged=np.array([True] * 6 + [False] * 2),
    )  # fmt: skip
    found = block_correlation(layout, Ringing(1.0, 0.0, 1.0))
    near = Ringing(1.0, 0.0, 1.0).between_blocks(2)[1]
    expected = np.eye(6)
    expected[0, 1] = expected[1, 0] = expected[2, 3] = expected[3, 2] = near
    assert near > 0.3
    assert found == pytest.approx(expected)


def test_blocks_that_are_alike_count_once():
    """n blocks with a correlation of c: n / (1 + (n - 1) c)."""
    for count, alike in ((10, 0.0), (10, 0.5), (4, 1.0)):
        correlation = np.full((count, count), alike) + (1 - alike) * np.eye(count)
        assert effective_count(correlation, np.ones(count)) == pytest.approx(count / (1 + (count - 1) * alike))
    # One that holds nearly all counts as one.
    assert effective_count(np.eye(3), np.array([1.0, 1.0, 98.0])) == pytest.approx(1e4 / 9606)


def test_a_residual_that_is_noise_leaves_an_observers_half_seconds_independent():
    recording = a_still_take(0.003)
    observer = Observer([recording], SI, (), frequency=0.0)
    residual = observer.residuals_of([recording.points[None] * 0.0 + np.nanmean(recording.points, 0)])[0]
    found = correlation_of(observer, residual)
    assert len(found) == int(observer.layout.block.max()) + 1
    assert found == pytest.approx(np.eye(len(found)), abs=0.05)
    slow = np.sin(2 * np.pi * 0.8 * recording.time)[:, None, None] * 0.01
    rung = observer.residuals_of([recording.points[None] + slow])[0]
    assert correlation_of(observer, rung)[0, 1] > 0.5


def test_a_swing_that_does_not_decay_is_all_of_its_residual_and_no_more():
    """Of the longest decay tried, 4 s, a cosine without any would be more than one."""
    angle = 2 * np.pi * 0.8 * np.arange(1200) / RATE
    grid = np.stack([np.cos(angle), np.sin(angle), 0 * angle], 1)[:, None]
    found = ringing_of([grid], RATE)
    assert (found.decay, found.hertz) == pytest.approx((4.0, 0.8))
    assert found.share == 1.0

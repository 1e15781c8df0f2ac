"""How long errors of a model stay correlated: closed forms, and damped oscillations whose truth is known."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from fit.gap.correlation import (
    DIRECTIONS,
    SILENT,
    Ringing,
    autocorrelation,
    block_correlation,
    correlation_of,
    decorrelated,
    effective_count,
    ringing_of,
)
from fit.methods import SI
from fit.observer.residuals import BLOCK, Observer
from tests.fit.gap.oscillation import POINTS, RATE, oscillation
from tests.fit.gap.test_gap_statistics import a_still_take


@pytest.mark.parametrize("decay", [0.3, 1.0, 3.0])
def test_sums_of_a_decaying_square_are_correlated_as_its_integral_says(decay):
    """Without a swing k(0) = T B - T^2/2 (1 - e^(-2B/T)), k(m) = T^2/4 e^(-2mB/T) (e^(2B/T) - 1) (1 - e^(-2B/T))."""
    found = Ringing(decay, 0.0, share=0.8).between_blocks(4)
    fall = np.exp(-2 * BLOCK / decay)
    own = decay * BLOCK - decay**2 / 2 * (1 - fall)
    others = decay**2 / 4 * fall ** np.arange(1, 4) * (1 / fall - 1) * (1 - fall)
    assert found[0] == 1.0
    assert found[1:] == pytest.approx(0.8 * others / own, rel=0.02)  # twelve instants a block


def test_a_swing_of_half_the_block_rate_is_correlated_as_the_mean_of_its_square():
    """cos^2 of 1 Hz has a period of one block, so that nothing but the decay of 1000 s tells blocks apart."""
    assert Ringing(1e3, 1.0, share=1.0).between_blocks(5) == pytest.approx(np.ones(5), abs=0.01)


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
    assert ringing_of([rng.normal(size=(3, 25, 3))], RATE) == SILENT


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
    assert DIRECTIONS == 9


def test_gaps_in_a_residual_do_not_count():
    """1, -1, 1, -1: correlation -1 after one frame, and 1 after two, whatever is not seen."""
    grid = np.tile([1.0, -1.0], 50)[:, None, None] * np.ones((100, 2, 3))
    grid[10:20, 0] = grid[35, 1] = np.nan
    assert autocorrelation([grid, grid[:1]], 3) == pytest.approx([1.0, -1.0, 1.0])


def test_blocks_of_other_takes_and_means_over_a_take_are_independent():
    layout = SimpleNamespace(
        block=np.array([0, 0, 1, 2, 3, 3, 4]), take=np.array([0, 0, 0, 1, 1, 1, 0]),
        is_judged=np.array([True] * 6 + [False]),
    )  # fmt: skip
    found = block_correlation(layout, Ringing(1.0, 0.0, 1.0))
    near = Ringing(1.0, 0.0, 1.0).between_blocks(2)[1]
    expected = np.eye(5)
    expected[0, 1] = expected[1, 0] = expected[2, 3] = expected[3, 2] = near
    assert near > 0.3
    assert found == pytest.approx(expected)


def test_blocks_that_are_alike_count_once():
    """n blocks with a correlation of c: n / (1 + (n - 1) c)."""
    for count, alike in ((10, 0.0), (10, 0.5), (4, 1.0)):
        correlation = np.full((count, count), alike) + (1 - alike) * np.eye(count)
        assert effective_count(correlation) == pytest.approx(count / (1 + (count - 1) * alike))


def test_decorrelated_scores_add_up_to_the_generalised_least_squares_sum_and_are_uncorrelated():
    correlation = np.array([[1.0, 0.6, 0.2], [0.6, 1.0, 0.6], [0.2, 0.6, 1.0]])
    scores = np.array([[1.0, 2.0], [-3.0, 0.5], [2.0, 1.0]])
    found = decorrelated(scores, correlation)
    assert found.sum(0) == pytest.approx(np.ones(3) @ np.linalg.inv(correlation) @ scores, rel=1e-6)
    assert decorrelated(scores, np.eye(3)) == pytest.approx(scores, rel=1e-6)
    drawn = np.random.default_rng(0).multivariate_normal(np.zeros(3), correlation, 20000)
    covariance = np.cov(decorrelated(drawn.T, correlation))
    assert np.abs(covariance - np.diag(np.diag(covariance))).max() < 0.02 * covariance.max()


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

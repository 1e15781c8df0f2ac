"""The emulator of residual vectors interpolates its data, and its proposals find known optima."""

from __future__ import annotations

import numpy as np
import pytest

from fit.search import sampling
from fit.search.emulator import Emulator
from fit.search.intervals import PRIOR_SD
from fit.search.posterior import draw

TRUTH = np.array([0.7, 0.35, 0.6])
PHASES = np.random.default_rng(3).normal(size=(3, 200))


def swung(units):
    """Two hundred numbers that depend on three parameters through sines, less those of the truth."""
    return 30 * (np.sin(units @ PHASES) - np.sin(TRUTH @ PHASES))


@pytest.fixture
def samples():
    return np.random.default_rng(0).random((20, 3))


@pytest.fixture
def emulator(samples):
    evaluated = swung(samples)
    return Emulator(samples, evaluated @ evaluated.T)


def test_emulated_costs_hold_to_a_percent_at_samples_and_to_a_tenth_elsewhere(samples, emulator):
    """The nugget, for ripples, keeps the samples from being met exactly."""
    evaluated = (swung(samples) ** 2).sum(1)
    assert emulator.costs(samples, 0.0)[0] == pytest.approx(evaluated, rel=0.01, abs=0.01 * evaluated.max())
    others = 0.2 + 0.6 * np.random.default_rng(1).random((50, 3))
    true = (swung(others) ** 2).sum(1)
    assert np.abs(emulator.costs(others, 0.0)[0] - true).max() < 0.1 * true.mean()


def test_far_from_two_samples_caution_costs_their_unbiased_variance():
    """Two residuals d apart, of correlation k and with a nugget g, have the variance d^2 / (2 (1 + g - k)).

    Infinitely far away the prediction's variance is that times 1 + (1 + g + k) / 2: of one number and of the mean.
    """
    evaluated = np.array([[3.0, 0.0], [0.0, 4.0]])
    found = Emulator(np.array([[0.0], [1.0]]), evaluated @ evaluated.T)
    apart = np.sqrt(5) / np.exp(found._logs[0])
    k, whole = (1 + apart + apart**2 / 3) * np.exp(-apart), 1 + np.exp(found._logs[1])
    far = np.array([[1e4]])
    caution = found.costs(far, 1.0)[0] - found.costs(far, 0.0)[0]
    assert caution == pytest.approx([25 / (2 * (whole - k)) * (1 + (whole + k) / 2)])


@pytest.mark.parametrize("caution", [0.0, 1.0])
def test_the_slopes_of_the_emulated_cost_are_its_differences(emulator, caution):
    """Central differences of 1e-4 of the box, to a five-hundredth, at three candidates far from the start."""
    start, step = np.full(3, 0.2), 1e-4
    for candidate in np.random.default_rng(4).uniform(0.3, 0.9, (3, 3)):
        _, slopes = sampling.emulated_cost(candidate, emulator, caution, start)
        ends = [
            [sampling.emulated_cost(candidate + sign * step * axis, emulator, caution, start)[0] for sign in (1, -1)]
            for axis in np.eye(3)
        ]
        assert slopes == pytest.approx([(above - below) / (2 * step) for above, below in ends], rel=2e-3, abs=0.5)


def test_the_prior_adds_the_squared_distance_from_the_start_in_deviations(emulator):
    start, candidate = np.full(3, 0.2), np.array([0.2, 0.5, 0.2])
    cost, _ = sampling.emulated_cost(candidate, emulator, 0.0, start)
    assert cost - emulator.costs(candidate[None], 0.0)[0][0] == pytest.approx((0.3 / PRIOR_SD) ** 2)


def test_caution_costs_least_at_samples(samples, emulator):
    def doubt(units):
        return emulator.costs(units, 1.0)[0] - emulator.costs(units, 0.0)[0]

    corners = np.array([[0.0, 0, 0], [1, 1, 1], [0, 1, 0]])
    assert (doubt(corners) > 3 * doubt(samples).max()).all()


def test_slopes_of_the_cost_are_those_of_differences(emulator):
    units, step = np.random.default_rng(2).random((4, 3)), 1e-6
    for caution in (0.0, 0.7):
        slopes = emulator.costs(units, caution)[1]
        for k, along in enumerate(step * np.eye(3)):
            apart = emulator.costs(units + along, caution)[0] - emulator.costs(units - along, caution)[0]
            # Rounding of sums of a hundred times the cost, over the step.
            assert slopes[:, k] == pytest.approx(apart / (2 * step), abs=1e-4 * np.abs(slopes).max())


def test_slopes_of_the_likelihood_are_those_of_differences(emulator):
    logs, step = np.log([0.8, 1.5, 2.0, 1e-2]), 1e-6
    slope = emulator._negative_log_posterior(logs)[1]
    for k, along in enumerate(step * np.eye(4)):
        apart = emulator._negative_log_posterior(logs + along)[0] - emulator._negative_log_posterior(logs - along)[0]
        assert slope[k] == pytest.approx(apart / (2 * step), rel=1e-4, abs=1e-3)


def test_the_likelihood_of_residuals_e_times_as_large_is_that_of_one_sample_fewer(samples):
    """The mean is unknown, so 60 (n - 1) / 2 ln e^2 more, of 20 samples and 60 independent numbers: 1140."""
    told = swung(samples)
    values = []
    for factor in (1.0, np.e):
        emulator = Emulator(samples, factor**2 * told @ told.T)
        values.append(emulator._negative_log_posterior(np.array([-0.5, -0.2, 0.1, -7.0]))[0])
    assert values[1] - values[0] == pytest.approx(60 * (20 - 1))


def test_residuals_that_depend_on_no_parameter_cost_the_same_everywhere(samples):
    found = Emulator(samples, np.full((20, 20), 7.0)).costs(np.random.default_rng(1).random((5, 3)), 0.0)
    assert found[0] == pytest.approx(7.0)
    assert np.abs(found[1]).max() < 1e-6


def looked_at(residuals, batches, seed=5):
    start = np.full(3, 0.2)
    units = sampling.scatter(start, seed)
    for _ in range(batches):
        units = np.concatenate([units, sampling.propose(units, residuals(units), start, seed)])
    return units


def test_two_proposals_of_two_end_within_a_fiftieth_of_the_box_of_the_answer():
    units = looked_at(swung, 2)
    assert len(units) == sampling.SCATTERED + 4
    assert np.abs(units[-4:] - TRUTH).max(1).min() < 0.02
    assert ((units >= 0) & (units <= 1)).all()


def test_candidates_drawn_about_a_best_one_at_the_bound_stay_in_the_box(monkeypatch):
    asked = []
    costs = Emulator.costs
    monkeypatch.setattr(
        Emulator, "costs", lambda self, samples, caution: asked.append(samples) or costs(self, samples, caution)
    )
    units = np.concatenate([sampling.scatter(np.full(3, 0.2), 5), [[1.0, 0.0, 1.0]]])
    residuals = swung(units)
    residuals[-1] = 0.0
    sampling.propose(units, residuals, units[0], 5)
    drawn = np.concatenate([samples for samples in asked if len(samples) == sum(sampling.DRAWN)])
    assert len(drawn) == 2 * sum(sampling.DRAWN)
    assert (drawn.min(), drawn.max()) == (0.0, 1.0)


def test_four_descents_and_350_drawn_candidates_are_ranked_by_their_emulated_cost_and_the_prior(samples, emulator):
    """Descents from the best and the three best drawn; drawn are 200 over the box, and 100 and 50 about the best."""
    start, best = np.full(samples.shape[1], 0.3), samples[0]
    found = np.array(sampling._least(emulator, 0.0, best, start, np.random.default_rng(2)))
    costs = emulator.costs(found, 0.0)[0] + ((found - start) ** 2).sum(1) / PRIOR_SD**2
    assert len(found) == 4 + 350
    assert (np.diff(costs[:4]) >= -1e-9 * costs[0]).all()
    assert (np.diff(costs[4:]) >= -1e-9 * costs[0]).all()
    assert costs[0] <= costs[4]


def test_every_batch_of_proposals_draws_samples_of_its_own(monkeypatch):
    """Drawn from the seed and the number of samples so far: 16 give others than 18."""
    asked = []
    costs = Emulator.costs
    monkeypatch.setattr(
        Emulator, "costs", lambda self, samples, caution: asked.append(samples) or costs(self, samples, caution)
    )
    looked_at(swung, 2)
    over_box = [samples[: sampling.DRAWN[0]] for samples in asked if len(samples) == sum(sampling.DRAWN)]
    first, second = over_box[0], over_box[2]
    assert np.abs(first[:, None] - second[None]).max(2).min() > 0.0  # no sample is drawn twice


def test_proposals_depend_on_the_samples_and_the_seed_alone():
    assert np.array_equal(looked_at(swung, 3), looked_at(swung, 3))
    assert not np.array_equal(looked_at(swung, 3), looked_at(swung, 3, seed=6))


def test_nothing_is_proposed_near_a_candidate_that_blew_up():
    def fragile(units):
        return np.where(units[:, :1] > 0.6, np.nan, swung(units))

    units = looked_at(fragile, 6)
    broken = units[:, 0] > 0.6
    assert broken[: sampling.SCATTERED].any()
    for k in range(sampling.SCATTERED, len(units)):
        batch = sampling.SCATTERED + (k - sampling.SCATTERED) // 2 * 2
        before = units[:batch][broken[:batch]]
        assert np.abs(before - units[k]).max(1).min() > sampling.NEAR_BLOW_UP


def test_nothing_is_proposed_where_hardly_anything_can_be_simulated():
    units = sampling.scatter(np.full(3, 0.2), 5)
    residuals = swung(units)
    residuals[4:] = np.nan
    assert sampling.propose(units, residuals, units[0], 5).shape == (0, 3)


def test_the_emulator_uses_the_best_sixty_of_the_finite_samples_and_proposals_begin_at_the_best(monkeypatch):
    """By the sum of squares and the prior: of 70 candidates two blew up, and the eight that cost most are left out."""
    rng, start, evaluated = np.random.default_rng(8), np.full(3, 0.2), {}
    units = rng.random((70, 3))
    residuals = rng.normal(size=(70, 5)) * rng.uniform(0.1, 4.0, (70, 1))
    residuals[[3, 40], 2] = np.inf

    class Recorded(Emulator):
        def __init__(self, samples, products):
            evaluated.update(samples=samples, products=products)
            super().__init__(samples, products)

    def least(emulator, caution, best, start, random):
        evaluated.setdefault("begun", []).append((caution, best.tolist()))
        return [best, best + 0.02, best - 0.02]

    monkeypatch.setattr(sampling, "Emulator", Recorded)
    monkeypatch.setattr(sampling, "_least", least)
    found = sampling.propose(units, residuals, start, 5)
    sound = [k for k in range(70) if k not in (3, 40)]
    costs = [(residuals[k] ** 2).sum() + ((units[k] - start) ** 2).sum() / PRIOR_SD**2 for k in sound]
    order = [sound[k] for k in np.argsort(costs)][: sampling.MOST_EMULATED]
    assert len(order) == 60
    np.testing.assert_array_equal(evaluated["samples"], units[order])
    np.testing.assert_allclose(evaluated["products"], residuals[order] @ residuals[order].T)
    best = units[order[0]]
    assert evaluated["begun"] == [(caution, best.tolist()) for caution in sampling.CAUTIONS]
    # The best candidate was simulated already, and each other is far enough from all before it.
    assert found == pytest.approx(np.array([best + 0.02, best - 0.02]))


def test_the_prior_is_the_spread_of_the_box_about_the_start():
    assert sampling.prior_cost(np.array([[0.5, 0.2 + PRIOR_SD]]), np.array([0.5, 0.2])) == pytest.approx([1.0])


def test_draws_have_the_spread_of_a_known_posterior():
    """E = exp((u - m)^2 / (s^2 N)) gives exp(-(u - m)^2 / (2 s^2)); s differs by ten between the two parameters."""
    middle, deviation, pieces = np.array([0.4, 0.6]), np.array([0.01, 0.1]), 12.0

    def cost(units):
        return np.exp((((units - middle) / deviation) ** 2).sum(1) / pieces)

    found = draw(cost, np.tile(middle, (5, 1)), pieces, 1)
    # 12 800 draws, one in fifty of them independent: a mean to 0.06 and a deviation to 5 % of s; three of those.
    assert found.mean(0) == pytest.approx(middle, abs=0.2 * deviation.max())
    assert (np.abs(found.mean(0) - middle) < 0.2 * deviation).all()
    assert found.std(0) == pytest.approx(deviation, rel=0.15)
    assert ((found >= 0) & (found <= 1)).all()


def test_draws_from_two_equal_valleys_are_half_in_each():
    def cost(units):
        valleys = [np.exp(-0.5 * (((units - at) / 0.05) ** 2).sum(1)) for at in (0.2, 0.8)]
        return np.maximum(sum(valleys), 1e-300) ** (-2 / 12.0)

    found = draw(cost, np.array([[0.2, 0.2], [0.8, 0.8]]), 12.0, 1)
    assert 0.3 < (found[:, 0] > 0.5).mean() < 0.7


def test_sampling_stops_at_the_count_and_returns_the_best_first_and_blow_ups_last():
    def fragile(units):
        return np.where(units[:, :1] > 0.8, np.nan, swung(units))

    start, seen = np.full(3, 0.2), []

    def count(units):
        seen.append(len(units))
        return fragile(units)

    units = sampling.sample(count, sampling.scatter(start, 5), 21, start, 5)
    assert seen == [sampling.SCATTERED, 2, 2, 1]
    costs = (fragile(units) ** 2).sum(1) + sampling.prior_cost(units, start)
    finite = np.isfinite(costs)
    assert 0 < finite.sum() < len(units) == 21
    assert finite.tolist() == sorted(finite.tolist(), reverse=True)
    assert (np.diff(costs[finite]) >= 0).all()
    assert np.abs(units[0] - TRUTH).max() < 0.05

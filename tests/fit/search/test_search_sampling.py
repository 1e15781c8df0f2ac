"""Single decisions of sampling and of the emulator's fit: what is drawn, sorted, left out and given up."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import qmc

from fit.search import sampling
from fit.search.emulator import Emulator
from fit.search.intervals import PRIOR_SD
from fit.search.sampling import DRAWN, LEAST_APART, NEAR_BLOW_UP, WIDTHS

LOGS = np.array([-0.5, -0.2, 0.1, -7.0])  # of three ranges and a nugget


@pytest.fixture
def samples():
    return np.random.default_rng(0).random((20, 3))


def valley(at, *_):
    """A curved valley with its slopes, in which descents need hundreds of steps; its minimum is at 0.8."""
    beyond = at[1:] - at[:-1] ** 2 - 0.16
    value = 1e4 * float(beyond @ beyond) + float(((at - 0.8) ** 2).sum())
    slope = 2 * (at - 0.8)
    slope[1:] += 2e4 * beyond
    slope[:-1] -= 4e4 * at[:-1] * beyond
    return value, slope


def end_of(begin, bounds, steps, cost=valley):
    return minimize(cost, begin, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": steps})


# --- what is drawn --------------------------------------------------------------------------------


def test_candidates_are_the_first_of_a_sobol_sequence_within_the_margins():
    wanted = 0.1 + 0.8 * qmc.Sobol(3, rng=np.random.default_rng(4)).random(16)
    assert sampling.spread(3, 16, 4) == pytest.approx(wanted)


def test_candidates_on_the_emulator_are_drawn_over_the_box_and_about_the_best(samples):
    evaluated = samples @ np.random.default_rng(1).normal(size=(3, 9))
    emulator = Emulator(samples, evaluated @ evaluated.T)
    found = sampling._least(emulator, 0.0, samples[0], np.full(3, 0.5), np.random.default_rng(2))[4:]
    random = np.random.default_rng(2)
    near = [samples[0] + width * random.normal(size=(n, 3)) for n, width in zip(DRAWN[1:], WIDTHS, strict=True)]
    drawn = np.concatenate([random.random((DRAWN[0], 3)), *np.clip(np.concatenate(near), 0, 1)[None]])
    assert sorted(map(tuple, found)) == sorted(map(tuple, drawn))


def test_descents_on_the_emulator_end_at_the_bounds_that_they_would_pass(samples):
    """Residuals fall to zero at 1.5 in every parameter."""
    evaluated = 30 * (samples - 1.5)
    emulator = Emulator(samples, evaluated @ evaluated.T)
    ends = np.array(sampling._least(emulator, 0.0, samples[0], np.full(3, 0.5), np.random.default_rng(2))[:4])
    assert ((ends >= 0) & (ends <= 1)).all()
    assert (ends[0] == 1.0).any()


def test_a_descent_on_the_emulator_ends_after_thirty_steps(samples, monkeypatch):
    emulator, begin = Emulator(samples, samples @ samples.T), np.array([0.1, 0.9, 0.2])
    monkeypatch.setattr(sampling, "emulated_cost", valley)
    monkeypatch.setattr(sampling, "DESCENTS", 0)
    (end, *_) = sampling._least(emulator, 0.0, begin, begin, np.random.default_rng(0))
    steps = {count: end_of(begin, [(0.0, 1.0)] * 3, count) for count in (30, 31, 15000)}
    assert [found.nit for found in steps.values()][:2] == [30, 31]
    assert steps[15000].nit > 31
    assert end.tolist() == steps[30].x.tolist() != steps[31].x.tolist()


# --- what is sorted and left out ------------------------------------------------------------------


def test_of_equal_residuals_the_nearest_to_the_start_is_first():
    units = np.array([[0.9, 0.5], [0.6, 0.5], [0.2, 0.5]])
    found = sampling.sample(lambda asked: np.ones((len(asked), 4)), units, 3, np.array([0.5, 0.5]), 0)
    assert found.tolist() == units[[1, 2, 0]].tolist()


def test_candidates_that_blew_up_keep_their_order():
    """A hundred, between as many that stayed finite."""
    units = np.random.default_rng(3).random((200, 1))
    is_broken = np.arange(200) % 2 == 1

    def residuals(asked):
        return np.where(is_broken[:, None], np.nan, asked)

    assert sampling.sample(residuals, units, 200, np.array([0.5]), 0)[100:].tolist() == units[1::2].tolist()


def test_a_full_number_of_candidates_asks_the_emulator_for_none(samples, monkeypatch):
    monkeypatch.setattr(sampling, "propose", None)
    assert len(sampling.sample(lambda units: units, samples, 20, samples[0], 0)) == 20


def test_sampling_ends_with_the_candidates_that_it_has_where_too_few_stay_finite():
    units = np.random.default_rng(3).random((6, 3))

    def fragile(asked):
        return np.where(np.arange(len(asked))[:, None] < 4, asked, np.nan)

    found = sampling.sample(fragile, units, 9, np.full(3, 0.5), 0)
    assert sorted(found.tolist()) == sorted(units.tolist())


@pytest.mark.parametrize(("finite", "proposed"), [(4, 0), (5, 2)])
def test_an_emulator_of_three_parameters_needs_five_candidates(finite, proposed, monkeypatch):
    units = sampling.scatter(np.full(3, 0.2), 5)
    residuals = np.sin(units @ np.random.default_rng(3).normal(size=(3, 9)))
    residuals[finite:] = np.nan
    monkeypatch.setattr(sampling, "NEAR_BLOW_UP", 0.0)
    assert len(sampling.propose(units, residuals, units[0], 5)) == proposed


def test_a_candidate_exactly_at_the_least_distance_is_left_out(samples, monkeypatch):
    """One sample in a corner, and a blow-up in another; candidates lie along the first axis from either."""
    units = np.concatenate([0.4 + 0.2 * samples, [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]])
    residuals = np.concatenate([units[:-1], [[np.nan] * 3]])
    candidates = [[LEAST_APART, 0.0, 0.0], [NEAR_BLOW_UP, 1.0, 0.0], [0.02, 0.0, 0.0], [0.12, 1.0, 0.0]]
    monkeypatch.setattr(sampling, "_least", lambda *_: [np.array(one) for one in candidates])
    assert sampling.propose(units, residuals, units[0], 5).tolist() == candidates[2:]


# --- the emulator's fit ---------------------------------------------------------------------------


def likelihood(emulator, logs, squares):
    """The negative logarithm of the likelihood of 60 independent numbers at 20 samples."""
    return 30 * (emulator._invert(logs)[3] + 19 * np.log(squares / 19))


def test_ranges_and_nugget_have_a_prior_of_their_own(samples):
    """About a whole box, 0.7 wide in the logarithm, and about a thousandth, 2 wide."""
    emulator = Emulator(samples, samples @ samples.T)
    squares = (emulator._invert(LOGS)[2] * emulator.gram).sum()
    prior = 0.5 * ((0.25 + 0.04 + 0.01) / 0.49 + (-7.0 - np.log(1e-3)) ** 2 / 4)
    assert emulator._negative_log_posterior(LOGS)[0] == pytest.approx(likelihood(emulator, LOGS, squares) + prior)


def test_residuals_that_are_all_alike_count_as_a_millionth_of_a_millionth_of_their_squares(samples):
    emulator = Emulator(samples, np.full((20, 20), 7.0))
    prior = 0.5 * ((0.25 + 0.04 + 0.01) / 0.49 + (-7.0 - np.log(1e-3)) ** 2 / 4)
    wanted = likelihood(emulator, LOGS, 1e-12 * 20 * 7.0) + prior
    assert emulator._negative_log_posterior(LOGS)[0] == pytest.approx(wanted)


def test_the_fit_of_an_emulator_ends_after_forty_steps(samples, monkeypatch):
    """In a valley of logarithms, the nugget's about -7; their bounds are those of ranges and of the nugget."""

    def shifted(logs):
        return valley(logs + np.array([0.0, 0.0, 0.0, 7.0]))

    monkeypatch.setattr(Emulator, "_negative_log_posterior", lambda _, logs: shifted(logs))
    found = Emulator(samples, samples @ samples.T)._logs
    bounds = [tuple(np.log([0.3, 10.0]))] * 3 + [tuple(np.log([1e-6, 0.3]))]
    begin = np.log([1.0, 1.0, 1.0, 1e-3])
    steps = {count: end_of(begin, bounds, count, shifted) for count in (40, 41, 15000)}
    assert [one.nit for one in steps.values()][:2] == [40, 41]
    assert steps[15000].nit > 41
    assert found.tolist() == steps[40].x.tolist() != steps[41].x.tolist()


def test_the_spread_of_the_box_is_the_priors():
    assert pytest.approx(12.0) == 1 / PRIOR_SD**2

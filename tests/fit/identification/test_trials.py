"""Trials of least squares on two parameters, whose residuals have a closed form instead of a cloth."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest

from fit.errors import BlowUpError
from fit.identification import trials
from fit.identification.trials import FIRST_SETTINGS, LAST_SETTINGS, ObservedSettings, Run
from fit.runtime import one_thread_of_algebra
from fit.search import sampling
from fit.search.least_squares import BoundedSpace, LeastSquaresSettings
from fit.search.steps import Step

SPACE = BoundedSpace(minimum=np.array([1.0, 0.1]), maximum=np.array([5.0, 10.0]), is_log=np.array([False, True]))
START = np.array([2.0, 0.5])
TRUTH = np.array([4.0, 3.0])
NUMBERS = 40
SAMPLES = ObservedSettings(samples=18, trials=3, seed=4)


class Formula:
    """A search problem: slopes by the two parameters, ripples, and unit noise; it records all that it is asked."""

    def __init__(self, ripple=0.0, noise=1.0, is_broken=lambda vectors: np.zeros(len(vectors), bool)):
        rng = np.random.default_rng(0)
        self.space, self.count, self.is_broken, self.ripple = SPACE, 2, is_broken, ripple
        self.noise = noise * rng.normal(size=NUMBERS)
        self.slopes = 20 * rng.normal(size=(NUMBERS, 2))
        self.asked, self.costs, self.distances = [], [], []
        self.free = SimpleNamespace(
            simulations=0, recordings=[SimpleNamespace(duration=5.0, take_id="formula")],
            layout=SimpleNamespace(block=np.arange(NUMBERS) // 4, is_judged=slice(None)),
            by_place=lambda residuals: [residuals[:, None]],
        )  # fmt: skip

    def simulate(self, vectors, pull):
        self.free.simulations += len(vectors)
        self.asked.append((pull, vectors))
        away = SPACE.to_unit(vectors) - SPACE.to_unit(TRUTH)
        residuals = self.noise + (1 + pull) * away @ self.slopes.T
        residuals = residuals + self.ripple * np.sin(25 * away[:, :1] + np.arange(NUMBERS))
        residuals[self.is_broken(vectors)] = np.nan
        if pull:
            return residuals, np.zeros(0)
        prior = 12 * ((SPACE.to_unit(vectors) - SPACE.to_unit(START)) ** 2).sum(1)
        costs = (residuals**2).sum(1) + prior
        self.costs += np.where(np.isfinite(costs), costs, np.inf).tolist()
        self.distances += (1e-3 * np.abs(away).sum(1)).tolist()
        return residuals, 1e-3 * np.abs(away).sum(1)

    def run(self, settings=SAMPLES, known=(), told=None):
        steps = [] if told is None else told
        with one_thread_of_algebra():  # as `calibrate` runs it
            return Run(self, START, settings, steps.append, known).run()


def kinds(found):
    """The steps in letters: S for the first samples of a trial, s for further ones, d for a descent."""
    return "".join("d" if not s.is_sampling else "S" if len(s.vectors) == 16 else "s" for s in found.path)


def plain(step):
    return json.dumps(step.state())


def assert_same(steps, others):
    """Steps are the same but for rounding, which a vector gains on its way into shares of the box and back."""
    assert [(s.is_sampling, s.simulations) for s in steps] == [(s.is_sampling, s.simulations) for s in others]
    for one, other in zip(steps, others, strict=True):
        for name in ("vector", "cost", "vectors", "distances", "slopes_at"):
            assert getattr(one, name) == pytest.approx(getattr(other, name), rel=1e-6), name


@pytest.fixture(scope="module")
def rippled():
    """Ripples keep every trial apart from the others, so all three trials run."""
    problem, told = Formula(ripple=3.0), []
    return problem, problem.run(told=told), told


@pytest.mark.parametrize(("noise", "within"), [(0.5, 0.05), (1.0, 0.05), (3.0, 0.15)])
def test_two_trials_that_agree_end_the_search_whatever_noise_is_stated(noise, within):
    """The stated noise is 1; half of it leaves room below for a wrong minimum, which one trial would not notice."""
    found = Formula(noise=noise).run()
    assert kinds(found).count("S") == 2
    assert found.vector == pytest.approx(TRUTH, rel=within)


def test_a_trial_samples_then_descends_and_a_finer_descent_from_the_best_end_is_the_last(rippled):
    problem, found, told = rippled
    assert [plain(step) for step in told] == [plain(step) for step in found.path]
    assert kinds(found).count("S") == 3
    assert kinds(found).startswith("Ssds")
    assert kinds(found).endswith("d")
    assert len(found.path) <= SAMPLES.steps
    *coarse, (last, vector) = found.ends
    assert len(found.ends) == kinds(found).count("d")
    assert last == min(cost for cost, _ in found.ends)
    assert np.array_equal(vector, found.vector)
    start = min(coarse, key=lambda end: end[0])[1]
    at = [k for k, (_, asked) in enumerate(problem.asked) if len(asked) == 1 and np.allclose(asked[0], start)][-1]
    differences = SPACE.to_unit(problem.asked[at + 1][1]) - SPACE.to_unit(start)
    assert np.abs(differences) == pytest.approx(0.02 * np.eye(2))


def test_every_step_knows_the_distance_of_the_least_cost_so_far_and_all_simulations(rippled):
    problem, found, _ = rippled
    best, expected = (np.inf, np.inf), []
    for pair in zip(problem.costs, problem.distances, strict=True):
        best = min(best, pair)
        expected.append(best[1])
    assert [d for step in found.path for d in step.distances] == pytest.approx(expected)
    assert np.cumsum([len(step.distances) for step in found.path]).tolist() == [s.simulations for s in found.path]
    assert found.simulations == problem.free.simulations == len(expected)


def test_samples_are_kept_with_the_best_candidate_so_far(rippled):
    _, found, _ = rippled
    known = np.zeros((0, 2))
    for step in found.path:
        if step.is_sampling:
            known = np.concatenate([known, step.vectors])
            costs = [(Formula(ripple=3.0).simulate(v[None], 0.0)[0] ** 2).sum() for v in known]
            costs = costs + sampling.prior_cost(SPACE.to_unit(known), SPACE.to_unit(START))
            assert step.cost == pytest.approx(costs.min())
            assert step.vector == pytest.approx(known[np.argmin(costs)])


def test_an_interrupted_search_goes_on_after_every_step_to_the_same_end(rippled):
    """As saved in JSON; the finished steps are neither told nor counted again.

    After the first samples, samples of a second batch, a descent, a scan, and all of a later trial's, and at the end.
    """
    _, whole, _ = rippled
    assert kinds(whole)[:6] == "Ssdsdd"
    for stop in (1, 2, 3, 4, len(whole.path) - 1, len(whole.path)):
        told = []
        known = [Step.from_state(json.loads(plain(step))) for step in whole.path[:stop]]
        again = Formula(ripple=3.0).run(known=known, told=told)
        assert_same(again.path, whole.path)
        assert_same(told, whole.path[stop:])
        assert again.simulations == whole.simulations
        assert again.vector == pytest.approx(whole.vector, rel=1e-6)
        assert again.intervals.ends == pytest.approx(whole.intervals.ends, rel=1e-6)
        assert again.intervals.covariance == pytest.approx(whole.intervals.covariance, rel=1e-6)


@pytest.mark.parametrize("noise", [1.0, 3.0])
def test_a_search_goes_on_to_the_same_end_whether_or_not_a_scan_had_candidates(noise):
    """At the level of the noise both parameters are known too closely for a scan, which then leaves no step."""
    whole = Formula(noise=noise).run()
    assert kinds(whole) == {1.0: "SsdSsdd", 3.0: "SsdsddSsdsddd"}[noise]
    for stop in range(1, len(whole.path) + 1):
        told = []
        again = Formula(noise=noise).run(known=whole.path[:stop], told=told)
        assert_same(again.path, whole.path)
        assert_same(told, whole.path[stop:])
        assert again.simulations == whole.simulations
        assert again.intervals.ends == pytest.approx(whole.intervals.ends, rel=1e-6)


def test_without_samples_every_start_descends_under_each_pull_in_turn():
    """From the start itself and from three scattered candidates, and the end under the last pull alone counts."""
    settings = ObservedSettings(pulls=(1.0, 0.0), iterations=1, seed=2)
    problem = Formula(ripple=0.5)
    found = problem.run(settings)
    assert kinds(found) == "dddddddd"
    assert len(found.path) == settings.steps
    assert [bool(step.distances) for step in found.path] == [False, True] * 4
    assert [cost for cost, _ in found.ends] == [step.cost for step in found.path[1::2]]
    best = min(found.path[1::2], key=lambda step: step.cost)
    assert np.array_equal(found.vector, best.vector)
    scattered = SPACE.from_unit(sampling.scatter(SPACE.to_unit(START), 2)[1:4])
    firsts = [problem.asked[k] for k in range(len(problem.asked)) if len(problem.asked[k][1]) == 1]
    begun = [asked[0] for pull, asked in firsts if pull]
    assert np.array(begun) == pytest.approx(np.array([START, *scattered]))
    ended = [asked[0] for pull, asked in firsts if not pull]
    assert np.array(ended) == pytest.approx(np.array([step.vector for step in found.path[::2]]))
    assert max(len(asked) for _, asked in problem.asked) == settings.width
    differences = SPACE.to_unit(problem.asked[1][1]) - SPACE.to_unit(START)
    assert np.abs(differences) == pytest.approx(0.05 * np.eye(2))
    for stop in range(1, 9):
        again = Formula(ripple=0.5).run(settings, known=found.path[:stop])
        assert_same(again.path, found.path)
        assert again.simulations == found.simulations
        assert again.intervals.ends == pytest.approx(found.intervals.ends, rel=1e-6)


@pytest.mark.parametrize("samples", [0, 18])
def test_a_start_that_blows_up_is_refused_with_its_take(samples):
    problem = Formula(is_broken=lambda vectors: np.isclose(vectors, START).all(1))
    with pytest.raises(BlowUpError, match=r"^formula: the simulation of the initial parameters blew up") as caught:
        problem.run(ObservedSettings(samples=samples))
    assert "coarser mesh" in caught.value.advice


def test_scattered_starts_and_samples_that_blow_up_are_skipped():
    """Everything beyond a first parameter of 3 blows up, the truth among it."""
    for samples in (0, 18):
        problem = Formula(is_broken=lambda vectors: vectors[:, 0] > 3.0)
        found = problem.run(ObservedSettings(samples=samples, seed=1))
        broken = [s for s in found.path if not s.is_sampling and not np.isfinite(s.cost)]
        assert bool(broken) == (samples == 0)
        assert all(np.isfinite(cost) for cost, _ in found.ends)
        assert 2.5 < found.vector[0] <= 3.0


def test_where_next_to_nothing_can_be_simulated_the_descent_begins_at_once():
    """And so it does after an interruption."""

    def is_broken(vectors):
        return np.abs(SPACE.to_unit(vectors) - SPACE.to_unit(START)).max(1) > 0.06

    settings = ObservedSettings(samples=18)
    found = Formula(is_broken=is_broken).run(settings)
    assert kinds(found).startswith("Sd")
    again = Formula(is_broken=is_broken).run(settings, known=found.path[:2])
    assert_same(again.path, found.path)


def test_valleys_are_scanned_by_the_slopes_in_shares_of_the_box_and_the_boxs_own_prior(monkeypatch):
    """Without ripples the slopes are the formula's own; a share's variance over the box is 1 / 12."""
    asked, across = [], trials.valleys.across

    def looked(end, slopes, precision, cost, moved, judge):
        asked.append((end, slopes, precision, cost, moved))
        return across(end, slopes, precision, cost, moved, judge)

    monkeypatch.setattr(trials.valleys, "across", looked)
    problem = Formula()
    found = problem.run()
    end, slopes, precision, cost, moved = asked[0]
    assert end == pytest.approx(SPACE.to_unit(found.ends[0][1]))
    assert slopes == pytest.approx(problem.slopes, rel=1e-6)
    assert precision == pytest.approx(12 * np.eye(2))
    assert (cost, moved) == (found.ends[0][0], 2)


def test_the_largest_number_of_steps_is_that_of_all_trials_scans_and_the_last_descent():
    """Of 80 samples 16 are one batch and 64 are 32; a descent and three scans with two descents each: 42 a trial."""
    assert ObservedSettings(samples=80, trials=3).steps == 3 * (1 + 32 + 1 + 3 * 3) + 1
    assert ObservedSettings(samples=80, trials=1, pulls=(3.0, 0.0)).steps == 1 + 32 + 2 + 3 * 3 + 1
    assert ObservedSettings(pulls=(3.0, 0.0)).steps == 8


def test_first_descents_stop_early_and_the_last_one_renews_its_slopes_once_and_is_finer():
    """Wide differences do not tell two thousandths of a cost; the last ones are two fifths as wide."""
    assert (
        LeastSquaresSettings(is_chord=True, renewals=0, step=0.05, cost_tolerance=2e-3, step_tolerance=1e-3)
        == FIRST_SETTINGS
    )
    assert (
        LeastSquaresSettings(
            is_chord=True, renewals=1, step=0.02, cost_tolerance=1e-4, step_tolerance=1e-3, max_iterations=8
        )
        == LAST_SETTINGS
    )


def test_a_later_trial_of_which_nothing_can_be_simulated_is_no_reason_to_refuse_the_fit():
    """All but the start's surroundings blows up, and there the residuals stay above the noise."""
    problem = Formula(noise=3.0, is_broken=lambda v: np.abs(SPACE.to_unit(v) - SPACE.to_unit(START)).max(1) > 0.06)
    found = problem.run()
    assert kinds(found).count("S") == 3
    assert kinds(found).endswith("Sdd")
    assert [np.isfinite(step.cost) for step in found.path[-3:]] == [True, False, True]
    assert np.abs(SPACE.to_unit(found.vector) - SPACE.to_unit(START)).max() <= 0.06
    assert found.ends[-1][0] == min(cost for cost, _ in found.ends)
    assert all(np.isfinite(cost) for cost, _ in found.ends)  # what lies across the valleys blew up too

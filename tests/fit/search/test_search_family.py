"""The common properties of all searches by distance, and of each: known optima, posteriors and spreads."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.stats import norm

from fit.errors import FitError
from fit.identification.request import request_of
from fit.methods import KINECT_SKIRT, SI
from fit.search.annealing import AnnealingSettings
from fit.search.choice import OBSERVED, SEARCHES, Task, begin, check_search, has_short_intervals
from fit.search.cma_es import Evolution
from fit.search.intervals import PRIOR_SD, LinearModel, block_intervals, draw_intervals, jackknife
from fit.search.least_squares import BoundedSpace
from fit.search.tempering import Tempering

OUTPUT = [name for name in SEARCHES if name not in OBSERVED]
SPACE = BoundedSpace(minimum=SI.minimum, maximum=SI.maximum, is_log=SI.is_log)
OPTIMUM = np.array([0.7, 0.35, 0.6, 0.45, 0.3])  # shares of the box


def bowl(candidates):
    """0.03 m at the optimum; directions differ in steepness by 30 and are turned against the axes."""
    turn = np.linalg.qr(np.random.default_rng(7).normal(size=(5, 5)))[0]
    # Summed row by row: a product of matrices rounds otherwise for other numbers of rows.
    turned = np.array([(turn.T * (SPACE.to_unit(one) - OPTIMUM)).sum(1) for one in candidates])
    apart = turned * np.geomspace(0.03, 1, 5)
    return 0.03 + np.sqrt((apart**2).sum(1))


def intervals_of(space, parameters, residuals, jacobian, block, **more):
    model = LinearModel(parameters=parameters, residuals=residuals, jacobian=jacobian, block=block)
    return block_intervals(space, model, **more)


def begun(name, budget=120, seed=3):
    settings = AnnealingSettings(iterations=budget)
    task = Task(initial=SI.initial, steps=SI.interval, space=SPACE, settings=settings, seed=seed, numbers=24.0)
    return begin(name, task)


def test_an_unknown_search_is_named_with_those_that_are_there():
    with pytest.raises(FitError) as refused:
        begun("gradient")
    assert str(refused.value).startswith("search: gradient does not minimise distances; choose one of ")


def run(search, width, distance=bowl, batches=None):
    asked = []
    while not search.is_finished and (batches is None or len(asked) < batches):
        candidates = search.ask(width)
        assert 1 <= len(candidates) <= width
        search.tell(candidates, distance(candidates))
        asked.append(candidates)
    return np.concatenate(asked)


# --- the family ---------------------------------------------------------------------------------


@pytest.mark.parametrize("name", OUTPUT)
def test_candidates_stay_within_the_bounds_and_the_best_is_the_best_evaluated(name):
    search = begun(name)
    seen = run(search, 16)
    assert (seen >= SPACE.minimum).all()
    assert (seen <= SPACE.maximum).all()
    assert (np.diff(search.best_history) <= 0).all()
    assert bowl(search.best[None])[0] == search.best_distance
    if name in ("cma-es", "tempering"):
        assert search.best_distance == bowl(seen).min()
        assert search.evaluations == len(seen) == 120


@pytest.mark.parametrize("name", OUTPUT)
def test_the_result_does_not_depend_on_the_batch_width(name):
    searches = [begun(name) for _ in range(3)]
    for search, width in zip(searches, (1, 5, 16), strict=True):
        run(search, width)
    for search in searches[1:]:
        assert np.array_equal(search.best, searches[0].best)
        assert np.array_equal(search.best_history, searches[0].best_history)


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 6))])
@pytest.mark.parametrize("budget", [119, 120, 121])
def test_the_draws_of_tempering_do_not_depend_on_the_batch_width(seed, budget):
    """The first half of the budget ends within a sweep: 60 lies in the eighth, of candidates 57 to 64."""
    searches = [begun("tempering", budget, seed) for _ in range(4)]
    for search, width in zip(searches, (1, 3, 5, 16), strict=True):
        run(search, width)
    for search in searches[1:]:
        assert np.array_equal(search.draws, searches[0].draws)
        assert np.array_equal(search.steps, searches[0].steps)
        assert np.array_equal(search.best_history, searches[0].best_history)


@pytest.mark.parametrize("name", OUTPUT)
def test_a_search_goes_on_bit_identically_after_a_round_trip_through_json(name):
    whole, first, second = begun(name), begun(name), begun(name)
    run(whole, 6)
    run(first, 6, batches=7)
    second.restore(json.loads(json.dumps(first.state(), allow_nan=False)))
    assert 0 < second.iteration == first.iteration
    run(second, 6)
    assert np.array_equal(second.best_history, whole.best_history)
    assert np.array_equal(second.best, whole.best)


@pytest.mark.parametrize("name", ["cma-es", "tempering"])
def test_a_simulation_that_blew_up_is_no_best_after_a_round_trip_through_json(name):
    first, second = begun(name), begun(name)
    first.tell(first.ask(1), np.array([0.5]))
    first.tell(first.ask(3), np.array([np.inf, 0.4, np.inf]))
    second.restore(json.loads(json.dumps(first.state(), allow_nan=False)))
    assert second.best_history.tolist() == first.best_history.tolist() == [0.5, 0.5, 0.4, 0.4]


@pytest.mark.parametrize("name", OUTPUT)
def test_simulations_that_blow_up_are_counted_and_never_the_best(name):
    search = begun(name)

    def fragile(candidates):
        found = bowl(candidates)
        found[candidates[:, 0] > 300.0] = np.nan
        return found

    run(search, 8, fragile)
    assert search.non_finite > 5
    assert search.best[0] <= 300.0


@pytest.mark.parametrize("name", ["cma-es", "tempering"])
def test_a_state_of_another_search_and_other_candidates_are_refused(name):
    one = begun(name)
    run(one, 4, batches=3)
    with pytest.raises(FitError, match="other settings"):
        begun(name, seed=4).restore(one.state())
    changed = json.loads(json.dumps(one.state()))
    changed["batches"][2][0][0][0] += 1.0
    with pytest.raises(FitError, match="other settings"):
        begun(name).restore(changed)
    candidates = one.ask(4)
    with pytest.raises(ValueError, match="unchanged"):
        one.tell(candidates + 1, np.zeros(len(candidates)))
    for told, count in ((candidates, 3), (candidates, 5), (candidates[:3], 3)):
        with pytest.raises(ValueError, match="one distance for each candidate"):
            one.tell(told, np.zeros(count))


@pytest.mark.parametrize("name", ["cma-es", "tempering"])
def test_a_record_begins_with_its_start_and_ends_with_its_budget(name):
    """Of equal distances the first is the best; a spent budget leaves no candidate to ask for."""
    search = begun(name, budget=3)
    assert search.best.tolist() == SI.initial.tolist()
    with pytest.raises(ValueError, match="one distance for each candidate"):
        search.tell(np.empty((0, 5)), np.empty(0))
    assert search.state()["seed"] == 3
    for _ in range(2):
        candidates = search.ask(2)
        search.tell(candidates, np.full(len(candidates), 0.5))
    assert (search.is_finished, search.best_distance) == (True, 0.5)
    assert search.best == pytest.approx(SI.initial)
    assert search.ask(4).shape == (0, 5)


def test_restarts_share_the_iterations_among_four_chains():
    assert [chain.settings.iterations for chain in begun("restarts").chains] == [30] * 4


@pytest.mark.parametrize("corner", [SI.minimum, SI.maximum])
def test_a_search_may_start_on_its_bounds(corner):
    assert Evolution(corner, SPACE, 10, 0).ask(1)[0] == pytest.approx(corner)


@pytest.mark.parametrize(
    ("name", "iterations", "are_short"),
    [
        ("annealing", 801, True), ("restarts", 801, True), ("cma-es", 801, True), ("short-windows", 801, True),
        ("tempering", 800, True), ("tempering", 801, False), ("least-squares", 1, False), ("least-squares", 801, False),
    ],
)  # fmt: skip
def test_intervals_are_short_unless_of_least_squares_or_of_fifty_draws(name, iterations, are_short):
    """Eight chains, whose coldest draws once a sweep of the second half: 2 x 8 x 50 candidates."""
    assert has_short_intervals(name, iterations) is are_short


def test_a_search_that_is_not_known_is_one_sentence():
    with pytest.raises(FitError, match="no search named 'guess'; known searches: annealing, restarts, tempering"):
        check_search("guess")
    with pytest.raises(FitError, match="outside the bounds"):
        Evolution(SI.maximum + 1, SPACE, 10, 0)


def test_least_squares_refuse_another_engine():
    with pytest.raises(FitError, match="with our own cloth only, not with blender"):
        request_of(KINECT_SKIRT, [], iterations=1, seed=0, spacing=0.1, engine="blender", search="least-squares")


# --- each for itself ----------------------------------------------------------------------------


def test_cma_es_ends_within_a_hundredth_of_the_box_of_the_optimum_of_a_turned_bowl():
    search = begun("cma-es", budget=700)
    run(search, 16)
    assert search.best_distance - 0.03 < 1e-3
    # In the flattest direction 1e-3 m is a thirtieth of the box.
    assert np.abs(SPACE.to_unit(search.best) - OPTIMUM).max() < 0.035


def test_cma_es_leaves_the_wrong_valley_by_restarting_with_twice_the_population():
    """The start lies in a wide valley 0.05 deep; the deeper one, 0.03, is a tenth of the box wide."""

    def two(candidates):
        unit = SPACE.to_unit(candidates)
        wide = 0.05 + 0.1 * np.linalg.norm(unit - SPACE.to_unit(SI.initial), axis=1)
        deep = 0.03 + 0.5 * np.linalg.norm((unit - OPTIMUM)[:, :2], axis=1)
        return np.minimum(wide, deep)

    search = begun("cma-es", budget=3000)
    run(search, 16, two)
    assert search.populations[:2] == [8, 16]  # 4 + floor(3 ln 5)
    assert search.best_distance < 0.04


@pytest.mark.slow
def test_tempering_draws_from_a_known_posterior():
    """D = exp((u - m)^2 / (2 s^2 N)) has the posterior N(m, s): quantiles m -+ 1.645 s in the unit box."""
    line = BoundedSpace(minimum=np.zeros(1), maximum=np.ones(1), is_log=np.zeros(1, bool))
    search = Tempering(np.array([0.9]), line, 40_000, 1, numbers=24.0)
    run(search, 64, lambda c: np.exp((c[:, 0] - 0.4) ** 2 / (2 * 0.05**2 * 24.0)))
    low, high = draw_intervals(line, search.draws, search.best).ends[0]
    # 2500 draws, a tenth of them independent: 0.14 s of error in a 5 % quantile, three of those.
    assert low == pytest.approx(0.4 - 1.645 * 0.05, abs=0.02)
    assert high == pytest.approx(0.4 + 1.645 * 0.05, abs=0.02)


@pytest.mark.slow
def test_tempering_started_in_one_of_two_equal_valleys_draws_half_from_each():
    """Twelve deviations apart, at odds of exp(-18) between them."""
    line = BoundedSpace(minimum=np.zeros(1), maximum=np.ones(1), is_log=np.zeros(1, bool))

    def two(candidates):
        u = candidates[:, 0]
        density = norm.pdf(u, 0.2, 0.05) + norm.pdf(u, 0.8, 0.05)
        return density ** (-1 / 24.0)

    search = Tempering(np.array([0.2]), line, 24_000, 1, numbers=24.0)
    run(search, 64, two)
    assert 0.3 < (search.draws[:, 0] > 0.5).mean() < 0.7


# --- intervals ----------------------------------------------------------------------------------


def test_the_jackknife_of_a_mean_is_the_spread_of_the_block_means_over_their_number():
    """Four blocks of two numbers with means 1, 2, 3, 6: sum of squares 14, over 4 x 3."""
    values = np.array([0, 2, 1, 3, 2, 4, 5, 7.0])
    slope = 1e3  # so that the prior weighs nothing
    variance, way = jackknife(values, np.full((8, 1), slope), np.repeat(np.arange(4), 2))
    assert np.sqrt(variance[0, 0]) * slope == pytest.approx(np.sqrt(14 / 12), rel=1e-4)
    assert way[0] * slope == pytest.approx(-3.0, rel=1e-4)


def test_a_parameter_that_no_number_shows_keeps_the_spread_of_the_box_and_is_not_identified():
    line = BoundedSpace(minimum=np.zeros(2), maximum=np.ones(2), is_log=np.zeros(2, bool))
    noise = np.random.default_rng(0).normal(size=60)
    jacobian = np.stack([np.full(60, 100.0), np.zeros(60)], axis=1)
    found = intervals_of(line, np.array([0.5, 0.5]), noise, jacobian, np.repeat(np.arange(12), 5))
    assert found.is_identified.tolist() == [True, False]
    assert found.ends[1].tolist() == [0.0, 1.0]  # 1.80 x 0.289 is more than half of the box
    assert np.sqrt(found.covariance[1, 1]) == pytest.approx(PRIOR_SD)


def test_ninety_percent_intervals_hold_the_truth_of_a_line_in_nine_of_ten_cases_also_when_errors_go_together():
    """Straight lines with errors that share half of their variance within a block; the least squares are exact."""
    random = np.random.default_rng(5)
    line = BoundedSpace(minimum=np.full(2, -1.0), maximum=np.full(2, 1.0), is_log=np.zeros(2, bool))
    block, held = np.repeat(np.arange(20), 10), []
    design = 2 * np.stack([np.ones(200), random.normal(size=200)], axis=1)  # per share of the box, two units wide
    for _ in range(400):
        error = random.normal(size=200) + random.normal(size=20)[block]
        truth = np.array([0.1, -0.2])
        fitted = truth + 2 * np.linalg.lstsq(design, error, rcond=None)[0]
        residuals = design @ (fitted - truth) / 2 - error
        found = intervals_of(line, fitted, 10 * residuals, 10 * design, block)
        held.append((found.ends[:, 0] <= truth) & (truth <= found.ends[:, 1]))
    # 400 cases: 1.5 % standard error.
    assert np.mean(held, axis=0) == pytest.approx([0.9, 0.9], abs=0.045)


def test_intervals_of_a_search_that_stopped_short_reach_as_far_as_the_least_squares():
    """One parameter, slope 100 a box, least squares a fifth of the box above where the search stopped."""
    line = BoundedSpace(minimum=np.zeros(1), maximum=np.ones(1), is_log=np.zeros(1, bool))
    noise = np.random.default_rng(1).normal(size=60)
    noise -= noise.mean()
    found = intervals_of(line, np.array([0.5]), noise - 20.0, np.full((60, 1), 100.0), np.repeat(np.arange(12), 5))
    assert found.ends[0, 1] > 0.7 > 0.5 > found.ends[0, 0]


def test_deviations_known_in_another_way_widen_an_interval_and_never_add_to_it():
    """The least deviation of the first parameter is twice its own, and of the second one half of its own."""
    line = BoundedSpace(minimum=np.zeros(2), maximum=np.ones(2), is_log=np.zeros(2, bool))
    random = np.random.default_rng(3)
    noise, jacobian, block = random.normal(size=60), 50 * random.normal(size=(60, 2)), np.repeat(np.arange(12), 5)
    middle = np.array([0.5, 0.5])
    alone = intervals_of(line, middle, noise, jacobian, block)
    own = np.sqrt(np.diag(alone.covariance))
    wider = intervals_of(line, middle, noise, jacobian, block, spread=own * [2.0, 0.5])
    assert np.sqrt(np.diag(wider.covariance)) == pytest.approx(own * [2.0, 1.0])
    assert wider.ends[1] == pytest.approx(alone.ends[1])
    assert np.ptp(wider.ends[0]) > 1.3 * np.ptp(alone.ends[0])

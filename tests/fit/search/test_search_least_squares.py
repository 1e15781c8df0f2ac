"""Least squares find known answers inside the box and on its edge, in batches."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fit.errors import BlowUpError, FitError
from fit.search.least_squares import (
    UNJUDGED,
    BoundedSpace,
    LeastSquaresSettings,
    Prior,
    _Search,
    minimise,
    search,
    side_by_side,
)

FINE = LeastSquaresSettings(step=1e-6, max_iterations=100, cost_tolerance=1e-12, step_tolerance=1e-10)


def box(low, high, is_log=False):
    low, high = np.atleast_1d(np.array(low, float)), np.atleast_1d(np.array(high, float))
    return BoundedSpace(minimum=low, maximum=high, is_log=np.broadcast_to(is_log, low.shape))


def rosenbrock(candidates):
    x, y = candidates.T
    return np.stack([10 * (y - x**2), 1 - x], 1)


TIME = np.linspace(0, 3, 40)


def decay(candidates):
    """amplitude exp(-rate t) against 2 exp(-0.7 t)."""
    return candidates[:, :1] * np.exp(-candidates[:, 1:2] * TIME) - 2.0 * np.exp(-0.7 * TIME)


@pytest.mark.parametrize("width", [1, 3, 8, 16])
def test_rosenbrock_valley_ends_at_1_1(width):
    settings = LeastSquaresSettings(
        width=width, step=1e-6, max_iterations=300, cost_tolerance=1e-14, step_tolerance=1e-12
    )
    found = minimise(rosenbrock, np.array([-1.2, 1.0]), box([-3, -3], [3, 3]), settings=settings)
    assert found.parameters == pytest.approx([1, 1], abs=1e-4)
    assert found.is_converged
    assert (np.diff(found.cost_history) < 0).all()


def test_no_batch_is_wider_than_asked_and_all_simulations_are_counted():
    sizes = []

    def counted(candidates):
        sizes.append(len(candidates))
        return rosenbrock(candidates)

    found = minimise(counted, np.array([-1.2, 1.0]), box([-3, -3], [3, 3]), settings=LeastSquaresSettings(width=4))
    assert max(sizes) <= 4
    assert (found.simulations, found.batches) == (sum(sizes), len(sizes))


def test_searches_side_by_side_end_where_each_ends_alone():
    models, starts = (rosenbrock, decay), (np.array([-1.2, 1.0]), np.array([0.2, 8.0]))
    space, settings = box([-3, 0.1], [3, 10]), LeastSquaresSettings(width=4, max_iterations=20)
    lanes = []

    def evaluate(asked):
        lanes.append([len(candidates) for candidates in asked])
        return [model(candidates) for model, candidates in zip(models, asked, strict=True)]

    together = side_by_side([search(start, space, settings=settings) for start in starts], evaluate)
    alone = [minimise(m, start, space, settings=settings) for m, start in zip(models, starts, strict=True)]
    assert [f.parameters.tolist() for f in together] == [f.parameters.tolist() for f in alone]
    assert [f.simulations for f in together] == np.sum(lanes, axis=0).tolist()
    assert len(lanes) < sum(f.batches for f in alone)


def test_a_search_far_above_the_known_cost_is_stopped_after_a_few_steps():
    start, space = np.array([-1.2, 1.0]), box([-3, -3], [3, 3])
    patient = LeastSquaresSettings(width=4, is_chord=True, max_iterations=60, step=1e-6)
    whole = minimise(rosenbrock, start, space, settings=patient)
    hopeless = minimise(rosenbrock, start, space, settings=replace(patient, known_cost=1e-9))
    assert whole.cost < 1e-6
    assert whole.is_converged
    assert len(hopeless.cost_history) == UNJUDGED + 1
    assert not hopeless.is_converged
    assert hopeless.reason == "the cost will hardly fall below the known one"
    assert minimise(rosenbrock, start, space, settings=replace(patient, known_cost=1e9)).cost == whole.cost


@pytest.mark.parametrize(
    ("history", "is_hopeless"),
    [
        ((500, 400, 300, 200, 150, 109), False),
        ((500, 400, 300, 200, 150, 111), True),
        ((200, 150, 130, 111), False),
        ((200, 198), False),
        ((200, 199), True),
    ],
)
def test_a_search_that_falls_is_given_up_a_tenth_above_the_known_cost_and_after_four_steps(history, is_hopeless):
    """Of a known cost of 100; a fall by a hundredth is no slow one."""
    one = _Search(box([0], [1]), None, LeastSquaresSettings(known_cost=100.0))
    assert one._is_hopeless(list(history), has_moved=True) == is_hopeless


def test_a_search_that_falls_by_less_than_a_hundredth_is_stopped_above_the_known_cost_and_not_below():
    """All that can be gained is 3 squared of 316.2 squared and 3 squared, 9 of 99 991."""
    start, space = np.array([0.5]), box([-3], [3])

    def nearly_flat(candidates):
        return np.stack([np.full(len(candidates), 316.2), 6.0 * candidates[:, 0]], 1)

    settings = LeastSquaresSettings(width=4, is_chord=True, cost_tolerance=1e-9)
    whole = minimise(nearly_flat, start, space, settings=settings)
    above = minimise(nearly_flat, start, space, settings=replace(settings, known_cost=0.9 * whole.cost))
    below = minimise(nearly_flat, start, space, settings=replace(settings, known_cost=1.1 * whole.cost))
    assert len(above.cost_history) == 2
    assert not above.is_converged
    assert below.cost == whole.cost
    assert below.is_converged


def test_a_search_by_chords_that_stops_on_new_differences_asks_for_no_more():
    """One candidate, one column of differences a parameter, one ladder that finds nothing to gain: 1 + 2 + 4."""
    settings = LeastSquaresSettings(width=4, is_chord=True, step=1e-6, step_tolerance=1e-3)
    assert minimise(decay, np.array([2.001, 0.7]), box([-3, 0.1], [3, 10]), settings=settings).simulations == 7


def test_exponential_decay_on_a_log_scale_gives_2_and_0_7():
    found = minimise(decay, np.array([0.2, 8.0]), box([1e-2, 1e-2], [1e2, 1e1], is_log=True), settings=FINE)
    assert found.parameters == pytest.approx([2.0, 0.7], rel=1e-5)
    # d r / d ln amplitude is the curve itself.
    assert found.jacobian[:, 0] == pytest.approx(2 * np.exp(-0.7 * TIME), rel=1e-3)


def test_an_optimum_beyond_the_bounds_ends_exactly_on_its_bound():
    found = minimise(decay, np.array([1.0, 1.0]), box([0.1, 0.1], [1.5, 5.0]), settings=FINE)
    assert found.parameters[0] == 1.5
    # Best rate for amplitude 1.5, from a fine grid.
    rates = np.linspace(0.1, 5, 50001)
    costs = (decay(np.stack([np.full_like(rates, 1.5), rates], 1)) ** 2).sum(1)
    assert found.parameters[1] == pytest.approx(rates[costs.argmin()], abs=2e-4)


def test_a_start_on_a_bound_is_left_again():
    found = minimise(decay, np.array([10.0, 0.1]), box([0.1, 0.1], [10.0, 5.0]), settings=FINE)
    assert found.parameters == pytest.approx([2.0, 0.7], rel=1e-5)


@pytest.mark.parametrize("start", [0.0, 1.0])
def test_a_bound_is_left_at_however_small_a_slope(start):
    """0.1 (x - 1/2): the slope at either end is 0.005."""
    found = minimise(lambda candidates: 0.1 * (candidates - 0.5), np.array([start]), box([0.0], [1.0]), settings=FINE)
    assert found.parameters == pytest.approx([0.5], abs=1e-6)


def asked_of(width, start, step=0.25):
    """The first two batches of one parameter's search in [0, 1] for the zero of x - 1/10."""
    asked = []

    def residuals(candidates):
        asked.append(candidates[:, 0].tolist())
        return candidates - 0.1

    minimise(residuals, np.array([start]), box([0.0], [1.0]), settings=LeastSquaresSettings(width=width, step=step))
    return asked


def test_a_difference_that_ends_on_the_upper_bound_is_made_towards_it_and_one_beyond_turns_back():
    assert asked_of(8, 0.75)[1] == [1.0]
    assert asked_of(8, 0.8)[1] == pytest.approx([0.55])


@pytest.mark.parametrize("width", [1, 2, 5])
def test_a_ladder_of_dampings_fills_the_batch(width):
    """A step of a linear residual by damping l is 0.65 / (1 + l): 1e-3 alone, or 1e-2 spread by 10^(+-3/2)."""
    tried = asked_of(width, 0.75)[2]
    dampings = 1e-2 * (10.0 ** np.linspace(-1.5, 1.5, width) if width > 1 else np.array([0.1]))
    assert tried == pytest.approx((0.75 - 0.65 / (1 + dampings)).tolist(), abs=1e-8)


def test_a_prior_of_equal_weight_meets_the_data_half_way():
    found = minimise(
        lambda candidates: candidates - 2.0,
        np.array([5.0]),
        box(0, 10),
        prior=Prior(mean=np.array([4.0]), precision=np.eye(1)),
        settings=FINE,
    )
    assert found.parameters[0] == pytest.approx(3.0, abs=1e-5)
    assert found.cost == pytest.approx(2.0)
    assert found.covariance()[0, 0] == pytest.approx(0.5, rel=1e-4)


def test_covariance_of_a_mean_is_variance_over_count():
    found = minimise(
        lambda candidates: np.repeat(candidates - 2.0, 25, axis=1), np.array([5.0]), box(0, 10), settings=FINE
    )
    assert found.covariance(4.0)[0, 0] == pytest.approx(4.0 / 25, rel=1e-4)


def test_a_parameter_without_effect_does_not_move():
    found = minimise(
        lambda c: np.stack([c[:, 0] - 2.0, c[:, 0] - 2.5], 1),
        np.array([5.0, 7.0]),
        box([0, 0], [10, 10]),
        settings=FINE,
    )
    assert found.parameters == pytest.approx([2.25, 7.0], abs=1e-4)


def test_lanes_that_blow_up_are_never_chosen():
    def fragile(candidates):
        residuals = decay(candidates)
        residuals[candidates[:, 0] > 2.4] = np.nan
        return residuals

    found = minimise(fragile, np.array([0.3, 4.0]), box([0.1, 0.1], [10.0, 5.0]), settings=FINE)
    assert found.parameters == pytest.approx([2.0, 0.7], rel=1e-4)


def test_a_start_that_blows_up_is_refused():
    with pytest.raises(BlowUpError, match="start"):
        minimise(lambda candidates: np.full((len(candidates), 3), np.nan), np.array([1.0]), box(0, 10))


def test_crossed_bounds_are_refused():
    with pytest.raises(FitError, match="lower bound"):
        box(1, 0)
    with pytest.raises(FitError, match="log scale"):
        box(0, 1, is_log=True)
    with pytest.raises(FitError, match="outside the bounds"):
        minimise(lambda candidates: candidates, np.array([11.0]), box(0, 10))


def test_the_jacobian_of_a_search_by_chords_that_stops_after_a_long_step_is_that_of_its_end():
    """The first step goes a sixth of the box, saves 0.1 % of the cost, and is the last one."""
    rng = np.random.default_rng(0)
    directions, constant = rng.normal(size=(200, 2)), rng.normal(size=200)
    constant = 60 * (constant - directions @ np.linalg.lstsq(directions, constant, rcond=None)[0])

    def residuals(candidates):
        curved = np.stack([np.sin(3 * candidates[:, 0]), np.cos(3 * candidates[:, 1])], 1)
        return (curved - [np.sin(1.5), np.cos(1.5)]) @ directions.T + constant

    settings = LeastSquaresSettings(width=4, cost_tolerance=2e-3, step_tolerance=1e-3, is_chord=True)
    space, start = box([0, 0], [1, 1]), np.array([0.42, 0.66])
    found = minimise(residuals, start, space, settings=settings)
    assert len(found.cost_history) == 2
    assert np.abs(found.parameters - start).max() > 0.1
    again = minimise(residuals, found.parameters, space, settings=replace(settings, max_iterations=0))
    assert np.allclose(found.jacobian, again.jacobian)


def test_a_descent_ends_after_thirty_iterations_unless_told_otherwise():
    assert LeastSquaresSettings().max_iterations == 30


def test_a_difference_that_turns_back_at_the_bound_is_divided_by_the_way_that_is_left():
    """From 0.05 a tenth on nothing is finite, and 0.05 back is the bound: of r = 3 x the slope is 3."""

    def partly(candidates):
        return np.where(candidates > 0.1, np.nan, 3.0 * candidates)

    found = minimise(partly, np.array([0.05]), box(0.0, 1.0), settings=LeastSquaresSettings(step=0.1, max_iterations=0))
    assert found.jacobian == pytest.approx(np.array([[3.0]]))

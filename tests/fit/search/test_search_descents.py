"""Single decisions of a descent: its bounds, its ladders, its chords and its end, on one or two parameters by hand."""

from __future__ import annotations

import numpy as np
import pytest

from fit.search.least_squares import LeastSquaresSettings, Prior, _Search, _Step, minimise, search
from tests.fit.search.test_search_asks import asked_of, trial
from tests.fit.search.test_search_least_squares import box

NO_STEP, NO_SLOPE = "no step lowers the cost", "no slope is left within the bounds"


def batches_of(residual, start, space, *, known=None, **settings):
    """Every batch of candidates of a descent, and its result."""
    one, batches = search(np.array(start), space, jacobian=known, settings=LeastSquaresSettings(**settings)), []
    batch = next(one)
    while True:
        batches.append(batch)
        try:
            batch = one.send(residual(batch))
        except StopIteration as stop:
            return batches, stop.value


def test_residuals_of_single_precision_are_summed_in_double():
    found = minimise(lambda candidates: (candidates - 2.0).astype(np.float32), np.array([5.0]), box(0, 10))
    assert found.residuals.dtype == found.jacobian.dtype == np.float64


def test_a_priors_mean_is_measured_from_the_lower_bound():
    """Equal weights of data at 3 and of a prior at 5, in a box from 2 to 6: both are a quarter of the box away."""
    found = minimise(
        lambda candidates: candidates - 3.0, np.array([2.5]), box(2, 6), prior=Prior(mean=np.array([5.0]),
        precision=np.eye(1)), settings=LeastSquaresSettings(step=1e-6),
    )  # fmt: skip
    assert found.parameters == pytest.approx([4.0], abs=1e-5)
    assert found.cost == pytest.approx(2.0)


@pytest.mark.parametrize("at", [0.0, 1.0])
def test_a_parameter_at_a_bound_without_slope_follows_another(at):
    """J = [[s, 1], [0, 1]] and r = (0, 1), s inwards: the slope of the first is 0, and of s_1 + s_2 it has a share."""
    inward = 1.0 if at == 0.0 else -1.0
    known = np.array([[inward, 1.0], [0.0, 1.0]])
    batches, _ = batches_of(
        lambda candidates: np.tile([0.0, 1.0], (len(candidates), 1)), [at, 0.9], box([0, 0], [1, 1]), known=known,
        width=1, is_exact=False,
    )  # fmt: skip
    normal = known.T @ known
    step = np.linalg.solve(normal + 1e-3 * np.diag(np.diag(normal)), -known.T @ [0.0, 1.0])
    assert step[0] * inward > 0.5
    assert batches[1][0] == pytest.approx(np.clip(np.array([at, 0.9]) + step, 0.0, 1.0), abs=1e-6)


@pytest.mark.parametrize(
    ("known", "answers", "reason"),
    [(1e-12, 1.0, NO_SLOPE), (1.5e-12, 1.0, NO_STEP), (1e-11, 1e3, NO_SLOPE), (1e-8, 1e3, NO_STEP)],
)
def test_a_slope_counts_above_a_millionth_of_a_millionth_of_the_cost_or_of_one(known, answers, reason):
    """The slope is J r: of the cost 1 more than 1e-12 counts, and of the cost 1e6 more than 1e-6."""
    _, found = asked_of(4, known=np.array([[known]]), answers=answers)
    assert found.reason == reason


def test_two_lanes_are_a_ladder_too():
    batches, _ = asked_of(2, known=np.array([[2.0]]))
    assert [len(batch) for batch in batches] == [1, 2, 2, 2]
    for k in range(3):
        expected = [trial(0.01 * 1e3**k * 10.0**x, 2.0) for x in (-1.5, 1.5)]
        assert batches[1 + k] == pytest.approx(expected, rel=1e-9)


def test_a_damping_never_falls_so_low_that_the_ladder_cannot_climb_back():
    """One step from 1e-30 succeeds. Of the twelve tries after it, a tenth of 1e-12 and on, the last has 0.01."""
    answers = iter([1.0, 0.5, *[9.0] * 12])
    batches, found = batches_of(
        lambda _: np.array([[next(answers)]]), [0.9], box(0, 1), known=np.array([[10.0]]), width=1, is_chord=True,
        damping=1e-30, renewals=0, is_exact=False, cost_tolerance=0.0, step_tolerance=0.0,
    )  # fmt: skip
    tried = np.array([batch[0, 0] for batch in batches])
    assert found.parameters == pytest.approx([tried[1]])
    assert found.jacobian[0, 0] == pytest.approx(5.0, rel=1e-6)  # by Broyden, half of the step's fall
    assert len(tried) == 2 + 12
    assert tried[-1] == pytest.approx(trial(0.01, 2.5, normal=25.0, start=tried[1]), abs=1e-6)


def test_a_damping_never_rises_so_high_that_no_step_is_left():
    """A step of 4e-13 of the box lowers the cost of 1 by 1.6e-12."""
    found = minimise(
        lambda candidates: 2.0 * candidates, np.array([0.5]), box(0, 1), jacobian=np.array([[2.0]]),
        settings=LeastSquaresSettings(width=1, damping=1e30, max_iterations=1, is_exact=False),
    )  # fmt: skip
    assert len(found.cost_history) == 2


def test_a_step_of_small_residuals_is_that_of_large_ones():
    """J = 2e-4 and r = 1e-4: the share of the diagonal that keeps the system regular is one of the diagonal."""
    batches, _ = asked_of(1, known=np.array([[2e-4]]), answers=1e-4)
    assert batches[1] == pytest.approx([0.5 - 0.5 / 1.001], abs=1e-8)


def test_a_prior_is_counted_at_the_bound_where_a_step_beyond_it_ends():
    """r = x - 5 pulls beyond 1; the prior's mean is 0.5, and its deviation one."""
    found = minimise(
        lambda candidates: candidates - 5.0, np.array([0.5]), box(0, 1),
        prior=Prior(mean=np.array([0.5]), precision=np.eye(1)),
    )  # fmt: skip
    assert found.cost == pytest.approx(16 + 0.25)


# --- differences ----------------------------------------------------------------------------------


def test_a_difference_that_turns_back_at_the_upper_bound_is_divided_by_the_way_that_is_left():
    """From 0.97 downwards nothing is finite, and 0.03 upwards is the bound: of r = 3 x the slope is 3."""
    found = minimise(
        lambda candidates: np.where(candidates < 0.96, np.nan, 3.0 * candidates), np.array([0.97]), box(0, 1),
        settings=LeastSquaresSettings(max_iterations=0),
    )  # fmt: skip
    assert found.jacobian == pytest.approx(np.array([[3.0]]))


@pytest.mark.parametrize(("from_below", "slope"), [(-np.inf, 3.0), (0.49, 0.0)])
def test_the_column_of_one_parameter_that_blows_up_is_renewed_or_zero_alone(from_below, slope):
    """The first parameter blows up above 0.52, and in the second case below 0.49 as well; r = 3 x + 2 y."""

    def fragile(candidates):
        first = candidates[:, :1]
        return np.where((first > 0.52) | (first < from_below), np.nan, candidates @ [[3.0], [2.0]])

    settings = LeastSquaresSettings(max_iterations=0)
    found = minimise(fragile, np.array([0.5, 0.5]), box([0, 0], [1, 1]), settings=settings)
    assert found.jacobian == pytest.approx(np.array([[slope, 2.0]]))
    assert found.simulations == 1 + 2 + 1


def test_simulations_that_differ_by_rounding_at_the_bound_are_no_slope_and_no_warning():
    """From 1 downwards it blows up, and the second simulation of 1 itself ends 1e-12 away."""
    ended = iter([1.0, np.nan, 1.0 + 1e-12])
    found = minimise(
        lambda _: np.array([[next(ended)]]), np.array([1.0]), box(0, 1), settings=LeastSquaresSettings(max_iterations=0)
    )
    assert found.jacobian.tolist() == [[0.0]]


# --- chords ---------------------------------------------------------------------------------------


def sizes_of(improving, renewals):
    """Sizes of the batches by chords, where a ladder after each of the first `improving` Jacobians lowers the cost."""
    sizes, left = [], [1.0]

    def answer(batch):
        sizes.append(len(batch))
        if len(batch) == 1:
            return np.array([[left[0] + (1.0 if len(sizes) > 1 else 0.0)]])
        if sizes[-2] == 1 and sizes.count(1) - 1 <= improving:
            left[0] *= 0.5
            return np.full((4, 1), left[0])
        return np.full((4, 1), 9.0)

    batches_of(answer, [0.5], box(0, 1), width=4, is_exact=False, is_chord=True, renewals=renewals)
    return sizes


def test_an_updated_jacobian_has_one_ladder_before_it_is_renewed_and_a_new_one_three():
    """Ladders of four, differences of one; the last updated Jacobian cannot be renewed."""
    assert sizes_of(improving=9, renewals=0) == [1, 1, 4, 4, 4, 4]
    assert sizes_of(improving=9, renewals=1) == [1, 1, 4, 4, 1, 4, 4, 4, 4]
    assert sizes_of(improving=9, renewals=2) == [1, 1, 4, 4, 1, 4, 4, 1, 4, 4, 4, 4]


def test_a_renewed_jacobian_that_lowers_nothing_is_not_renewed_again():
    assert sizes_of(improving=1, renewals=2) == [1, 1, 4, 4, 1, 4, 4, 4]
    assert sizes_of(improving=0, renewals=2) == [1, 1, 4, 4, 4]


@pytest.mark.parametrize(("start", "step", "is_far"), [(0.3, 0.3, True), (0.3, 0.5, False), (0.5, 1.0, False)])
def test_chords_that_end_with_their_first_step_renew_their_jacobian_after_more_than_half_a_difference(
    start, step, is_far
):
    """Steps of 0.2 from 0.3 to the zero of x - 0.1, more than 0.15 and less than 0.25, and of 0.5 to the bound."""
    target = 0.1 if start < 0.5 else -1.0
    found = minimise(
        lambda candidates: candidates - target, np.array([start]), box(0, 1),
        settings=LeastSquaresSettings(width=4, is_chord=True, step=step, cost_tolerance=2.0),
    )  # fmt: skip
    assert len(found.cost_history) == 2
    assert found.simulations == 1 + 1 + 4 + is_far


# --- reasons to stop ------------------------------------------------------------------------------


def reason_of(cost, fallen_to, moved_by, **settings):
    one = _Search(box(0, 1), None, LeastSquaresSettings(**settings))
    moved = _Step(np.array([0.5 + moved_by]), np.zeros(1), fallen_to, 1.0)
    return one._reason_to_stop(np.array([0.5]), cost, moved)


@pytest.mark.parametrize("unit", [1.0, 2.0**-20])
def test_a_fall_of_exactly_the_tolerance_is_no_reason_to_stop_at_any_cost(unit):
    short = {"step_tolerance": 0.0, "cost_tolerance": 0.25}
    assert reason_of(unit, 0.75 * unit, 0.1, **short) == ""
    assert reason_of(unit, 0.76 * unit, 0.1, **short) == "the cost has stopped falling"


def test_a_step_of_exactly_the_tolerance_is_no_reason_to_stop():
    short = {"step_tolerance": 0.25, "cost_tolerance": 0.0}
    assert reason_of(1.0, 0.5, 0.25, **short) == ""
    assert reason_of(1.0, 0.5, 0.24, **short) == "the steps have become short"


@pytest.mark.parametrize(("known", "history"), [(100.0, [100.5, 100.0]), (1.0, [5.0, 4.0, 3.0, 2.0, 1.5, 1.1])])
def test_a_cost_equal_to_the_known_one_or_a_tenth_above_it_is_not_hopeless(known, history):
    one = _Search(box(0, 1), None, LeastSquaresSettings(known_cost=known))
    assert one._is_hopeless(history, has_moved=True) is False
    assert one._is_hopeless([*history[:-1], history[-1] * (1 + 1e-9)], has_moved=True) is True

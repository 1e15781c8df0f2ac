"""Intervals in closed form: two to four blocks by hand, limits at the bounds, quantiles of draws."""

from __future__ import annotations

import numpy as np
import pytest

from fit.errors import FitError
from fit.search.intervals import (
    NEAR_BOUND,
    PRIOR_SD,
    Intervals,
    LinearModel,
    at_bounds,
    block_intervals,
    check_blocks,
    draw_intervals,
    jackknife,
    widened,
)
from fit.search.least_squares import BoundedSpace

BLOCK = np.repeat(np.arange(3), 2)
# Slope 1000 a box, so that the prior weighs nothing. Block means -1, 0, 1: a mean's variance is 2 / (3 x 2).
VALUES, SLOPE = np.array([-1.5, -0.5, 0.5, -0.5, 1.5, 0.5]), 1e3
DEVIATION = np.sqrt(1 / 3) / SLOPE
REACH = 2.919986  # 95 % of Student's distribution with two degrees of freedom, from its table


def line(low=0.0, high=1.0, *, is_log=False):
    return BoundedSpace(minimum=np.array([low]), maximum=np.array([high]), is_log=np.array([is_log]))


def about(space, at, values=VALUES, block=BLOCK, **more):
    model = LinearModel(parameters=np.array([at]), residuals=values, jacobian=np.full((6, 1), SLOPE), block=block)
    return block_intervals(space, model, **more)


def of_three(space, at, **more):
    return about(space, at, **more)


def test_three_blocks_give_2_92_deviations_of_their_mean_to_each_side():
    found = of_three(line(), 0.5)
    assert found.spread == pytest.approx(REACH, rel=1e-5)
    assert found.covariance[0, 0] == pytest.approx(DEVIATION**2, rel=1e-4)
    assert found.ends[0] == pytest.approx([0.5 - REACH * DEVIATION, 0.5 + REACH * DEVIATION], rel=1e-5)
    assert found.way == pytest.approx([0.0], abs=1e-9)
    assert found.is_identified.tolist() == [True]


def test_ends_and_covariance_are_in_the_parameters_own_units():
    """A box of 200 wide from -100, and a logarithm over two decades at its middle, 10: slope 10 ln 100."""
    wide = of_three(line(-100.0, 100.0), 40.0)
    assert wide.ends[0] == pytest.approx(40.0 + 200 * REACH * DEVIATION * np.array([-1, 1]), rel=1e-5)
    assert wide.covariance[0, 0] == pytest.approx((200 * DEVIATION) ** 2, rel=1e-4)
    decades = of_three(line(1.0, 100.0, is_log=True), 10.0)
    shift = np.log(100) * REACH * DEVIATION
    assert decades.ends[0] == pytest.approx(10 * np.exp([-shift, shift]), rel=1e-5)
    assert decades.covariance[0, 0] == pytest.approx((10 * np.log(100) * DEVIATION) ** 2, rel=1e-4)


def test_an_interval_ends_at_the_bounds_of_the_box():
    """Within a tenth of the half width of either bound."""
    near = 0.1 * REACH * DEVIATION
    assert of_three(line(), near).ends[0, 0] == 0.0
    assert of_three(line(), near).ends[0, 1] == pytest.approx(near + REACH * DEVIATION, rel=1e-5)
    assert of_three(line(), 1 - near).ends[0, 1] == 1.0
    assert of_three(line(), 1 - near).ends[0, 0] == pytest.approx(1 - near - REACH * DEVIATION, rel=1e-5)


def test_an_interval_far_wider_than_a_logarithmic_box_is_all_of_the_box_and_warns_of_no_overflow():
    """A deviation of 200 boxes of two decades each: e to the power of 2700 is no number."""
    found = of_three(line(1.0, 100.0, is_log=True), 10.0, between=np.array([[200.0**2]]))
    assert found.ends[0] == pytest.approx([1.0, 100.0], rel=1e-12)


@pytest.mark.parametrize(("at", "beyond"), [(0.0, -1), (1.0, 1), (0.995, 1), (0.005, -1)])
def test_a_parameter_at_its_bound_is_not_identified_and_its_interval_reaches_the_bound(at, beyond):
    """The least squares lie 0.02 beyond the box; half a width at the limit is 2.92 x 0.5 / sqrt(12) = 0.42."""
    way = at - (0.5 + beyond * 0.52)
    pushed = of_three(line(), at, values=VALUES + SLOPE * way)
    inside = of_three(line(), at)  # rounding may as well leave the least squares inside
    for found in (pushed, inside):
        assert found.is_identified.tolist() == [False]
        assert found.is_at_bound.tolist() == [True]
        assert found.ends[0, int(at > 0.5)] == float(at > 0.5)
    assert np.ptp(pushed.ends[0]) == pytest.approx(REACH * 0.5 * PRIOR_SD, abs=0.01)
    assert np.ptp(inside.ends[0]) == pytest.approx(REACH * DEVIATION + min(at, 1 - at), rel=1e-3)


def test_a_parameter_two_hundredths_from_its_bound_is_not_at_it():
    near = of_three(line(), 0.98)
    assert (near.is_identified.tolist(), near.is_at_bound.tolist()) == ([True], [False])


def test_a_covariance_between_ends_comes_on_top_of_the_jackknifes():
    """Variances 1 and 8 of the jackknife's make nine, a deviation three times as wide."""
    found = of_three(line(), 0.5, between=np.array([[8 * DEVIATION**2]]))
    assert np.ptp(found.ends[0]) == pytest.approx(3 * 2 * REACH * DEVIATION, rel=1e-4)


def test_the_remaining_step_to_the_minimum_counts_with_the_spread_as_a_hypotenuse():
    """Stopped 0.04 of a box of 50 short: to each side sqrt((2.92 d)^2 + 0.04^2)."""
    short = about(line(0.0, 50.0), 25.0, VALUES + 40.0)
    assert short.way == pytest.approx([-0.04 * 50], rel=1e-4)
    half = 50 * np.hypot(REACH * DEVIATION, 0.04)
    assert short.ends[0] == pytest.approx([25 - half, 25 + half], rel=1e-4)


def test_a_deviation_below_half_of_the_flat_priors_counts_as_identified_and_one_above_does_not():
    """The flat prior over the box has 1 / sqrt(12) = 0.2887."""
    assert pytest.approx(0.288675, abs=1e-6) == PRIOR_SD
    for share, is_identified in ((0.49, True), (0.51, False)):
        found = of_three(line(), 0.5, spread=np.array([share * PRIOR_SD]))
        assert found.is_identified.tolist() == [is_identified]


def test_a_parameter_that_no_block_determines_keeps_the_priors_variance_and_none_of_another_parameter():
    """Two parameters, of which the numbers know only the first."""
    jacobian = np.stack([np.full(6, SLOPE), np.zeros(6)], axis=1)
    variance, way = jackknife(VALUES, jacobian, BLOCK)
    assert variance[1, 1] == pytest.approx(1 / 12)
    assert variance[0, 1] == pytest.approx(0.0, abs=1e-12)
    assert way == pytest.approx([0.0, 0.0], abs=1e-9)


def test_a_weak_slope_is_shared_with_the_prior():
    """One number a block of slope 2: H = 3 x 4 + 12 = 24; each block left out leaves 20, and the sum of the others.

    Residuals -1, 0, 1: s_b = -2, 0, 2; u without b = s_b / 20 = -0.1, 0, 0.1; V = 2/3 x 0.02 + 12 / 24^2.
    """
    variance, way = jackknife(np.array([-1.0, 0.0, 1.0]), np.full((3, 1), 2.0), np.arange(3))
    assert variance[0, 0] == pytest.approx(2 / 3 * 0.02 + 12 / 576)
    assert way == pytest.approx([0.0])
    # All residuals 1: the least squares with the prior are 6 / 24 away.
    assert jackknife(np.ones(3), np.full((3, 1), 2.0), np.arange(3))[1] == pytest.approx([-0.25])


def test_a_block_that_knows_more_counts_for_more_when_it_is_left_out():
    """Slopes 2, 2 and 4, residuals 0, 0 and 1: H = 24 + 12, s = 4, all of it of the last block.

    Without the first two blocks in turn u = -4 / 32, without the last 0; they are -1, -1 and 2 24ths from their mean.
    """
    variance, way = jackknife(np.array([0.0, 0.0, 1.0]), np.array([[2.0], [2.0], [4.0]]), np.arange(3))
    assert variance[0, 0] == pytest.approx(2 / 3 * 6 / 24**2 + 12 / 36**2)
    assert way == pytest.approx([-4 / 36])


def test_three_blocks_are_enough_and_two_are_refused():
    check_blocks(np.array([4, 4, 7, 9]))
    with pytest.raises(FitError) as refused:
        check_blocks(np.array([4, 4, 7, 7]))
    assert (
        str(refused.value)
        == "the takes are too short: intervals need 3 half-seconds of motion, and there are 2; record a longer take"
    )


def test_blocks_are_known_by_their_numbers_wherever_these_begin():
    anew = about(line(), 0.5, block=np.array([7, 7, 3, 3, 90, 90]))
    assert anew.ends[0] == pytest.approx(of_three(line(), 0.5).ends[0])


def test_intervals_of_draws_are_their_quantiles_in_own_units():
    """101 candidates evenly over a box of 200 wide: 5 % and 95 % are 10 and 190, variance 2^2 x 101 x 102 / 12."""
    box = line(0.0, 200.0)
    draws = np.linspace(0, 200, 101)[:, None]
    found = draw_intervals(box, draws, np.array([100.0]))
    assert found.ends[0] == pytest.approx([10.0, 190.0])
    assert found.covariance[0, 0] == pytest.approx(2**2 * 101 * 102 / 12)
    assert (found.way.tolist(), found.spread) == ([0.0], 1.645)
    assert found.is_identified.tolist() == [False]
    narrow = draw_intervals(box, 100 + 0.4 * (draws - 100), np.array([100.0]))
    assert narrow.is_identified.tolist() == [True]


@pytest.mark.parametrize(
    ("deviation", "ends", "more", "wider", "larger", "is_identified"),
    [
        (6.0, (90, 120), 24.0, (74, 100 + np.hypot(20, 24)), np.hypot(6, 12), True),
        (6.0, (97, 104), 60.0, (50, 100 + np.hypot(4, 60)), np.hypot(6, 30), False),
        (6.0, (97, 104), 1e9, (50, 250), np.hypot(6, 100), False),
        (40.0, (70, 170), 0.0, (70, 170), 40.0, True),
        (40.0, (70, 170), 1.0, (100 - np.hypot(30, 1), 100 + np.hypot(70, 1)), np.hypot(40, 0.5), False),
    ],
)
def test_independent_errors_widen_an_interval_in_squares_within_its_box(
    deviation, ends, more, wider, larger, is_identified
):
    """In a box from 50 to 250 a deviation of 0.5 / sqrt(12) of it, 28.9, is too much, unless nothing was added.

    Intervals of 2 deviations. Errors are at most as wide as the box. The second parameter is on a scale of logarithms,
    from 1 to 100, of which 10 ln 100 = 46.05 at 10 is the width, and 6.65 too much. The third was not identified.
    """
    box = BoundedSpace(
        minimum=np.array([50.0, 1.0, 50.0]), maximum=np.array([250.0, 100.0, 250.0]), is_log=np.arange(3) == 1
    )
    before = Intervals(
        np.array([ends, (9, 11), (90, 110)], float), np.array([True, True, False]), np.diag([deviation, 1.0, 1.0]) ** 2,
        np.array([0.1, 0.2, 0.3]), 2.0, np.zeros(3, bool),
    )  # fmt: skip
    for added, still in ((13.0, True), (13.3, False)):
        found = widened(box, before, np.array([100.0, 10.0, 100.0]), np.array([more, added, 0.0]))
        assert found.ends[0] == pytest.approx(wider)
        assert found.covariance == pytest.approx(np.diag([larger**2, 1 + added**2 / 4, 1.0]))
        assert found.is_identified.tolist() == [is_identified, still, False]
        assert (found.way.tolist(), found.spread) == ([0.1, 0.2, 0.3], 2.0)
    assert found.ends[1:] == pytest.approx(np.array([[1.0, 10 + np.hypot(1, 13.3)], [90, 110]]))


def test_each_parameters_draws_are_judged_by_their_own_spread():
    """Of two parameters over boxes of 200, the draws of the first spread over a hundredth of theirs."""
    box = BoundedSpace(minimum=np.zeros(2), maximum=np.full(2, 200.0), is_log=np.zeros(2, bool))
    even = np.linspace(0, 200, 101)
    found = draw_intervals(box, np.stack([100 + 0.01 * (even - 100), even], 1), np.full(2, 100.0))
    assert found.is_identified.tolist() == [True, False]


def test_a_parameter_a_hundredth_of_the_box_from_its_end_is_at_its_bound():
    low, high = at_bounds(np.array([NEAR_BOUND, 1 - NEAR_BOUND, 1.01 * NEAR_BOUND, 1 - 1.01 * NEAR_BOUND]))
    assert (low.tolist(), high.tolist()) == ([True, False, False, False], [False, True, False, False])


@pytest.mark.parametrize(("best", "ends"), [(0.5, [0.0, 136.0]), (199.5, [64.0, 200.0])])
def test_draws_of_a_parameter_at_its_bound_reach_the_bound(best, ends):
    """Draws between 60 and 140 have quantiles of 64 and 136; the search ended within a hundredth of 200."""
    found = draw_intervals(line(0.0, 200.0), np.linspace(60, 140, 101)[:, None], np.array([best]))
    assert (found.is_identified.tolist(), found.is_at_bound.tolist()) == ([False], [True])
    assert found.ends[0] == pytest.approx(ends)


@pytest.mark.parametrize(("lasting", "least"), [(0.0, 0.85), (0.8, 0.8)])
def test_nine_of_ten_intervals_of_a_line_hold_its_slope(lasting, least):
    """Of fits of one slope to 20 blocks of 15 frames, whose errors last within a block and from one to the next.

    Of 200 intervals 180 are expected with a deviation of 4. Where errors last, neighbouring blocks err alike, and
    intervals are a little short: 169 hold the slope.
    """
    random, slope, truth = np.random.default_rng(7), 40.0, 0.5
    time = np.arange(300)
    jacobian = slope * np.sin(time / 9)[:, None]
    held = 0
    for _ in range(200):
        errors = random.normal(size=300)
        for t in time[1:]:
            errors[t] = lasting * errors[t - 1] + np.sqrt(1 - lasting**2) * errors[t]
        found = float(jacobian[:, 0] @ (truth * jacobian[:, 0] + errors) / (jacobian**2).sum())
        model = LinearModel(
            parameters=np.array([found]), residuals=jacobian[:, 0] * (found - truth) - errors, jacobian=jacobian,
            block=time // 15,
        )  # fmt: skip
        low, high = block_intervals(line(), model).ends[0]
        held += low <= truth <= high
    assert least <= held / 200 <= 0.95

"""The diagnosis' fits on linear models with closed forms of optimum, deviation and interval."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from fit.gap.fitting import (
    Pinned,
    Problem,
    Task,
    amplitude_of,
    by_jackknife,
    excludes_zero,
    fit,
    from_prior,
    sandwich,
)
from fit.methods import KINECT_SKIRT, SI
from formats.nature import NORMAL_90
from tests.fit.gap.linear_scene import LinearObserver, layout_of
from tests.fit.gap.verdict_scene import KINDS

NUMBERS = len(layout_of().take)
PARAMETERS = len(SI.initial)
HEM, TILT = KINDS["hem"], KINDS["gravity_tilt"]


def an_observer(missed, *, hem=None, drag=None, jacobian=None):
    given = {name: row for name, row in (("hem", hem), ("air_drag", drag)) if row is not None}
    none = np.zeros((NUMBERS, PARAMETERS))
    return LinearObserver(missed, none if jacobian is None else jacobian, given)


def rows(seed=0, count=3):
    """Orthogonal rows of length 1, (count, numbers)."""
    return np.linalg.qr(np.random.default_rng(seed).normal(size=(NUMBERS, count)))[0].T


def pinned_at(observer, size, sd, trust, name="hem"):
    amplitudes, spread = observer.off.copy(), np.full(len(observer.off), np.inf)
    amplitudes[observer.columns[name]], spread[observer.columns[name]] = size, sd
    return Pinned(amplitudes, spread, trust)


def test_an_amplitude_is_fitted_to_where_data_and_prior_meet():
    """r = m + 40 a s, a in typical sizes with a prior of 5: a = -40 m.s / (40^2 + 1/25); twenty fits are one each."""
    row, other, _ = rows()
    observer = an_observer(-30.0 * row + 5.0 * other, hem=40.0 * row / HEM.typical)
    best = 40.0 * 30.0 / (40.0**2 + 1 / 25)
    found = fit(observer, [Task(SI.initial, observer.off, ("hem",)), Task(SI.initial, observer.off)])
    assert found[0].amplitudes[observer.columns["hem"]] == pytest.approx(best * HEM.typical, rel=1e-4)
    assert found[0].cost == pytest.approx(25.0 + (40 * best - 30) ** 2, rel=1e-4)
    assert found[0].active == ("hem",)
    assert found[0].vector == pytest.approx(SI.initial)
    assert found[0].is_converged
    assert found[1].cost == pytest.approx(925.0)
    jacobian = np.concatenate([np.zeros((NUMBERS, PARAMETERS)), 40.0 * row[:, None]], 1)
    sd = np.append(np.full(PARAMETERS, 1.5), 5.0)
    told = sandwich(jacobian, found[0].residual, observer.layout.block, sd)
    assert found[0].deviation[-1] == pytest.approx(told[-1], rel=1e-3)
    assert found[0].deviation[:-1] == pytest.approx(1.5)  # data that say nothing leave the prior


@pytest.mark.parametrize(("tasks", "steps"), [(1, 4), (3, 4), (4, 3), (5, 3)])
def test_twelve_candidates_are_shared_by_the_fits_of_which_each_tries_three_or_four_steps_at_once(
    monkeypatch, tasks, steps
):
    row, other, _ = rows()
    jacobian = np.concatenate([np.zeros((NUMBERS, PARAMETERS)), 40.0 * row[:, None]], 1)
    observer = an_observer(-30.0 * row + 5.0 * other, hem=40.0 * row / HEM.typical)
    asked, residuals = [], observer.residuals
    monkeypatch.setattr(observer, "residuals", lambda v, a: asked.append(len(v)) or residuals(v, a))
    one = Task(SI.initial, observer.off, ("hem",), iterations=1, renewals=0, jacobian=jacobian, is_rough=True)
    fit(observer, [one] * tasks)
    assert asked == [tasks, tasks * steps]


def test_the_part_of_the_prior_by_hand():
    """Data of 3 and a prior of 0.5: H = 9 + 4, and 0.5^-2 / 13^2 = (2 / 13)^2; without data it is the prior."""
    assert from_prior(np.array([[3.0]]), np.array([0.5])) == pytest.approx(2 / 13)
    assert from_prior(np.zeros((1, 2)), np.array([1.5, 5.0])) == pytest.approx([1.5, 5.0])


def test_an_amplitude_that_is_known_from_other_data_is_weighted_by_its_precision_and_by_trust():
    """40^2 a^2 of data wants 0.75, and what is known 0.25 of a typical size to 0.1 / sqrt(4) = 0.05, or 1/0.05^2."""
    row, other, _ = rows(1)
    observer = an_observer(-30.0 * row + 5.0 * other, hem=40.0 * row / HEM.typical)
    known = pinned_at(observer, 0.25 * HEM.typical, 0.1 * HEM.typical, 4.0)
    (found,) = fit(observer, [Task(SI.initial, observer.off, ("hem",), pinned=known)])
    expected = (40.0 * 30.0 + 0.25 * 400.0) / (40.0**2 + 400.0)
    assert found.amplitudes[observer.columns["hem"]] == pytest.approx(expected * HEM.typical, rel=1e-3)
    assert found.deviation[-1] == pytest.approx(0.1)  # as well as it is known, however sure the cloth is
    assert found.pinned is known


def test_the_search_varies_parameters_and_amplitudes_in_typical_sizes_with_weak_priors():
    observer = an_observer(np.zeros(NUMBERS))
    problem = Problem(observer, ("gravity_tilt", "hem"))
    columns = np.arange(len(observer.off))
    assert problem.columns.tolist() == [*columns[observer.columns["gravity_tilt"]], *columns[observer.columns["hem"]]]
    assert problem.typical == pytest.approx([TILT.typical, TILT.typical, HEM.typical])
    assert problem.prior_sd == pytest.approx([1.5] * PARAMETERS + [5.0] * 3)
    assert problem.prior.mean == pytest.approx([*SI.initial, 0.0, 0.0, 0.0])
    assert np.diag(problem.prior.precision) == pytest.approx(problem.prior_sd**-2)
    assert problem.space.minimum[-3:] == pytest.approx([TILT.low / TILT.typical] * 2 + [HEM.low / HEM.typical])
    assert problem.space.maximum[-3:] == pytest.approx([TILT.high / TILT.typical] * 2 + [HEM.high / HEM.typical])
    assert problem.space.is_log.tolist() == [*SI.is_log, False, False, False]
    numbers = problem.pack(2 * SI.initial, observer.off + 0.5 * HEM.typical)
    vectors, amplitudes = problem.unpack(numbers[None])
    assert vectors[0] == pytest.approx(2 * SI.initial)
    assert amplitudes[0, observer.columns["hem"]] == pytest.approx(0.5 * HEM.typical)
    assert np.flatnonzero(amplitudes[0]).tolist() == sorted(problem.columns)
    beyond = problem.pack(1e9 * SI.initial, observer.off + 1e9)
    assert beyond == pytest.approx(problem.space.maximum)
    plain = an_observer(np.zeros(NUMBERS))
    plain.parameterisation = KINECT_SKIRT
    assert Problem(plain).prior_sd == pytest.approx(KINECT_SKIRT.maximum - KINECT_SKIRT.minimum)


@pytest.mark.parametrize(("deviations", "is_known"), [(4.9, True), (5.1, False)])
def test_a_value_known_worse_than_its_prior_counts_as_unknown(deviations, is_known):
    """2 x 4.9 typical sizes of a trust of 4 are 4.9."""
    observer = an_observer(np.zeros(NUMBERS))
    known = pinned_at(observer, 0.3 * HEM.typical, 2 * deviations * HEM.typical, 4.0)
    problem = Problem(observer, ("gravity_tilt", "hem"), known)
    assert problem.prior_sd == pytest.approx([1.5] * PARAMETERS + [5.0, 5.0, min(deviations, 5.0)])
    assert problem.prior.mean[-1] == (pytest.approx(0.3) if is_known else 0.0)
    assert np.diag(problem.prior.precision) == pytest.approx(problem.prior_sd**-2)


def test_an_effects_interval_is_that_of_its_own_columns():
    """A hem after a tilt of two components: 0.02 and 1.645 of its 0.3 typical sizes either way."""
    observer = an_observer(np.zeros(NUMBERS))
    amplitudes = observer.off.copy()
    amplitudes[observer.columns["gravity_tilt"]], amplitudes[observer.columns["hem"]] = (0.03, 0.001), 0.02
    fitted = dataclasses.replace(
        observer.fitted(), amplitudes=amplitudes, active=("gravity_tilt", "hem"),
        deviation=np.array([9.0] * PARAMETERS + [0.01 / TILT.typical, 0.05 / TILT.typical, 0.3]),
    )  # fmt: skip
    value, interval = amplitude_of(fitted, observer, "hem")
    assert value == pytest.approx(0.02)
    half = 1.645 * 0.3 * HEM.typical
    assert interval == pytest.approx((0.02 - half, 0.02 + half))
    # (0.03, 0.001) known to 0.01 and 0.05: of the second no more than itself is taken off, its interval is along both.
    value, (low, high) = amplitude_of(fitted, observer, "gravity_tilt")
    assert value == pytest.approx(np.sqrt(0.03**2 - 0.01**2))
    along = np.array([0.03, 0.001]) / np.hypot(0.03, 0.001)
    half = 1.645 * np.hypot(along[0] * 0.01, along[1] * 0.05)
    assert (low, high) == pytest.approx((value - half, value + half))
    nothing = dataclasses.replace(fitted, amplitudes=observer.off)
    half = 1.645 * 0.05  # of a tilt in any direction: the one that is known worse
    assert amplitude_of(nothing, observer, "gravity_tilt") == (0.0, pytest.approx((-half, half)))


def test_the_jackknife_of_three_blocks_is_the_standard_error_of_their_mean_with_students_t():
    """Left out in turn, 2, -1 and -1 leave means of -1, 1/2 and 1/2. Two degrees of freedom: 2.920 for 1.645."""
    found = by_jackknife(np.ones((3, 1)), np.array([2.0, -1.0, -1.0]), np.arange(3), np.array([1e6]))
    assert found == pytest.approx([2.920 / 1.645 * np.std([2.0, -1.0, -1.0], ddof=1) / np.sqrt(3)], rel=1e-3)
    nothing = by_jackknife(np.zeros((3, 1)), np.array([2.0, -1.0, -1.0]), np.arange(3), np.array([1.5]))
    assert nothing == pytest.approx([1.5])  # t widens what the data tell, and no prior


def test_intervals_of_few_blocks_hold_the_truth_as_often_as_they_say():
    """Five numbers of twelve blocks with one error each: the jackknife's 90 % hold 1800 of 2000, within 60."""
    rng, block, free = np.random.default_rng(4), np.repeat(np.arange(12), 4), np.full(5, 1e6)
    held = {sandwich: 0, by_jackknife: 0}
    for _ in range(400):
        jacobian, residual = rng.normal(size=(48, 5)), np.repeat(rng.normal(size=12), 4)
        step = np.linalg.lstsq(jacobian, residual, rcond=None)[0]
        left = residual - jacobian @ step
        for rule in held:
            held[rule] += int((np.abs(step) <= NORMAL_90 * rule(jacobian, left, block, free)).sum())
    assert held[by_jackknife] == pytest.approx(1800, abs=60)
    assert held[sandwich] < 1740  # what the fit took away of each block is missing


def test_a_single_block_has_no_more_than_its_own_scores():
    """One block whose scores add up to 4 beside four ones: 4 / 4."""
    found = sandwich(np.ones((4, 1)), np.ones(4), np.zeros(4, int), np.array([1e6]))
    assert found == pytest.approx([1.0])


def test_the_sandwich_of_few_blocks_is_the_standard_error_of_their_mean():
    """Residuals of 2, -1 and -1, each of a block of its own: a deviation of sqrt(6 / 2), over the root of three."""
    found = sandwich(np.ones((3, 1)), np.array([2.0, -1.0, -1.0]), np.arange(3), np.array([1e6]))
    assert found == pytest.approx([np.std([2.0, -1.0, -1.0], ddof=1) / np.sqrt(3)])


@pytest.mark.parametrize(
    ("interval", "is_apart"),
    [((0.1, 0.2), True), ((-2.0, -1.0), True), ((-0.1, 0.2), False), ((0.0, 2.0), False), ((-2.0, 0.0), False)],
)
def test_an_interval_excludes_zero_on_either_side_of_it(interval, is_apart):
    assert excludes_zero(interval) == is_apart


def test_an_amplitudes_deviation_is_of_the_data_alone_and_a_parameters_of_its_prior_too():
    """A row of length 0.1, which a prior of five typical sizes outweighs, beside parameters that move nothing."""
    row, other, _ = rows()
    mixed = 5.0 * (other + row)
    observer = an_observer(mixed, hem=0.1 * row / HEM.typical)
    (found,) = fit(observer, [Task(SI.initial, observer.off, ("hem",))])
    jacobian = np.concatenate([np.zeros((NUMBERS, PARAMETERS)), 0.1 * row[:, None]], 1)
    sd = np.append(np.full(PARAMETERS, 1.5), 5.0)
    of_data = sandwich(jacobian, found.residual, observer.layout.block, sd)[-1]
    assert found.deviation[-1] == pytest.approx(of_data, rel=1e-6)
    assert found.deviation[:-1] == pytest.approx(1.5)
    assert from_prior(jacobian, sd)[-1] > 0.5 * of_data  # it would show

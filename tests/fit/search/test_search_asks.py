"""The candidates that searches propose, step by step, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from fit.errors import FitError
from fit.search.annealing import AnnealingSettings, SearchBox
from fit.search.chains import ParallelChains
from fit.search.least_squares import BoundedSpace, LeastSquaresSettings, Prior, minimise, search
from tests.fit.search.test_search_family import OUTPUT, SPACE, begun, bowl
from tests.fit.search.test_search_least_squares import box


@pytest.mark.parametrize("name", [name for name in OUTPUT if hasattr(begun(name), "space")])
def test_a_search_asks_for_one_candidate_unless_more_are_wanted(name):
    """The start comes first, alone; then so many as are asked for at most."""
    one = begun(name)
    first = one.ask()
    assert first == pytest.approx(SPACE.from_unit(SPACE.to_unit(first)))
    one.tell(first, bowl(first))
    assert len(one.ask()) == 1
    with pytest.raises(ValueError, match="at least one candidate"):
        one.ask(0)


def chains(count=3, iterations=9, *, is_split=False):
    space = SearchBox(minimum=np.zeros(2), maximum=np.ones(2), interval=np.full(2, 0.1))
    starts = np.linspace(0.2, 0.8, 2 * count).reshape(count, 2)
    settings = AnnealingSettings(iterations=iterations)
    return starts, ParallelChains(starts, space, settings, np.random.default_rng(1), is_split=is_split)


def test_chains_share_a_batch_and_the_first_have_what_is_left_over():
    starts, several = chains()
    assert not several.is_started
    assert several.ask(2).tolist() == starts[:2].tolist()
    asked = several.ask(8)
    assert [count for _, count in several._asked] == [3, 3, 2]
    assert asked[[0, 3, 6]].tolist() == starts.tolist()
    asked = several.ask(3)
    assert several.tell(asked, np.array([3.0, 1.0, 2.0])) == 0  # starts are no iterations
    assert several.is_started
    assert (several.best_distance, several.best.tolist()) == (1.0, starts[1].tolist())
    assert several.winner is several.chains[1]
    assert several.evaluations == 3
    assert not several.is_finished


def test_chains_require_the_distances_of_their_candidates():
    _, several = chains()
    with pytest.raises(ValueError, match="one distance for each candidate"):
        several.tell(np.zeros((1, 2)), np.zeros(1))
    asked = several.ask(3)
    with pytest.raises(ValueError, match="one distance for each candidate"):
        several.tell(asked, np.zeros(2))
    with pytest.raises(ValueError, match="one distance for each candidate"):
        several.tell(asked[:2], np.zeros(2))
    several.tell(asked, np.zeros(3))
    with pytest.raises(ValueError, match="one distance for each candidate"):
        several.tell(asked, np.zeros(3))


def test_a_saved_number_of_chains_is_the_same():
    _, several = chains()
    _, fewer = chains(2)
    with pytest.raises(FitError, match=r"^annealing: the saved search has 3 chains, not 2; start anew"):
        fewer.restore(several.state())


def test_each_of_more_chains_than_iterations_has_one():
    assert [chain.settings.iterations for chain in chains(3, iterations=2, is_split=True)[1].chains] == [1, 1, 1]


def test_the_best_history_of_chains_is_the_least_of_them_and_the_last_goes_on():
    _, several = chains(2)
    several.chains[0].tell(several.chains[0].ask(1), np.array([3.0]))
    several.chains[1].tell(several.chains[1].ask(1), np.array([5.0]))
    assert several.best_history.tolist() == [3.0]
    while not several.chains[1].is_finished:
        own = several.chains[1].ask(1)
        several.chains[1].tell(own, np.full(len(own), 2.0))
    history = several.best_history
    assert len(history) == len(several.chains[1].steps)
    assert history[0] == 3.0
    assert history[-1] == 2.0
    assert (np.diff(history) <= 0).all()


def asked_of(width, *, known, start=0.5, answers=1.0, prior=None, **settings):
    """Every candidate of a search whose residuals never change, (lanes, 1) a batch."""
    one = search(
        np.array([start]), box(0.0, 1.0), prior=prior, jacobian=known,
        settings=LeastSquaresSettings(width=width, is_exact=False, renewals=0, **settings),
    )  # fmt: skip
    batches, batch = [], next(one)
    while True:
        batches.append(batch[:, 0])
        try:
            batch = one.send(np.full((len(batch), 1), answers))
        except StopIteration as stop:
            return batches, stop.value


def trial(damping, slope, normal=4.0, start=0.5):
    return np.clip(start - slope / (normal * (1 + damping) + 1e-9 * normal), 0.0, 1.0)


def test_steps_are_those_of_marquardts_formula_over_three_ladders():
    """J = 2 and r = 1: 4 (1 + lambda) s = -2, lambda from 0.01 / 30 to 0.01 x 30, and a thousand times on."""
    batches, found = asked_of(4, known=np.array([[2.0]]))
    assert [len(batch) for batch in batches] == [1, 4, 4, 4]
    for k in range(3):
        expected = [trial(0.01 * 1e3**k * 10.0**x, 2.0) for x in (-1.5, -0.5, 0.5, 1.5)]
        assert batches[1 + k] == pytest.approx(expected, rel=1e-9)
    assert (found.reason, found.is_converged) == ("no step lowers the cost", True)
    assert (found.simulations, found.batches) == (13, 4)
    assert found.parameters == pytest.approx([0.5])


def test_one_lane_tries_a_tenth_of_the_damping_and_ten_times_more_twelve_times():
    batches, found = asked_of(1, known=np.array([[2.0]]))
    assert len(batches) == 13
    assert np.concatenate(batches[1:]) == pytest.approx([trial(0.001 * 10.0**k, 2.0) for k in range(12)], rel=1e-9)
    assert found.simulations == found.batches == 13


def test_a_prior_pulls_a_step_towards_its_mean():
    """A precision of 3 about 0.9 at 0.5: the slope is 2 - 3 x 0.4, the curvature 4 + 3."""
    prior = Prior(mean=np.array([0.9]), precision=np.array([[3.0]]))
    batches, found = asked_of(1, known=np.array([[2.0]]), prior=prior)
    assert batches[1] == pytest.approx([0.5 - 0.8 / (7 * 1.001)], rel=1e-7)
    assert found.cost == pytest.approx(1 + 3 * 0.16)
    assert found.precision == pytest.approx(np.array([[7.0]]))
    assert found.covariance(2.0) == pytest.approx(np.array([[2 / 7]]))


@pytest.mark.parametrize(("at", "slope", "is_held"), [(0.0, 1.0, True), (1.0, -1.0, True), (0.0, 0.0, False),
                                                      (1.0, 0.0, False), (0.5, 1.0, False)])  # fmt: skip
def test_a_bound_holds_a_parameter_that_would_go_on(at, slope, is_held):
    _, found = asked_of(4, known=np.array([[slope]]), start=at)
    assert found.reason == ("no slope is left within the bounds" if is_held or not slope else "no step lowers the cost")
    assert found.is_converged


def test_a_box_is_measured_on_its_scale():
    """From 1 to 100 on a log scale the middle is 10, and a share of the box ln 100 times the parameter."""
    space = BoundedSpace(minimum=np.array([1.0, -2.0]), maximum=np.array([100.0, 2.0]), is_log=np.array([True, False]))
    assert space.from_unit(np.array([0.5, 0.25])) == pytest.approx([10.0, -1.0])
    assert space.to_unit(np.array([10.0, -1.0])) == pytest.approx([0.5, 0.25])
    assert space.to_unit(np.array([1e4, -9.0])).tolist() == [1.0, 0.0]
    assert space.from_unit(np.array([1e9, -1e9])).tolist() == [100.0, -2.0]
    assert space.to_unit(np.array([0.0, 2.0])).tolist() == [0.0, 1.0]
    assert np.isnan(space.to_unit(np.array([-1.0, 0.0]))[0])  # nowhere, and no warning
    assert space.slope(np.array([10.0, -1.0])) == pytest.approx([10 * np.log(100), 4.0])
    for low, high, is_log in ((1.0, 1.0, False), (0.0, 1.0, True), (-1.0, 1.0, True)):
        with pytest.raises(FitError):
            box(low, high, is_log)


def test_differences_are_taken_inwards_and_from_the_other_side_where_one_blows_up():
    """r = u^2: from 0.5 by 0.05 the slope is 1.05, from 1 downwards 1.95, and backwards from 0.5 0.95."""

    def squares(candidates):
        return candidates**2

    for start, slope in ((0.5, 1.05), (1.0, 1.95), (0.96, 1.87)):
        found = minimise(squares, np.array([start]), box(0.0, 1.0), settings=LeastSquaresSettings(max_iterations=0))
        assert found.jacobian == pytest.approx(np.array([[slope]]))

    def broken(candidates):
        return np.where(candidates > 0.52, np.nan, candidates**2)

    none = LeastSquaresSettings(max_iterations=0)
    assert minimise(broken, np.array([0.5]), box(0, 1), settings=none).jacobian == pytest.approx(np.array([[0.95]]))

    def alone(candidates):
        return np.where(candidates != 0.5, np.nan, candidates)

    assert minimise(alone, np.array([0.5]), box(0, 1), settings=none).jacobian.tolist() == [[0.0]]


def ended_of(residual, *, start=(0.5, 0.25), known=None, low=(0.0, 0.0), high=(2.0, 4.0), **changes):
    space = BoundedSpace(minimum=np.array(low), maximum=np.array(high), is_log=np.zeros(2, bool))
    return minimise(residual, np.array(start), space, settings=LeastSquaresSettings(**changes), jacobian=known)


MATRIX, TARGET = np.array([[1.0, 0.5], [0.0, 2.0], [1.0, -1.0]]), np.array([1.5, 1.0, 0.25])


def linear(candidates):
    return candidates @ MATRIX.T - TARGET


def curved(candidates):
    return np.concatenate([linear(candidates), 0.3 * candidates[:, :1] ** 2], 1)


@pytest.mark.parametrize(
    ("residual", "changes", "reason", "is_converged", "steps"),
    [
        (linear, {"max_iterations": 1, "cost_tolerance": 0.0, "step_tolerance": 0.0}, "stopped after 1 iterations",
         False, 1),
        (linear, {"max_iterations": 1}, "stopped after 1 iterations", False, 1),
        (linear, {"cost_tolerance": 1.0}, "the cost has stopped falling", True, 1),
        (curved, {"cost_tolerance": 0.0, "step_tolerance": 1.0}, "the steps have become short", True, 1),
        (curved, {"max_iterations": 2, "cost_tolerance": 0.0, "step_tolerance": 0.0, "is_exact": False},
         "stopped after 2 iterations", False, 2),
        (linear, {"known_cost": 1e-6, "cost_tolerance": 1e-9, "step_tolerance": 0.0, "max_iterations": 4},
         "the cost will hardly fall below the known one", False, 2),
    ],
)  # fmt: skip
def test_a_search_says_why_it_ended(residual, changes, reason, is_converged, steps):
    found = ended_of(residual, **changes)
    assert (found.reason, found.is_converged) == (reason, is_converged)
    assert len(found.cost_history) == 1 + steps
    assert found.cost_history[-1] == found.cost == pytest.approx(float((residual(found.parameters[None]) ** 2).sum()))


def test_the_end_of_a_linear_search_is_that_of_the_normal_equations_with_all_that_belongs_to_it():
    """One step of almost no damping; candidates in a box of 2 by 4, slopes in own units, whose box is no logarithm."""
    found = ended_of(linear, damping=1e-9, cost_tolerance=1e-3)
    best = np.linalg.lstsq(MATRIX, TARGET, rcond=None)[0]
    assert found.parameters == pytest.approx(best, rel=1e-4)
    assert found.residuals == pytest.approx(linear(best[None])[0], abs=1e-4)
    assert found.jacobian == pytest.approx(MATRIX, rel=1e-6)
    assert found.slopes_at == pytest.approx(found.parameters, rel=1e-6)
    assert found.prior_precision.tolist() == np.zeros((2, 2)).tolist()
    assert found.precision == pytest.approx(MATRIX.T @ MATRIX, rel=1e-6)
    assert found.covariance(4.0) == pytest.approx(4.0 * np.linalg.inv(MATRIX.T @ MATRIX), rel=1e-6)
    assert found.cost_history[0] == pytest.approx(float((linear(np.array([[0.5, 0.25]])) ** 2).sum()))


def test_a_known_jacobian_is_returned_updated_and_costs_no_differences():
    """The start, a ladder of eight and one of another eight."""
    found = ended_of(curved, known=np.concatenate([MATRIX, [[0.4, 0.0]]]), is_chord=True, max_iterations=1,
                     cost_tolerance=0.0, step_tolerance=0.0)  # fmt: skip
    assert (found.simulations, found.batches) == (9, 2)
    assert found.slopes_at == pytest.approx([0.5, 0.25])
    moved = found.parameters - [0.5, 0.25]
    change = curved(found.parameters[None])[0] - curved(np.array([[0.5, 0.25]]))[0]
    assert found.jacobian @ moved == pytest.approx(change)  # Broyden's update


def test_a_derivative_is_zero_where_its_only_side_within_the_bounds_blows_up():
    """From 1 downwards it blows up, and there is no other side: no difference of nothing over nothing is warned of."""

    def alone(candidates):
        return np.where(candidates < 1.0, np.nan, candidates)

    found = minimise(alone, np.array([1.0]), box(0.0, 1.0), settings=LeastSquaresSettings(max_iterations=0))
    assert found.jacobian.tolist() == [[0.0]]


@pytest.mark.parametrize("name", OUTPUT)
def test_a_search_that_has_not_begun_is_not_finished(name):
    """In a saved state as well, which other programs read: true and false, and never nothing."""
    one = begun(name)
    assert one.is_finished is False
    assert all(value is not None for key, value in one.state().items() if key.startswith("is_"))


def test_finished_chains_ask_for_nothing_and_say_so_with_an_empty_array():
    _, several = chains(iterations=3)
    while not several.is_finished:
        before, asked = [len(chain.steps) for chain in several.chains], several.ask(6)
        done = several.tell(asked, ((asked - 0.4) ** 2).sum(1))
        started = before[0] > 0
        assert not started or done == sum(len(chain.steps) for chain in several.chains) - sum(before)
    assert several.ask(6).shape == (0, 2)


def test_of_a_ladder_whose_far_lanes_blow_up_in_one_number_the_best_of_the_others_is_taken():
    """r = x - 2 from 0: steps of 2 / (1 + lambda), of which those beyond 1 have a second number that is none."""

    def partly(candidates):
        return np.concatenate([candidates - 2.0, np.where(candidates > 1.0, np.nan, 0.0)], 1)

    found = minimise(
        partly, np.array([0.0]), box(0.0, 4.0), settings=LeastSquaresSettings(width=4, max_iterations=1, damping=1.0)
    )
    assert found.parameters == pytest.approx([2 / (1 + 10**0.5)], rel=1e-6)


@pytest.mark.parametrize("renewals", [0, 1, 2])
def test_chords_that_find_no_further_step_are_renewed_so_often_and_no_more(renewals):
    """One ladder after each Jacobian halves r, and no other lowers it."""
    one = search(
        np.array([0.5]), box(0.0, 1.0),
        settings=LeastSquaresSettings(width=4, is_exact=False, is_chord=True, renewals=renewals),
    )  # fmt: skip
    at, left, jacobians, is_new = next(one)[0, 0], 1.0, 0, False
    batch = one.send(np.array([[left]]))
    while True:
        if len(batch) == 1:
            jacobians, is_new = jacobians + 1, True
            answers = left + 10 * (batch - at)
        elif is_new:
            at, left, is_new = batch[0, 0], 0.5 * left, False
            answers = np.full((4, 1), left)
        else:
            answers = np.full((4, 1), 9.0)
        try:
            batch = one.send(answers)
        except StopIteration as stop:
            found = stop.value
            break
    assert jacobians == 1 + renewals
    assert found.cost == pytest.approx(0.25 ** (1 + renewals))

"""Starts of further descents after a descent that ended in a wrong local minimum."""

from __future__ import annotations

import numpy as np
import pytest

from fit.search.valleys import HOPPED, across

# Two parameters of which the sum is known ten times as well as the difference, and a third that is known by itself.
JACOBIAN = np.array([[3.0, 3.0, 0.0], [0.3, -0.3, 0.0], [0.0, 0.0, 1.0]])
END = np.array([0.5, 0.5, 0.5])
WEAK = 1e-6 * np.eye(3)


def never(candidates):
    raise AssertionError(f"asked of {len(candidates)} candidates")


def test_one_parameter_is_displaced_and_another_compensates():
    asked = []

    def judge(candidates):
        asked.append(candidates)
        return np.abs(candidates[:, 0] - 0.8)  # the valley beyond

    found = across(END, JACOBIAN, WEAK, 1.0, 2, judge)
    (candidates,) = asked
    # H_oo^-1 H_ok of the sum and the difference: (9 - 0.09) / (9 + 0.09).
    apart = candidates - END
    assert np.allclose(apart[:, 2], 0.0)
    for moved in apart:
        k = int(np.abs(moved[:2]).argmax())
        assert moved[1 - k] == pytest.approx(-moved[k] * 8.91 / 9.09, rel=1e-6)
    assert sorted({round(abs(float(m)), 2) for m in apart[:6, 0]}) == [0.15, 0.3, 0.45]
    assert len(found) == HOPPED
    assert found[0, 0] == pytest.approx(0.8)
    # The second place is one in another direction, and not the next best in the same one.
    assert found[1, 0] != pytest.approx(0.65)


def test_candidates_stay_within_the_bounds():
    seen = []
    across(
        np.array([0.9, 0.05, 0.5]),
        JACOBIAN,
        WEAK,
        1.0,
        2,
        lambda units: seen.append(units) or units[:, 0],
    )
    assert ((seen[0] >= 0) & (seen[0] <= 1)).all()
    assert not np.isclose(seen[0][:, 0], 1.05).any()


@pytest.mark.parametrize("scale", [1e3, 1e-4])
def test_parameters_that_the_data_determine_closely_or_not_at_all_are_not_displaced(scale):
    assert across(END, scale * np.eye(3), 1e-12 * np.eye(3), 1.0, 3, never).shape == (0, 3)


def test_only_the_first_parameters_are_moved_alone():
    seen = []
    across(END, JACOBIAN, WEAK, 1.0, 1, lambda units: seen.append(units) or units[:, 0])
    assert len(seen[0]) == 6


# H = J'J + P = [[5, 2], [2, 4]]: a step s of the first leads the second by -s / 2, and costs 4 s^2.
TILTED, PRIOR = np.array([[2.0, 1.0], [0.0, 1.0]]), np.diag([1.0, 2.0])


def asked_from(unit, cost=40.0, judged=None):
    """The candidates that are judged from an end, and those that are returned."""
    seen = []

    def judge(candidates):
        seen.append(candidates)
        return np.arange(len(candidates), dtype=float) if judged is None else np.array(judged)

    found = across(np.array(unit), TILTED, PRIOR, cost, 1, judge)
    return seen[0], found


def test_candidates_along_the_floor_of_a_valley_by_hand():
    """From 0.8 a step of 0.15 stays in the box, and steps of 0.3 and 0.45 only downwards."""
    candidates, _ = asked_from([0.8, 0.3])
    assert candidates == pytest.approx(np.array([[0.35, 0.525], [0.5, 0.45], [0.65, 0.375], [0.95, 0.225]]))


@pytest.mark.parametrize(("first", "count"), [(0.45, 6), (0.55, 6), (0.44, 5), (0.56, 5)])
def test_a_step_may_end_on_a_bound_and_not_beyond(first, count):
    assert len(asked_from([first, 0.5])[0]) == count


def test_a_compensating_parameter_stops_at_its_bound():
    assert asked_from([0.5, 0.1])[0][:, 1] == pytest.approx([0.325, 0.25, 0.175, 0.025, 0.0, 0.0])
    assert asked_from([0.5, 0.9])[0][:, 1] == pytest.approx([1.0, 1.0, 0.975, 0.825, 0.75, 0.675])


def test_a_rise_of_a_five_hundredth_of_the_cost_is_enough_and_less_is_not():
    """The nearest step, 0.15, costs 4 x 0.15^2 = 0.09: more than 0.002 of 44 and less than that of 46."""
    assert len(asked_from([0.5, 0.5], cost=44.0)[0]) == 6
    assert across(np.array([0.5, 0.5]), TILTED, PRIOR, 46.0, 1, never).shape == (0, 2)


def test_a_rise_of_twice_the_cost_is_too_much():
    """0.09 is less than twice 0.046 and more than twice 0.044."""
    assert len(asked_from([0.5, 0.5], cost=0.046)[0]) == 6
    assert across(np.array([0.5, 0.5]), TILTED, PRIOR, 0.044, 1, never).shape == (0, 2)


def test_the_best_candidate_of_either_direction_is_returned_the_better_first():
    """Of three candidates below and three above the end, the second of each costs least, above less than below."""
    candidates, found = asked_from([0.5, 0.5], judged=[9.0, 2.0, 8.0, 7.0, 1.0, 6.0])
    assert found == pytest.approx(candidates[[4, 1]])

"""The distance D of eq. 1 by hand: counted points and frames, and blown-up simulations."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from fit.methods.distance import TrajectoryDistance, distance, distances, per_frame, total

NOT_SEEN = [np.nan, np.nan, np.nan]
# Three frames of three points at the origin, of which one is missing in the first and all in the second.
REAL = np.array([[[0.0, 0, 0], NOT_SEEN, [0, 0, 0]], [NOT_SEEN] * 3, [[0.0, 0, 0]] * 3])
# Every simulated point lies 3-4-0 millimetres times its number, 1 to 3, away.
SIMULATED = np.array([[[3.0, 4, 0], [6, 8, 0], [9, 12, 0]]] * 3) * 1e-3


def test_a_point_is_as_far_away_as_its_three_axes_say():
    """3 mm and 4 mm are 5 mm; not seen is not known."""
    apart = distances(REAL, SIMULATED)
    assert apart[2] == pytest.approx([5e-3, 10e-3, 15e-3])
    assert np.isnan(apart[0, 1])


def test_distances_are_between_positions_wherever_both_are():
    """10 and 13 m along each axis are sqrt(27) m apart."""
    assert distances(np.full((1, 1, 3), 10.0), np.full((1, 1, 3), 13.0)) == pytest.approx(np.sqrt(27))


def test_a_frames_mean_is_over_the_points_that_are_seen_in_it():
    """5 and 15 mm of the first frame are 10 in the mean, and not 20 / 3; of the second frame nothing is known."""
    assert per_frame(REAL, SIMULATED) == pytest.approx([10e-3, np.nan, 10e-3], nan_ok=True)


def test_d_is_the_mean_over_the_frames_in_which_a_point_is_seen_and_not_over_all_points():
    """Frames of 20 mm, from two points of which one is seen, and of 5 mm: 12.5 mm; by points it would be 10 mm."""
    real = np.array([[[0.0, 0, 0], NOT_SEEN], [NOT_SEEN, NOT_SEEN], [[0.0, 0, 0], [0.0, 0, 0]]])
    simulated = np.array([[[20e-3, 0, 0], [9.0, 9, 9]], [[9.0, 9, 9]] * 2, [[5e-3, 0, 0], [0, 5e-3, 0]]])
    assert distance(real, simulated) == pytest.approx(12.5e-3)


def test_many_candidates_are_judged_side_by_side():
    both = np.stack([SIMULATED, 2 * SIMULATED])
    assert distance(REAL, both) == pytest.approx([10e-3, 20e-3])
    assert per_frame(REAL, both).shape == (2, 3)


def test_a_candidate_that_blew_up_is_infinitely_far_and_its_neighbour_is_not():
    broken = SIMULATED.copy()
    broken[2, 1] = np.inf
    assert distance(REAL, np.stack([SIMULATED, broken])).tolist() == [pytest.approx(10e-3), np.inf]
    broken[2, 1] = np.nan
    assert distance(REAL, broken) == np.inf


def test_the_objective_has_one_part_in_metres_and_no_remark():
    objective = TrajectoryDistance(SimpleNamespace(points=REAL))
    assert objective.terms(np.stack([SIMULATED, 2 * SIMULATED])) == pytest.approx(np.array([[10e-3], [20e-3]]))
    assert (objective.name, objective.unit, objective.parts, objective.remark) == ("D", "m", ("distance",), "")


def test_the_total_of_parts_is_their_sum_and_infinite_where_one_is_not_finite():
    parts = np.array([[1.0, 2.0, 3.5], [1.0, np.nan, 1.0], [np.inf, -np.inf, 1.0]])
    objective = SimpleNamespace(terms=lambda simulated: parts)
    assert total(objective, np.zeros(3)).tolist() == [6.5, np.inf, np.inf]


def test_a_point_of_which_one_axis_is_missing_is_not_seen():
    real = np.array([[[0.0, np.nan, 0.0], [0.0, 0.0, 0.0]]])
    assert distance(real, np.array([[[9.0, 9.0, 9.0], [3e-3, 4e-3, 0.0]]])) == pytest.approx(5e-3)

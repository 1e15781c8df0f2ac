"""Distances to the sides of a polygon end at the sides' ends; many polygons are compared at once."""

from __future__ import annotations

import numpy as np
import pytest

from formats.polygons import CELLS_AT_ONCE, distances_outside, distances_to_sides, first_overlap, inside

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


@pytest.mark.parametrize(
    ("place", "apart"),
    [
        ((-3.0, 0.0), (3.0, 4.0, 10**0.5, 3.0)),
        ((4.0, 0.0), (3.0, 3.0, 10**0.5, 4.0)),
        ((0.25, 0.5), (0.5, 0.75, 0.5, 0.25)),
    ],
)
def test_a_side_is_as_far_as_its_nearest_point_and_no_line_through_it(place, apart):
    assert distances_to_sides(np.array([place]), SQUARE)[0] == pytest.approx(apart)


def test_only_a_point_outside_is_away():
    places = np.array([[0.25, 0.5], [-3.0, -4.0]])
    assert distances_outside(places, SQUARE) == pytest.approx([0.0, 5.0])


def test_a_point_beside_a_dent_is_outside():
    dented = np.array([[0.0, 0.0], [1.0, 0.0], [0.5, 0.5], [1.0, 1.0], [0.0, 1.0]])
    assert inside(np.array([[0.25, 0.5], [0.75, 0.5], [0.75, 0.2], [2.0, 0.1]]), dented).tolist() == [1, 0, 1, 0]


def test_more_points_than_are_compared_at_once_keep_their_order():
    count = CELLS_AT_ONCE // len(SQUARE) + 3
    places = np.stack([np.linspace(0.0, 2.0, count), np.full(count, 0.5)], axis=1)
    far = np.maximum(places[:, 0] - 1, 0)
    assert distances_outside(places, SQUARE) == pytest.approx(far, abs=1e-12)


@pytest.mark.parametrize(
    ("other", "meets"),
    [
        (SQUARE + np.array([1.1, 0.0]), False),  # beside
        (SQUARE + np.array([1.0, 0.3]), True),  # touches with a corner
        (SQUARE + np.array([0.5, 0.5]), True),  # crosses
        (SQUARE * 0.5 + 0.25, True),  # lies in it
        (SQUARE * 3 - 1, True),  # holds it
        (np.array([[-0.5, 0.4], [1.5, 0.4], [1.5, 0.6], [-0.5, 0.6]]), True),  # crosses, no corner in the other
    ],
)
def test_the_first_polygon_that_meets_an_earlier_one_is_named(other, meets):
    far = SQUARE + np.array([0.0, 10.0])
    assert first_overlap([SQUARE, other]) == ((1, 0) if meets else None)
    assert first_overlap([far, SQUARE, other, other]) == ((2, 1) if meets else (3, 2))
    assert first_overlap([SQUARE]) is None

"""Distances to the sides of a polygon end at the sides' ends."""

from __future__ import annotations

import numpy as np
import pytest

from formats.polygons import distance_outside, distances_to_sides

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


@pytest.mark.parametrize(
    ("place", "apart"),
    [
        ((-3.0, 0.0), (3.0, 4.0, 10**0.5, 3.0)),
        ((4.0, 0.0), (3.0, 3.0, 10**0.5, 4.0)),
        ((0.25, 0.5), (0.5, 0.75, 0.5, 0.25)),
    ],
)
def test_a_side_is_as_far_as_its_nearest_place_and_no_line_through_it(place, apart):
    assert distances_to_sides(np.array(place), SQUARE) == pytest.approx(apart)


def test_only_a_place_outside_is_away():
    assert distance_outside(np.array([0.25, 0.5]), SQUARE) == 0.0
    assert distance_outside(np.array([-3.0, -4.0]), SQUARE) == pytest.approx(5.0)

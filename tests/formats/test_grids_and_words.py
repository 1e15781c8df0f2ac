"""Grids of swung cloth are read by their places, and lines of progress keep whole words, at their bounds."""

from __future__ import annotations

import numpy as np
import pytest

from formats.importers.swung_cloth import _is_crossed, _line, _names, _row_ends
from formats.terminal import _whole_words, in_words

GRID = np.array([(x, y) for y in (0.0, -0.3) for x in (0.2, -0.2, 0.0)])  # m: two rows of three, in no order


def test_the_held_row_ends_where_its_points_are_farthest_left_and_right():
    """It is the upper row."""
    points = np.arange(2 * 6 * 3).reshape(2, 6, 3).astype(float)
    valid = np.ones((2, 6), bool)
    valid[1, 0] = False
    found = _row_ends(points, valid, GRID)
    assert np.array_equal(found[0], points[0, [1, 0]])
    assert np.array_equal(found[1, 0], points[1, 1])
    assert np.isnan(found[1, 1]).all()


@pytest.mark.parametrize(("down", "ends"), [(0.00035, [1, 0]), (0.00045, [1, 2])])
def test_a_point_is_of_the_held_row_within_a_thousandth_of_the_larger_side(down, ends):
    """The grid is 0.4 m wide."""
    rest, points = GRID.copy(), np.arange(6 * 3).reshape(1, 6, 3).astype(float)
    rest[0, 1] -= down
    assert np.array_equal(_row_ends(points, np.ones((1, 6), bool), rest)[0], points[0, ends])


@pytest.mark.parametrize(("values", "numbers"), [
    ([0.2, -0.2, 0.0, -0.2], [2, 0, 1, 0]), ([0.0], [0]), ([], []), ([1.0, 1.0], [0, 0]), ([3.0, 2.0, 1.0], [2, 1, 0]),
])  # fmt: skip
def test_lines_of_a_grid_are_numbered_from_the_smallest(values, numbers):
    assert _line(np.array(values, float)) == numbers


def test_points_are_named_by_row_from_the_bottom_and_column_from_the_left():
    assert _names(GRID) == [
        "row1_column2", "row1_column0", "row1_column1", "row0_column2", "row0_column0", "row0_column1"
    ]  # fmt: skip


@pytest.mark.parametrize("is_crossed", [False, True])
def test_corners_are_crossed_where_each_is_nearer_to_the_other_end(is_crossed):
    """A frame in which one end was not seen says nothing."""
    points = np.zeros((3, 6, 3))
    points[..., :2] = GRID
    valid = np.ones((3, 6), bool)
    valid[2, 0] = False
    held = points[:, [0, 1] if is_crossed else [1, 0]].copy()
    held[2] = held[2, ::-1] + [9.0, 0.0, 0.0]
    held[1, 0] = np.nan
    assert _is_crossed(held, points, valid, GRID) is is_crossed


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (0, "1 s"), (0.4, "1 s"), (1.6, "2 s"), (89.4, "89 s"), (90, "2 min"), (150, "2 min"), (151, "3 min"),
        (89.4 * 60, "89 min"), (90 * 60, "1 h 30 min"), (125 * 60, "2 h 5 min"), (120 * 60, "2 h 0 min"),
    ],
)  # fmt: skip
def test_a_duration_is_told_in_two_units_at_most(seconds, words):
    assert in_words(seconds) == words


@pytest.mark.parametrize(
    ("room", "kept"),
    [
        (99, "step 12, cost 3.5, last"), (23, "step 12, cost 3.5, last"), (22, "step 12, cost 3.5"),
        (17, "step 12, cost 3.5"),
        (16, "step 12"), (7, "step 12"), (6, "step"), (4, "step"), (3, "ste"), (0, ""), (-2, ""),
    ],
)  # fmt: skip
def test_a_narrow_line_keeps_whole_clauses_then_words(room, kept):
    assert _whole_words("step 12, cost 3.5, last", room) == kept

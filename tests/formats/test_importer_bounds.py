"""Decisions of the importers about users' data, each on both sides of its bound, from the functions themselves."""

from __future__ import annotations

import numpy as np
import pytest

from formats.errors import DescriptionError
from formats.importers.decimal_separators import fewer_jump
from formats.importers.lost_lines import remove_joined_lines
from formats.importers.marker_lines import Rows
from formats.importers.marker_outliers import remove_jumps
from formats.importers.missing_values import warning_of_zeros
from formats.swatch import swatch

STEP = 1 / 128  # m from frame to frame: sums and differences of such steps are exact


def through_the_origin(frames, at, beside=0.0):
    """Where a marker's three zeros stand, (frames, 1), and its positions [m], (frames, 1, 3), along x through them."""
    path = np.zeros((frames, 1, 3))
    path[:, 0, 0], path[:, 0, 1] = STEP * (np.arange(frames) - at), beside
    zeros = np.arange(frames)[:, None] == at
    path[zeros] = np.nan
    return zeros, path


@pytest.mark.parametrize(
    ("frames", "beside", "is_told"), [(23, 0.0, True), (22, 0.0, False), (60, 0.0, True), (60, 1e-3, False)]
)
def test_zeros_a_longest_step_from_the_next_position_may_be_true(frames, beside, is_told):
    """23 frames have 20 steps without those to the zeros, the fewest that show the longest step."""
    zeros, path = through_the_origin(frames, 9, beside)
    told = (
        "0, 0, 0 counts as not seen, first in frame 9: a 1 time, with a position 7.8 mm from there in a neighbouring "
        "frame; if markers were there, move the origin and export again"
    )
    assert warning_of_zeros(zeros, path, [" a "], "frame {}".format) == told * is_told


@pytest.mark.parametrize(("at", "first"), [((40, 12), 12), ((12, 40), 12), ((59, 40), 40), ((0, 40), 0)])
def test_the_first_of_all_markers_zeros_is_named(at, first):
    both = [through_the_origin(60, k) for k in at]
    zeros, path = (np.concatenate(parts, axis=1) for parts in zip(*both, strict=True))
    near = "with a position 7.8 mm from there in a neighbouring frame"
    assert warning_of_zeros(zeros, path, ["a", "b"], "frame {}".format) == (
        f"0, 0, 0 counts as not seen, first in frame {first}: a 1 time, {near}, b 1 time, {near}; if markers were "
        "there, move the origin and export again"
    )


@pytest.mark.parametrize("frame", [2, 3, 60, 116, 117])
def test_from_the_third_position_to_the_last_but_two_a_jump_comes_back(frame):
    where = np.ones((120, 1, 3))
    where[frame, 0, 0] += 0.5
    told = remove_jumps(np.arange(120) / 100, where, ["a"], "frame {}".format)
    assert told == f"frame {frame}: a jumps 0.5 m away and back, so it counts as not seen there"
    assert np.flatnonzero(np.isnan(where[:, 0, 0])).tolist() == [frame]


@pytest.mark.parametrize(("jumping", "are_taken_out"), [(6, True), (7, False)])
def test_more_jumps_than_one_position_in_twenty_have_another_cause(jumping, are_taken_out):
    where = np.ones((120, 1, 3))
    where[10 : 10 + 12 * jumping : 12, 0, 0] += 0.5
    assert bool(remove_jumps(np.arange(120) / 100, where, ["a"], str)) == are_taken_out
    assert np.isnan(where).any() == are_taken_out


@pytest.mark.parametrize(("rows", "is_told"), [(10, True), (9, False)])
def test_a_lost_line_of_a_short_file_shows_by_a_delay_alone(rows, is_told):
    """One interval is half as long, so the longest step is no proof; behind the hole all lines are later."""
    time = 0.01 * np.arange(rows + 1)
    time[2:] -= 0.0052
    time = np.delete(time, 6)
    told = remove_joined_lines(time, time, np.zeros((rows, 1, 3)), "line {}".format)
    assert told == "0.01 s are missing behind line 5, so its markers count as not seen" * is_told


def test_only_times_that_increase_show_whether_separators_part_thousands():
    """Millimetres pass 1000, and are read as 987 and then as 1.012."""
    time, right = np.arange(40) / 100, (950 + 2.5 * np.arange(40))[:, None, None] / 1000 + np.zeros((40, 1, 3))
    parted = np.where(right < 1, right, right / 1000)
    assert fewer_jump(time, parted, right)
    assert not fewer_jump(time, right, parted)
    assert not fewer_jump(time, right, right)
    assert not fewer_jump(np.maximum(time, 0.2), parted, right)


@pytest.mark.parametrize(
    ("line", "cells"),
    [
        ('"a,b",c', ["a,b", "c"]), (' "a,b" ,c', ["a,b", "c"]), ('c, "a,b,d"', ["c", "a,b,d"]),
        ('"a""b,c",d', ['a"b,c', "d"]), ('"a,b","c,d"', ["a,b", "c,d"]), ('a,"b"', ["a", "b"]),
        ('"a,b', ['"a', "b"]), ('"a,b"c,d', ['"a', 'b"c', "d"]), ('a",b"', ['a"', 'b"']), ('"",a', ["", "a"]),
        ('",",a', [",", "a"]),
    ],
)  # fmt: skip
def test_quoted_cells_end_at_their_own_marks(tmp_path, line, cells):
    assert Rows([line], [1], ",", tmp_path)[0] == cells


@pytest.mark.parametrize(
    ("mass", "side", "where"),
    [
        (0.0, 0.5, "--mass"),
        (-1.0, 0.01, "--mass"),
        (0.1, 0.0099, "--side"),
        (0.1, 10.0, "--side"),
        (0.0, 10.0, "--side"),
    ],
)
def test_a_swatch_that_is_not_one_names_the_option_to_mend(mass, side, where):
    with pytest.raises(DescriptionError) as refused:
        swatch(mass, side=side, markers=4)
    assert str(refused.value).startswith(f"{where}: no swatch has a side of {side:g} m and a mass of {mass:g} kg")


@pytest.mark.parametrize(("markers", "advice"), [(3, "give 4 or more"), (45, "give 44 at most")])
def test_a_swatch_has_as_many_markers_as_a_take_holds(markers, advice):
    with pytest.raises(DescriptionError) as refused:
        swatch(0.1, markers=markers)
    assert (refused.value.where, refused.value.advice) == ("--markers", advice)


def test_a_swatch_has_its_markers_from_edge_to_edge_row_by_row():
    garment = swatch(0.1, side=0.3, markers=4, name="s")
    assert (garment.name, garment.kind, garment.mass_kg, garment.held) == ("s", "swatch", 0.1, "corners")
    assert garment.outline_m == ((-0.15, 0.0), (0.15, 0.0), (0.15, -0.3), (-0.15, -0.3))
    across, down = (-0.15, -0.05, 0.05, 0.15), (0.0, -0.1, -0.2, -0.3)
    assert [(point.name, point.at_m) for point in garment.points] == [
        (f"row{row}_column{column}", (x, y)) for row, y in enumerate(down, 1) for column, x in enumerate(across, 1)
    ]

"""The importers' rules about times, outliers, separators and codes, against small computations of their own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from formats.importers.decimal_separators import DecimalSeparators, are_too_far
from formats.importers.lost_lines import _are_steps_of_two, _delay, _goes_on, _resolution, remove_joined_lines
from formats.importers.marker_lines import Rows
from formats.importers.marker_outliers import _beyond_line, _is_beyond, remove_jumps
from formats.importers.missing_values import are_incomplete, remove_missing_value_codes
from formats.importers.thousands import find_thousands


def test_a_delay_is_the_difference_of_up_to_ten_lines_on_each_side():
    """Of fewer than three lines on a side it is 0."""
    late = np.random.default_rng(1).integers(0, 99, 26).astype(float)
    for at in range(25):
        before = [late[k] for k in range(26) if -10 < k - at <= 0]
        after = [late[k] for k in range(26) if 0 < k - at <= 10]
        is_shown = len(before) > 2 and len(after) > 2
        expected = sum(after) / len(after) - sum(before) / len(before) if is_shown else 0.0
        assert _delay(late, at) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("step", "off", "coarsest"),
    [
        (1, 0, 1.0), (0.1, 0, 0.1), (0.25, 0, 0.01), (0.005, 0, 0.001), (0.0125, 0, 1e-4), (1e-5, 0, 1e-5),
        (1e-6, 0, 0.0), (1 / 300, 0, 0.0), (0.25, 0.0009 * 0.25, 0.01), (0.25, 0.0011 * 0.25, 1e-4),
    ],
)  # fmt: skip
def test_the_coarsest_power_of_ten_of_which_times_are_multiples(step, off, coarsest):
    time = step * np.arange(40)
    time[7] += off
    assert _resolution(time, step) == pytest.approx(coarsest)


def steps_of_two(time):
    steps = np.diff(time)
    return np.flatnonzero(_are_steps_of_two(time, steps, float(np.median(steps)))).tolist()


@pytest.mark.parametrize(
    ("gaps", "interval", "found"),
    [
        ({20: 8}, 4, [20]), ({20: 10}, 4, [20]), ({20: 10.5}, 4, []), ({20: 6}, 4, []), ({20: 7}, 4, [20]),
        ({20: 6}, 3, []), ({20: 80}, 40, [20]), ({20: 8, 40: 8, 60: 8}, 4, [20, 40, 60]),
        ({20: 8, 40: 8, 60: 8, 70: 8}, 4, []), ({20: 8, 21: 0.5}, 4, []), ({1: 8}, 4, []), ({2: 8}, 4, [2]),
        ({2: 10, 20: 8}, 4, [2, 20]), ({96: 8}, 4, [96]), ({97: 8}, 4, []),
    ],
)  # fmt: skip
def test_one_frame_is_missing_where_a_step_is_nearly_two_intervals_and_lasts(gaps, interval, found):
    """Whole seconds resolve a quarter of 4 s and more, 10.5 s are a pause, and 6 s too little a delay."""
    steps = np.full(99, float(interval))
    for at, step in gaps.items():
        steps[at] = step
    for start in (0.0, 1e6):
        assert steps_of_two(np.concatenate([[start], start + np.cumsum(steps)])) == found


def test_uneven_steps_elsewhere_hide_a_missing_frame_only_near_it():
    """Among intervals that spread by a quarter and add up, a delay of one interval is nothing."""
    for spread, found in ((slice(0, 99), []), (slice(0, 0), [20]), (slice(75, 99), [20])):
        steps = np.full(99, 4.0)
        steps[20] = 8.0
        steps[spread] += np.where(np.arange(99) // 5 % 2 == 0, 1.9, -1.9)[spread]
        steps[20] = 8.0
        assert steps_of_two(np.concatenate([[0], np.cumsum(steps)]).round(1)) == found


@pytest.mark.parametrize("at", [8, 30, 51])
@pytest.mark.parametrize(("off", "goes_on"), [(0.0, True), (0.004, True), (0.0201, False), (0.3, False)])
def test_a_line_goes_on_within_twice_the_largest_deviation_around_it(at, off, goes_on):
    """A marker that zigzags by 2.5 mm is 10 mm off the lines through the two positions before."""
    time = np.arange(60.0)
    positions = np.zeros((60, 1, 3))
    positions[:, 0, 0] = 0.0025 * (-1.0) ** np.arange(60) + 0.1 * np.arange(60)
    positions[at, 0, 0] += off if at % 2 == 0 else -off
    assert _goes_on(time, positions, at, [at]) is goes_on


@pytest.mark.parametrize(("holes", "told"), [([20, 40, 60], 3), ([20, 40, 60, 80], 0)])
def test_up_to_three_holes_are_named_by_their_numbers(holes, told):
    numbers = np.delete(np.arange(1.0, 101.0), holes)
    said = remove_joined_lines(numbers, numbers / 100, np.full((len(numbers), 1, 3), np.nan), "line {}".format)
    expected = [f"frame {k + 1} is missing behind line {k - 1 - n}" for n, k in enumerate(holes)]
    assert said == "; ".join(expected[:told])


@pytest.mark.parametrize(
    ("reach", "bound"), [(0.01, 0.05 + 0.75 + 0.2), (0.02, 0.05 + 1.5 + 0.2), (0.06, 0.05 + 4.5 + 0.6)]
)
def test_the_bound_of_a_jump_is_that_of_its_module(reach, bound):
    """Noise of 10 mm and a median step of 0.1 s: r / 2 h^2 is 0.5, which counts as 1, then 1 and 3."""
    far = bound + np.tile([-1e-6, 1e-6, 1e-6, 9.0], (3, 1))
    far[1, 2] = 0.0
    assert _is_beyond(far, np.full((3, 4), reach), 0.01, 0.1).tolist() == [False, True, False, True]


@pytest.mark.parametrize(
    ("times", "bound"),
    [
        ((0.2, 0.1, 0.0), 0.05 + 75 * 0.02 + 0.3), ((0.0, 0.1, 0.2), 0.05 + 75 * 0.02 + 0.3),
        ((0.3, 0.1, 0.0), 0.05 + 75 * 0.06 + 0.9), ((0.2, 0.1, -0.2), 0.05 + 75 * 0.04 + 0.6),
        ((0.15, 0.1, 0.0), 0.05 + 75 * 0.0075 + 0.3),
    ],
)  # fmt: skip
def test_an_end_is_compared_with_the_line_through_the_next_two(times, bound):
    """They move by 1 m/s along x; the end is off along y."""
    for off, is_beyond in ((bound - 1e-6, False), (bound + 1e-6, True)):
        positions = np.array([[time, off * (k == 0), 7.0] for k, time in enumerate(times)])
        found = _beyond_line(np.array(times), positions, np.arange(3), 0.3, 0.1)
        assert found == pytest.approx(off * is_beyond)


@pytest.mark.parametrize(("off", "shown"), [(9.94, "9.9"), (9.96, "10"), (10.4, "10"), (0.5, "0.5"), (123.4, "123")])
def test_a_jump_is_shown_with_two_digits_or_in_metres(off, shown):
    where = np.ones((60, 1, 3))
    where[30, 0, 0] += off
    assert f" jumps {shown} m away " in remove_jumps(np.arange(60) / 100, where, ["a"], str)


def test_some_coordinates_are_missing_only_where_another_is_no_zero():
    """A 1 counts as any other number."""
    for place, is_lacking in (
        ((np.nan, 1.0, 1.0), True), ((np.nan, np.nan, 1.0), True), ((np.nan, 0.0, 0.0), False),
        ((np.nan, np.nan, np.nan), False), ((1.0, 1.0, 1.0), False), ((0.0, 0.0, 0.0), False),
        ((3.0, 0.0, np.nan), True), ((3.0, 3.0, 1.0), False),
    ):  # fmt: skip
        assert are_incomplete(np.array([[place]])).tolist() == [[is_lacking]]


@pytest.mark.parametrize(
    ("code", "places", "is_code"),
    [
        (-1.0, (10, 20), True), (-1.0, (10,), False), (-1.5, (10, 20), False), (-1.0, (39, 0), True),
        (0.005, (10, 20), False), (999.0, (10,), True), (998.0, (10,), False), (1e6, (10,), True), (5e5, (10,), False),
    ],
)  # fmt: skip
def test_codes_are_whole_and_repeat_far_from_the_path_or_lie_far_out(code, places, is_code):
    """Of a marker that swings about (0.3, 0.5, 0.2) m; file in metres."""
    path = np.array([0.3, 0.5, 0.2]) + 0.02 * np.sin(np.arange(40) / 5)[:, None, None] * [1.0, 0.5, 0.2]
    path[list(places), 0] = code
    told = remove_missing_value_codes(path, np.ones(1), "line {}".format)
    times = "1 time" if len(places) == 1 else f"{len(places)} times"
    says = f"{code:.7g} is all three coordinates of a marker {times}, first in line {min(places)}, and is read as a "
    assert told == (says + "missing-value code") * is_code
    assert np.flatnonzero(np.isnan(path[:, 0, 0])).tolist() == sorted(places) * is_code


def test_of_several_repeated_numbers_those_off_the_path_are_codes():
    """The marker passes (1, 1, 1) m, which it has in two frames."""
    path = 1 + np.arange(-20, 20)[:, None, None] * [0.01, 0.02, 0.01]
    path[21, 0] = 1.0
    path[[3, 5], 0], path[[30, 35], 0] = -1.0, -2.0
    told = remove_missing_value_codes(path, np.ones(1), "line {}".format)
    assert told.split("; ") == [
        f"{code} is all three coordinates of a marker 2 times, first in line {line}, and is read as a missing-value "
        "code"
        for code, line in ((-1, 3), (-2, 30))
    ]
    assert np.flatnonzero(np.isnan(path[:, 0, 0])).tolist() == [3, 5, 30, 35]


def test_a_number_beside_no_other_is_no_code_that_lies_far_out():
    path = np.full((40, 1, 3), 999.0)
    assert remove_missing_value_codes(path, np.ones(1), str) == ""
    assert not np.isnan(path).any()


@pytest.mark.parametrize(("frames", "is_told"), [(22, True), (21, False)])
def test_twenty_steps_of_a_marker_show_that_a_number_lies_off_its_path(frames, is_told):
    """Codes at both ends leave two positions fewer, and one step fewer than positions."""
    path = np.tile([0.3, 0.5, 0.2], (frames + 1, 1, 1))
    path[[0, -1], 0] = -1.0
    assert bool(remove_missing_value_codes(path, np.ones(1), str)) is is_told


def test_positions_of_a_kilometre_are_too_far_and_those_before_it_are_not():
    assert are_too_far(np.array([[[0.0, np.nan, -1000.0]]]))
    assert not are_too_far(np.array([[[999.9, np.nan, -999.9]]]))


def looked(lines, begin=1, delimiter=";"):
    """The separators of lines whose cells a delimiter parts."""
    found = DecimalSeparators(begin)
    for line in lines:
        found.look(line.split(delimiter), line)
    return found


@pytest.mark.parametrize(
    ("lines", "separator", "is_usual"),
    [
        (["1;1.234"], ";", True), (["1;1.234"], "\t", False), (["1;1,234"], "\t", True), (["0.5;1.234"], ";", False),
        (["0,5;1,234"], "\t", False), (["1.000;1.234"], ";", True),
        ([f"1;1.234;{k}" for k in (5, 6, 7)], "\t", True), ([f"1;1.234;{k}" for k in (5, 6, 6)], "\t", False),
        ([f"0.5;1.234;{k}" for k in (5, 6, 7)], "\t", True),
    ],
)  # fmt: skip
def test_thousands_are_usual_with_commas_semicolons_or_whole_numbers(lines, separator, is_usual):
    assert looked(lines).are_usual(separator) is is_usual


@pytest.mark.parametrize(
    ("lines", "point", "comma", "of_thousands"),
    [
        (["1;2;3"], "", "", ""), (["1; 1.234 ;7"], "1.234", "", "1.234"),
        (["1;1,234", "2;2,345"], "", "1,234", "1,234"),
        (["1;a.b;1.25"], "1.25", "", ""), (["1;1.234", "2;12345"], "1.234", "", ""),
        (["1;999.123"], "999.123", "", "999.123"),
        (["1;0.123"], "0.123", "", ""), (["1;1.234", "2;1.2"], "1.234", "", ""),
        (["1.5;2"], "1.5", "", ""),
    ],
)  # fmt: skip
def test_the_first_number_with_each_sign_is_kept(lines, point, comma, of_thousands):
    found = looked(lines)
    assert (found.point, found.comma, found.of_thousands) == (point, comma, of_thousands)


READ = " were read as thousands separators, as in"


@pytest.mark.parametrize(
    ("lines", "delimiter", "found"),
    [
        (["1\t1,234.5"] * 3, "\t", (".", f"commas{READ} 1,234.5")),
        (["1\t1,234.5"] * 2, "\t", None),
        (["1\t1.234,5"] * 3, "\t", (",", "points were read as thousands separators, as in 1.234,5")),
        (["1\t0\t1 234.5"] * 3, "\t", (".", f"spaces{READ} 1 234.5")),
        (["1,1 234.5"] * 3, ",", (".", f"spaces{READ} 1 234.5")),
        (['1,"1,234.5"'] * 3, ",", (".", f"commas{READ} 1,234.5")),
        (["1\t0\t1'234.5\tNaN"] * 3, "\t", (".", "apostrophes were read as thousands separators, as in 1'234.5")),
        (["1\t0\t1'234.5\tx"] * 3, "\t", None),
        (["1\t0\t1,234.5\t12345.6"] * 3, "\t", None),
        (["1\t0\t1,234.5\t1234.5"] * 3, "\t", None),
        (["1\t0\t11,234.5\t1234.5"] * 3, "\t", (".", f"commas{READ} 11,234.5")),
        (["1\t0\t1,234.5\t1'234.5"] * 3, "\t", None),
        (["1\t0\t1,234.5"] * 3 + ["1\t1,234.5"] * 2, "\t", (".", f"commas{READ} 1,234.5")),
        (["1\t0\t1,234.5"] * 10 + ["1\t0\t1.234,5"], "\t", (".", f"commas{READ} 1,234.5")),
        (["1\t0\t1,234.5"] * 9 + ["1\t0\t1.234,5"], "\t", None),
        (["1\t0\t1,234.5"] * 3 + ["1\t0\t123.5"] * 8 + ["1\t0\t1.234,5"], "\t", None),
        (["1\t0\t1,234.5"] * 3 + ["1\t0\t1.5\t2.5"] * 2, "\t", (".", f"commas{READ} 1,234.5")),
    ],
)  # fmt: skip
def test_one_reading_of_all_lines_shows_thousands_separators(lines, delimiter, found):
    assert find_thousands(Rows(lines, list(range(1, len(lines) + 1)), delimiter, Path("a.csv"))) == found

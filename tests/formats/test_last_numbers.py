"""The last number of a file is complete, cut, short or doubtful, as the numbers around it show."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from formats.importers.broken_numbers import is_near
from formats.importers.cut_numbers import Ending, ending_of
from formats.importers.decimal_separators import may_be_motion
from formats.importers.marker_lines import Rows
from formats.importers.number_cells import form_of
from formats.importers.number_formats import _usual_line, writing_of, written_as
from tests.formats.test_cut_numbers import own
from tests.formats.test_marker_tables import read

FIXED = ["1.125,20.125,300.125"]  # three numbers of one form
MANY = [f"{k}.125,{k}.250,{k}.375" for k in range(1, 20)]  # 57 of one form, 19 with a zero
PLANE = [f"{k}.125,{k}.250,0" for k in range(1, 40)]  # one z


def ending(lines: list[str], last: str, *, has_end: bool, columns: int = 3, width: int = 3) -> Ending:
    """Return the state of the last number below lines with these positions and cells."""
    texts = [*lines, last]
    rows = Rows(texts, range(len(texts)), ",", Path("a"), is_cut=not has_end)
    return ending_of(rows, min(len(rows[-1]), columns) - 1, width, writing_of(rows, range(columns)))


@pytest.mark.parametrize(
    ("lines", "last", "known"),
    [
        (FIXED, "1.125,20.125,300.125", Ending.WHOLE),
        (FIXED, "1.125,20.125,0.125", Ending.DOUBTFUL),  # of 0.1257, as `%.4g` writes it
        ([*FIXED, "1.125,20.125,0.250"], "1.125,20.125,0.125", Ending.WHOLE),
        (["1.125,2.125,3.125"], "1.125,2.125,10.125", Ending.WHOLE),
        (["1.125e+01,2.125e+01,3.125e+01"], "1.125e+01,2.125e+01,1.125e-03", Ending.WHOLE),
        (FIXED, "1.125,20.125,300.12", Ending.DOUBTFUL),
        (MANY, "1.125,20.125,300.12", Ending.CUT),
        (MANY, "1.125,20.125,", Ending.CUT),
        (MANY, "1.125,20.125,-", Ending.CUT),
        (MANY, "1.125,20.125,nan", Ending.WHOLE),
        (MANY, "0,0,0", Ending.WHOLE),  # a gap, however its last cell goes on
        (MANY, "-9999,-9999,-9999", Ending.DOUBTFUL),
        (["1,2,3"], "1,2,3", Ending.DOUBTFUL),
        (["1.5,2.25,3"], "1.5,2.25,3.125", Ending.WHOLE),  # no number has more digits
        (["1.5,2.25,3"], "1.5,2.25,3.1", Ending.DOUBTFUL),
        (["1.5,2.25,3.25e-05"], "1.5,2.25,3.25", Ending.DOUBTFUL),
        ([], "1.125,20.125,300.125", Ending.DOUBTFUL),
        (PLANE, "1.125,20.125,0", Ending.DOUBTFUL),
        (MANY, "1.125,20.125,0", Ending.CUT),
    ],
)
def test_a_number_that_nothing_follows_is_whole_where_one_form_proves_it(lines, last, known):
    assert ending(lines, last, has_end=False) is known


@pytest.mark.parametrize(
    ("lines", "last", "known"),
    [
        (FIXED, "1.125,20.125,300.125", Ending.WHOLE),
        (FIXED, "1.125,20.125,300.12", Ending.OPEN),
        (["1.5,1.5,1.5"], "1.5,2.5,3", Ending.OPEN),
        (MANY, "1.125,20.125,300.12", Ending.CUT),
        (MANY, "-9999,-9999,-9999", Ending.WHOLE),
        (PLANE, "1.125,20.125,0", Ending.OPEN),
        ([*MANY, "1.125,20.125,3"], "1.125,20.125,-3", Ending.WHOLE),  # its column repeats it
        ([*MANY, "0,0,3"], "1.125,20.125,3", Ending.CUT),
        (MANY, "1.125,20.125,0", Ending.CUT),
        (["1.5,2.25,3.125"] * 3, "1.5,2.25,3", Ending.OPEN),
        (["1.5,2.25,3.25"] * 3, "1.5,2.25,3", Ending.OPEN),
        (["1.5,2.25,3.25"] * 3, "1.5,2.25,3.5", Ending.OPEN),
        (["1.5,2.25,3.25"] * 3, "1.5,2.25,3.75", Ending.WHOLE),
        (["1,2,3"], "1,2,4", Ending.OPEN),
        (["1.,2.,3."], "1.,2.,4.", Ending.OPEN),
        (["1.5,2,3"], "1.5,2,4.", Ending.CUT),
        (["1.5,2e+01,3"], "1.5,2,4e+0", Ending.CUT),
        (["1.5,2e-7,3"], "1.5,2,4e-7", Ending.WHOLE),
    ],
)
def test_a_number_before_the_end_of_its_line_is_cut_where_its_form_shows_it(lines, last, known):
    assert ending(lines, last, has_end=True) is known


def test_a_separator_proves_a_number_and_its_lack_where_others_have_one_does_not():
    assert ending(["1,2,3,"], "1,2,3,", has_end=False) is Ending.WHOLE
    assert ending(["1,2,12,"], "1,2,1", has_end=True) is Ending.DOUBTFUL
    assert ending(["1.5,2.25,12,9"], "1.5,2.25,1", has_end=True, width=4) is Ending.OPEN


def test_a_marker_that_was_not_seen_leaves_no_doubt_about_a_cut(tmp_path):
    found = read(tmp_path, own(3).rpartition("0.55555")[0] + "nan,-1", "m", "own.csv")
    assert found.warning == "line 4: b lacks a coordinate at 0.02 s, so it counts as not seen there"
    assert np.isnan(found.positions[-1, 1]).all()


@pytest.mark.parametrize(
    ("off", "leads"), [([0.0019], True), ([0.0021], False), ([0.004, 0, 0, 0, 0], False), ([0.5] + [0] * 8, True)]
)
@pytest.mark.parametrize("bend", [0.0, 0.01])
def test_a_path_predicts_its_last_position_where_it_led_to_the_four_before(off, leads, bend):
    path = 0.3 + 0.02 * np.arange(20) + bend * np.arange(20.0) ** 2
    path[-len(off) :] += off
    assert is_near(np.arange(20) / 30, path) == leads
    assert not is_near(np.arange(5) / 30, path[:5])


def test_even_motion_at_uneven_times_is_motion():
    time = np.cumsum(np.where(np.arange(40) % 2, 0.01, 0.05))
    assert may_be_motion(time, 5.0 * time[:, None, None] + np.zeros((40, 1, 3)))


@pytest.mark.parametrize(("form", "line"), [("1.250", "20.125,any,-3.5"), ("1.250e-01", "20.125e+00,any,")])
def test_a_usual_line_has_the_decimals_and_the_digits_of_the_power_in_its_columns(form, line):
    """The last cell is empty or has other decimals."""
    usual = _usual_line(",", 3, [0], form_of(form))
    assert usual.match(line)
    assert not usual.match(line.replace("20.125", "20.12"))
    assert not _usual_line(",", 3, [0, 1], form_of(form)).match(line.replace("any", "1.1"))


def test_sights_of_one_frame_are_no_motion_that_a_jump_could_be_compared_with():
    """One path of ten frames jumps; twenty markers that are seen in every second frame show no motion."""
    time = np.arange(100) / 100
    positions = np.full((100, 21, 3), np.nan)
    positions[:10, 0] = np.where(np.arange(10) == 5, 1.0, 0.0)[:, None]
    positions[::2, 1:] = 0.0
    assert not may_be_motion(time, positions)
    positions[:, 1:] = 0.0
    assert may_be_motion(time, positions)


@pytest.mark.parametrize(("lines", "columns"), [(9, set()), (10, {0}), (17, {0}), (18, {0})])
def test_a_column_has_a_form_from_two_numbers_of_the_sample_on(lines, columns):
    """Every eighth line but the last is looked at: of 9 lines the first, of 10 and 17 lines two, of 18 three."""
    rows = Rows(["0.125,0.5"] * lines, range(lines), ",", Path("a"))
    assert written_as(rows, [0, 1], form_of("1.250")) == columns

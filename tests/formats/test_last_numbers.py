"""A last number is whole, cut, short or in doubt, by the numbers around it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from formats.importers.cut_numbers import Ending, ending_of
from formats.importers.decimal_signs import may_be_motion
from formats.importers.marker_lines import Rows
from tests.formats.test_cut_numbers import own
from tests.formats.test_marker_tables import read

FIXED = ["1.125,20.125,300.125"]  # three numbers of one form and of several magnitudes
MANY = [f"{k}.125,{k}.250,{k}.375" for k in range(1, 20)]  # 57 of one form
PLANE = [f"{k}.125,{k}.250,0" for k in range(1, 40)]  # 64 of one form in 32 lines, and one z


def ending(lines: list[str], last: str, *, has_end: bool, columns: int = 3, width: int = 3) -> Ending:
    """What is known of the last number below some lines of so many places and cells."""
    texts = [*lines, last]
    rows = Rows(texts, range(len(texts)), ",", Path("a"), is_cut=not has_end)
    return ending_of(rows, range(columns), min(len(rows[-1]), columns) - 1, width)


@pytest.mark.parametrize(
    ("lines", "last", "known"),
    [
        (FIXED, "1.125,20.125,300.125", Ending.WHOLE),
        (FIXED, "1.125,20.125,0.125", Ending.WHOLE),  # `%g` would have written other numbers with other digits
        (["1.125,2.125,3.125"], "1.125,2.125,0.125", Ending.DOUBTFUL),  # of 0.1257, as `%.4g` writes it
        (["1.125,2.125,3.125"], "1.125,2.125,10.125", Ending.WHOLE),
        (["1.125e+01,2.125e+01,3.125e+01"], "1.125e+01,2.125e+01,1.125e-03", Ending.WHOLE),
        (["1.125,20.125,1.125"], "1.125,20.125,300.125", Ending.DOUBTFUL),  # two numbers are too few
        (FIXED, "1.125,20.125,300.12", Ending.DOUBTFUL),
        (MANY, "1.125,20.125,300.12", Ending.CUT),
        (MANY, "1.125,20.125,", Ending.CUT),
        (MANY, "1.125,20.125,-", Ending.CUT),
        (MANY, "1.125,20.125,nan", Ending.WHOLE),
        (MANY, "0,0,0", Ending.WHOLE),  # a gap, however its last cell goes on
        (MANY, "-9999,-9999,-9999", Ending.DOUBTFUL),
        (["1,2,3"], "1,2,3", Ending.DOUBTFUL),
        (["1.5,2.25,3"], "1.5,2.25,3.125", Ending.DOUBTFUL),
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
        (FIXED, "1.125,20.125,300.12", Ending.DOUBTFUL),
        (["1.5,1.5,1.5"], "1.5,2.5,3", Ending.WHOLE),  # two numbers tell nothing about zeros
        (MANY, "1.125,20.125,300.12", Ending.CUT),
        (MANY, "-9999,-9999,-9999", Ending.WHOLE),
        (PLANE, "1.125,20.125,0", Ending.WHOLE),
        ([*PLANE, "0,0,0.0"], "1.125,20.125,0", Ending.WHOLE),
        (PLANE, "1.125,20.125,-0", Ending.WHOLE),
        (PLANE, "1.125,20.125,00", Ending.CUT),
        (MANY, "1.125,20.125,0", Ending.CUT),
        (["1.5,2.25,3.125"] * 3, "1.5,2.25,3", Ending.CUT),  # three digits less than its column
        (["1.5,2.25,3.25"] * 3, "1.5,2.25,3", Ending.SHORT),
        (["1.5,2.25,3.25"] * 3, "1.5,2.25,3.5", Ending.SHORT),
        (["1.5,2.25,3.25"] * 3, "1.5,2.25,3.75", Ending.WHOLE),
        (["1,2,3"], "1,2,4", Ending.SHORT),
        (["1.,2.,3."], "1.,2.,4.", Ending.SHORT),
        (["1.5,2,3"], "1.5,2,4.", Ending.CUT),
        (["1.5,2e+01,3"], "1.5,2,4e+0", Ending.CUT),
        (["1.5,2e-7,3"], "1.5,2,4e-7", Ending.SHORT),
    ],
)
def test_a_number_before_the_end_of_its_line_is_cut_where_its_form_shows_it(lines, last, known):
    assert ending(lines, last, has_end=True) is known


def test_a_separator_proves_a_number_and_its_lack_where_others_have_one_does_not():
    assert ending(["1,2,3,"], "1,2,3,", has_end=False) is Ending.WHOLE
    assert ending(["1,2,12,"], "1,2,1", has_end=True) is Ending.DOUBTFUL
    assert ending(["1.5,2.25,12,9"], "1.5,2.25,1", has_end=True, width=4) is Ending.SHORT
    assert ending([], "1.125,20.125,3.125,4.125,5.125,6.125", has_end=False, columns=6, width=6) is Ending.WHOLE


def test_a_marker_that_was_not_seen_leaves_no_doubt_about_a_cut(tmp_path):
    found = read(tmp_path, own(3).rpartition("0.55555")[0] + "nan,-1", "m", "own.csv")
    assert found.doubt == "line 4: b lacks a coordinate at 0.02 s, so it counts as not seen there"
    assert np.isnan(found.positions[-1, 1]).all()


def test_even_motion_at_uneven_times_is_motion():
    time = np.cumsum(np.where(np.arange(40) % 2, 0.01, 0.05))
    assert may_be_motion(time, 5.0 * time[:, None, None] + np.zeros((40, 1, 3)))

"""Rows of cells as CSV that a spreadsheet shows as it stands, and as columns."""

from __future__ import annotations

import pytest

from formats.rows import aligned, csv_text, named_in_cell, spreadsheet_cell


@pytest.mark.parametrize(
    ("cell", "written"),
    [("=1+1", "'=1+1"), ("@SUM(A1)", "'@SUM(A1)"), ("-swing", "'-swing"), ("-0.5", "-0.5"), ("+1e3", "+1e3"),
     (-0.5, -0.5), ("a=1", "a=1"), ("", ""), ("\uff1d1+1", "'\uff1d1+1"), ("\uff0b1", "'\uff0b1"),
     ("\uff0d\uff11", "'\uff0d\uff11"), ("\uff20SUM(A1)", "'\uff20SUM(A1)"), ("x;=1+1", "x;'=1+1"),
     ("-a;-5;\uff1db;c; =d;'=e", "'-a;'-5;'\uff1db;c; =d;''=e"),
     ("'=1", "''=1"), ("-1_0", "'-1_0"), ("+\uff11", "'+\uff11"),
     ("-inf", "'-inf")],
)  # fmt: skip
def test_a_spreadsheet_runs_no_text(cell, written):
    assert spreadsheet_cell(cell) == written


@pytest.mark.parametrize(
    "name", ["=1+1", "'=1+1", "''-a", "x;'=1", "x;=1+1", "\uff1dx;-5", "'x", "a;'b", "-0.5", "x", "'"]
)
def test_a_name_comes_back_from_its_cell(name):
    assert named_in_cell(spreadsheet_cell(name)) == name


def test_numbers_keep_every_digit_nothing_is_an_empty_cell_and_text_is_quoted():
    """0.1 + 0.2 has seventeen digits; the comma in a text parts no cells, and the formula is none."""
    rows = [(0.1 + 0.2, None, "a, b"), (-1e-9, True, "=1+1")]
    assert csv_text(("x", "low", "note"), rows) == ('x,low,note\n0.30000000000000004,,"a, b"\n-1e-09,True,\'=1+1\n')


def test_columns_stand_two_spaces_apart_and_numbers_to_the_right():
    assert aligned([("name", "mm"), ("a", "12.5")], right=(1,)) == ["name    mm", "a     12.5"]


def test_columns_are_as_wide_as_their_widest_cell_and_no_line_ends_in_blanks():
    rows = [("a", "bb", "c"), ("dddd", "e", "")]
    assert aligned(rows) == ["a     bb  c", "dddd  e"]
    assert aligned(rows, right=(0, 2)) == ["   a  bb  c", "dddd  e"]
    assert aligned([]) == []


def test_a_name_with_an_end_of_line_or_a_code_is_one_cell_of_one_line():
    name = "a\n=1+1\t\x1b[31m\u202e"
    assert csv_text(("take",), [(name,)]) == "take\na\\n=1+1\\t\\x1b[31m\\u202e\n"
    assert spreadsheet_cell("=1\n2") == "'=1\\n2"
    assert aligned([(name, "1")]) == ["a\\n=1+1\\t\\x1b[31m\\u202e  1"]

"""Whole lines are split and read at once; they give what the slower way gives, cell by cell."""

import csv
import random

import pytest

from formats.importers.marker_lines import Rows, _joined, _plainly_quoted, unquoted
from formats.importers.number_cells import sign_of_line, with_point, with_points

PIECES = ('"', '"', ",", ";", "\t", "1", ".5", " ", "a", "\n", "\r", "")
NUMBERS = ("1", "0", "23", "234", ".", ",", "e3", "E+03", "e-1", "-", " ", "'", "1,234", "1.234", "1'234", "")


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_a_line_whose_marks_surround_cells_is_split_as_cell_by_cell(separator):
    rng, count = random.Random(1), 0
    for _ in range(40_000):
        line = "".join(rng.choices((separator, *PIECES), k=rng.randint(1, 12)))
        if '"' in line and _plainly_quoted(separator).fullmatch(line):
            cells = line.split(separator)
            slowly = [unquoted(cell) for cell in (cells if separator == "\t" else _joined(cells, separator))]
            assert next(csv.reader((line,), delimiter=separator)) == slowly, line
            count += 1
    assert count > 400


def test_a_quoted_cell_may_hold_the_delimiter_except_a_tab(tmp_path):
    line = '"1,585.620",7,"a b", "c'
    assert Rows([line], [1], ",", tmp_path)[0] == ["1,585.620", "7", "a b", ' "c']
    assert Rows(['"1,5",,"",2'], [1], ",", tmp_path)[0] == ["1,5", "", "", "2"]
    assert Rows(['"1\t5"\t"2"'], [1], "\t", tmp_path)[0] == ['"1', '5"', "2"]


@pytest.mark.parametrize(("decimal", "other"), [(".", ","), (",", ".")])
def test_numbers_with_powers_are_read_at_once_as_cell_by_cell(decimal, other):
    rng, count = random.Random(2), 0
    for _ in range(40_000):
        cells = ["".join(rng.choices(NUMBERS, k=rng.randint(1, 4))) for _ in range(rng.randint(1, 3))]
        if (at_once := with_points(cells, decimal)) is not None:
            assert at_once == [with_point(cell, decimal) for cell in cells], cells
            count += any("e" in cell.lower() for cell in cells)
    assert count > 400
    assert sign_of_line(f"1e3\t-2{decimal}5E+03\t1{other}234", "\t", decimal) == other
    assert sign_of_line(f"1{other}234e3", "\t", decimal) is None  # a power behind thousands is no number

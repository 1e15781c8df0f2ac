"""Which numbers with other digits than their column count as not seen, and how the warning names them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from formats.importers.marker_lines import Rows
from formats.importers.number_cells import Form
from formats.importers.number_formats import MOST_ODD, remove_odd_numbers

LINES = 200
COLUMNS = np.array([[1, 2, 3], [4, 5, 6]])


def told(cells, loose=()):
    """The warning, and the lost (line, marker); `cells`: texts by line and column; `loose`: columns of any format."""
    table = [[str(k), *(f"{1 + k / 7 + c:.3f}" for c in range(1, 7))] for k in range(LINES)]
    for column in loose:
        for k in range(LINES):
            table[k][column] = f"{1 + k / 7:.{1 + k % 3}f}"
    for (at, column), text in cells.items():
        table[at][column] = text
    rows = Rows(["\t".join(row) for row in table], range(1, LINES + 1), "\t", Path("a.trc"))
    positions = np.ones((LINES, 2, 3))
    words = remove_odd_numbers(rows, COLUMNS, positions, ["a", "b"], lambda at: f"line {at + 1}", Form(3, 0))
    return words, [tuple(one) for one in np.argwhere(np.isnan(positions).any(2)).tolist()]


def test_one_odd_number_is_named_by_its_text_without_spaces():
    words, lost = told({(7, 2): " 1.5 "})
    assert words == "line 8: '1.5' of a lacks the 3 digits behind a point of its column, so it counts as not seen there"
    assert lost == [(7, 0)]


def test_two_odd_numbers_are_named_with_their_lines():
    words, lost = told({(7, 2): "1.5", (9, 4): "2." + 50 * "1"})
    assert words == (
        "2 numbers have other than the 3 digits of their columns, so their markers count as not seen there: "
        f"'1.5' of a in line 8, '2.{38 * '1'}' of b in line 10"
    )
    assert lost == [(7, 0), (9, 1)]


@pytest.mark.parametrize(
    "cells",
    [{(LINES - 1, 2): "1.5"}, {(7, 2): "1.5", (50, 2): "1.5"}, {(7, 2): "0"}, {(7, 2): ""}, {(7, 0): "1.5"}, {}],
)
def test_the_last_line_repeated_texts_zeros_gaps_and_other_columns_are_not_odd(cells):
    assert told(cells) == ("", [])


@pytest.mark.parametrize("more", [0, 1])
def test_more_odd_numbers_in_a_column_than_faults_make_are_its_format(more):
    words, lost = told({(20 * k + 1, 2): f"{k + 1}.5" for k in range(MOST_ODD + more)})
    assert (len(lost), bool(words)) == ((0, False) if more else (MOST_ODD, True))


def test_a_column_of_no_fixed_format_has_no_odd_number():
    assert told({}, loose=(2,)) == ("", [])

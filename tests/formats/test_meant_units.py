"""Hints at the unit or the number that was meant, where one is probable."""

from __future__ import annotations

import pytest

from formats.meant_units import meant, number_meant

SECONDS = (("seconds", 1 / 86400),)


@pytest.mark.parametrize(
    ("value", "least", "most", "hint"),
    [
        (2_592_000.0, 0.0, 3660.0, "; were seconds meant?"),
        (5000.0, 0.0, 3660.0, ""),  # beyond the range, and less than twice: the unit is right
        (7320.0, 0.0, 3660.0, ""),
        (7321.0, 0.0, 3660.0, "; were seconds meant?"),
        (-1.0, 0.0, 3660.0, ""),
        (1e12, 0.0, 3660.0, ""),  # no unit fits
    ],
)
def test_a_unit_is_named_where_the_number_is_far_outside_its_range(value, least, most, hint):
    assert meant(value, least, most, SECONDS) == hint


@pytest.mark.parametrize(
    ("text", "number"),
    [("0,06", "0.06"), ("0,035", "0.035"), ("1,5", "1.5"), ("12,25", "12.25"), ("1,000", ""), ("-12,345", ""),
     ("1,2345", "1.2345"), ("a", "")],
)  # fmt: skip
def test_a_comma_before_three_digits_may_part_thousands_and_gets_no_hint(text, number):
    assert number_meant(text, "side_m") == number

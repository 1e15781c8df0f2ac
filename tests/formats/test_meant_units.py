"""Hints at the unit or the number that was meant, where one is probable."""

from __future__ import annotations

import pytest

from formats.meant_units import meant, number_meant

SECONDS = (("seconds", 1 / 86400),)


@pytest.mark.parametrize(("value", "hint"), [(100.0, True), (99.0, False), (3000.0, True), (3001.0, False)])
def test_a_number_whose_unit_puts_it_on_a_limit_of_the_range_is_asked_about(value, hint):
    """Sides of 0.1 to 3 m: 100 mm and 3000 mm are its ends."""
    assert meant(value, 0.1, 3.0, (("millimetres", 1e-3),)) == hint * "; were millimetres meant?"


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


@pytest.mark.parametrize(
    ("text", "field", "number"),
    [
        ("48 h", "keep_days", "2"), ("12 hours", "keep_days", "0.5"), ("90 s", "pause_minutes", "1.5"),
        ("2 days", "after_hours", "48"), ("30 min", "after_hours", "0.5"), ("2 ms", "late_us", "2000"),
        ("1.5 GB", "free_mb", "1500"), ("250 kB", "size_bytes", "250000"), ("35 g", "mass_kg", "0.035"),
    ],
)  # fmt: skip
def test_a_number_with_a_unit_is_converted_to_the_unit_at_the_end_of_its_fields_name(text, field, number):
    assert number_meant(text, field) == number

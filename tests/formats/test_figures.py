"""Numbers as people read them."""

from __future__ import annotations

import pytest

from formats.figures import beside, head_of, round_step, short, short_beside, span_of, with_unit, without_noise


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (1020.4, "1020"),
        (999.6, "1000"),
        (0.0, "0"),
        (1.08, "1.08"),
        (-2500, "-2500"),
        (3.2e7, "3.2e+07"),
        (2e-6, "2e-06"),
        (999_499.0, "999499"),
        (999_999.4, "999999"),
        (-999_999.6, "-1e+06"),
        (1e6, "1e+06"),
        (999.4, "999"),
        (-0.012345, "-0.0123"),
    ],
)
def test_a_number_below_a_million_has_no_exponent(value, text):
    assert short(value) == text


@pytest.mark.parametrize(
    ("value", "plain"),
    [
        (0.1 + 0.2, 0.3), (-(0.1 + 0.2), -0.3), (1.1 * 3, 3.3), (999.9999999999998, 1000.0), (0.0, 0.0),
        (1.0000000000000004e-06, 1e-6), (80.0, 80.0), (float("inf"), float("inf")),
        (4.465136808289297, 4.465136808289297), (7.067759933696431e-05, 7.067759933696431e-05),
        (0.3000000000001, 0.3000000000001), (1.2345678901e-7, 1.2345678901e-7),
    ],
)  # fmt: skip
def test_rounding_noise_is_left_out_and_every_other_digit_stays(value, plain):
    assert without_noise(value) == plain


def test_an_interval_has_the_digits_of_its_ends():
    assert span_of((33.2, 1000.4)) == "33.2 to 1000"


def test_a_pure_number_has_no_unit_and_a_rate_is_per_second():
    assert with_unit("1.08", "1") == "1.08"
    assert with_unit("1", "1/s") == "1 per s"
    assert with_unit("3", "N/m") == "3 N/m"
    assert head_of("drag", "1") == "drag"
    assert head_of("damping", "1/s") == "damping [1/s]"


@pytest.mark.parametrize(
    ("unit", "text", "head"),
    [
        ("", "2", "a"),
        ("1", "2", "a"),
        ("N/m", "2 N/m", "a [N/m]"),
        ("1/s", "2 per s", "a [1/s]"),
        ("11/s", "2 11/s", "a [11/s]"),
    ],
)
def test_units_stand_behind_numbers_and_in_the_brackets_of_heads(unit, text, head):
    assert (with_unit("2", unit), head_of("a", unit)) == (text, head)
    assert with_unit("", unit) == ""


def test_digits_of_an_interval_are_those_that_are_asked_for():
    assert span_of((1.23456, 12345.6), 2) == "1.2 to 12346"
    assert span_of((1.23456, 2.0), 4) == "1.235 to 2"
    assert short(0.123456, 5) == "0.12346"


@pytest.mark.parametrize(
    ("least", "step"),
    [
        (1.0, 1.0), (1.01, 2.0), (2.0, 2.0), (2.01, 2.5), (2.5, 2.5), (2.6, 5.0), (5.0, 5.0), (5.1, 10.0), (9.99, 10.0),
        (10.0, 10.0), (0.03, 0.05), (0.001, 0.001), (2.0000000001, 2.0), (2.00000001, 2.5), (340.0, 500.0),
    ],
)  # fmt: skip
def test_a_step_of_an_axis_is_the_least_round_one(least, step):
    assert round_step(least) == step


@pytest.mark.parametrize(
    ("value", "limit", "decimals", "of_limit", "shown"),
    [
        (24.8, 25.0, 0, None, ("24.8", "25")),  # a limit that is exact keeps its decimals
        (25.3, 25.0, 0, None, ("25.3", "25")),
        (30.0, 25.0, 0, None, ("30", "25")),
        (25.0, 25.0, 0, None, ("25", "25")),
        (24.999, 25.0, 0, None, ("24.999", "25")),
        (3.40, 3.44, 1, None, ("3.40", "3.44")),
        (1.72, 1.74, 2, 1, ("1.720", "1.740")),
        (2.0, 1.7123, 2, 1, ("2.00", "1.7")),
        (15.3, 15.4, 1, 0, ("15.30", "15.40")),
        (14.0, 15.2, 1, 0, ("14.0", "15")),
        (0.0502, 0.05, 2, None, ("0.0502", "0.05")),
        (1.0, 1.0 + 1e-12, 1, None, ("1.0", "1.0")),  # they differ by rounding alone
    ],
)
def test_a_number_beside_its_limit_reads_as_on_its_side_of_it(value, limit, decimals, of_limit, shown):
    assert beside(value, limit, decimals, of_limit) == shown
    assert beside(-0.001, 25.0) == ("0", "25")
    assert short_beside(0.3004, 0.3) == ("0.3004", "0.3")
    assert short_beside(0.45, 0.3) == ("0.45", "0.3")
    assert short_beside(0.3, 0.3) == ("0.3", "0.3")

"""Numbers as people read them."""

from __future__ import annotations

import pytest

from formats.figures import head_of, short, span_of, with_unit, without_noise


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

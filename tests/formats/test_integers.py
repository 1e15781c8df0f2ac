"""Tables of integers are restored from their bytes, and hostile bytes cost limited time and memory."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from formats.integers import ESCAPE, decode_tables, encode_tables
from tests.formats.tiny_reader import table

LARGEST_INTEGER = 2**31 - 1  # of a number in a table: its first value of a block has 32 bits


def one(values):
    return encode_tables(np.array(values, np.int64), np.array([len(values)]))[0]


def test_a_column_by_hand():
    """10, 12, 11: differences 2 and -1, zigzag 4 and 1; with k = 1 quotients 2 and 0, remainders 0 and 1.

    The code is 32 x 1 + 1; the first value, zigzag 20, stands in four planes; no exceptions; remainders 01 from the
    lowest bit; quotients 001 and 1, that is bits 2 and 3: 12.
    """
    assert one([[10], [12], [11]]) == bytes([33, 20, 0, 0, 0, 0, 0, 0, 0, 0b10, 0b1100])


def test_a_constant_column_costs_its_first_value_only():
    assert one([[-7]] * 50) == bytes([0, 13, 0, 0, 0, 0, 0, 0, 0])


def test_a_steady_motion_is_all_zeros_after_its_second_row():
    """Order 2: residuals 5, 0, 0, ...; 38 of them in quotients of one bit."""
    assert one([[5 * t] for t in range(40)])[0] >> 5 == 2
    assert len(one([[5 * t] for t in range(40)])) < 9 + 10


def test_order_three_by_hand():
    """Rows 0, 10, 20, 36: the fourth is expected at 20 + (20 - 0) / 2 = 30; the tiny reader agrees."""
    values = np.array([[0], [10], [20], [36], [40], [52]])
    coded = bytearray(one(values))
    assert table(bytes(coded), 6, 1) == values.tolist()


def test_a_value_that_jumps_is_an_exception():
    """A jump of 2^30 among steps of 1 costs 24 + 1 + k + 64 bits, not 2^30."""
    values = np.tile([[0], [1]], (50, 1))
    values[60:] += 2**30
    coded = one(values)
    assert len(coded) < 60
    assert coded[5] == 1
    assert ESCAPE == 24
    assert np.array_equal(decode_tables([coded], np.array([100]), 1)[0], values)


def test_wide_noise_costs_two_bits_a_number_more_than_its_own():
    """Differences of even noise of 28 bits: 29 bits with the sign, in k = 28 bits and a quotient of 2 bits at most."""
    values = np.random.default_rng(6).integers(-(2**27), 2**27, (1000, 1))
    assert len(one(values)) * 8 < 31 * 1000


@given(st.data())
@settings(max_examples=60, deadline=None)
def test_any_table_comes_back_from_ours_and_from_the_tiny_reader(data):
    rows = data.draw(st.lists(st.integers(1, 12), min_size=1, max_size=4))
    columns = data.draw(st.integers(1, 4))
    size = data.draw(st.sampled_from([1, 30, 10_000, LARGEST_INTEGER]))
    numbers = st.integers(-size, size)
    values = np.array(
        data.draw(
            st.lists(st.lists(numbers, min_size=columns, max_size=columns), min_size=sum(rows), max_size=sum(rows))
        )
    )
    coded = encode_tables(values, np.array(rows))
    back, sound = decode_tables(coded, np.array(rows), columns)
    assert sound.all()
    assert np.array_equal(back, values)
    starts = np.cumsum([0, *rows])
    for raw, start, count in zip(coded, starts, rows, strict=False):
        assert table(raw, count, columns) == values[start : start + count].tolist()


@pytest.mark.parametrize("kind", ["noise", "walk", "drift", "glide", "jumps", "still"])
def test_a_long_table_comes_back_from_ours_and_from_the_tiny_reader(kind):
    """Those of scans are decoded column by column."""
    rng, rows = np.random.default_rng(4), 5000
    noise = rng.integers(-300, 300, (rows, 3))
    values = {
        "noise": noise, "drift": noise + 40 * np.arange(rows)[:, None],
        "walk": np.cumsum(noise, axis=0), "glide": np.cumsum(np.cumsum(noise // 60, axis=0), axis=0),
        "jumps": np.where(rng.random((rows, 3)) < 0.01, LARGEST_INTEGER, np.cumsum(noise, axis=0)),
        "still": 0 * noise - 7,
    }[kind]  # fmt: skip
    coded = one(values)
    back, sound = decode_tables([coded], np.array([rows]), 3)
    assert sound.all()
    assert np.array_equal(back, values)
    assert table(coded, rows, 3) == values.tolist()


def test_the_three_orders_of_a_long_table_are_those_of_a_short_one():
    rng = np.random.default_rng(5)
    for order in (1, 2, 3):
        z = rng.integers(0, 8, 5000 - 1)
        for rows in (20, 5000):
            unary = np.concatenate([np.eye(9, dtype=bool)[count, : count + 1] for count in z[: rows - 1]])
            coded = bytes([32 * order, 6, 0, 0, 0]) + bytes(4) + np.packbits(unary, bitorder="little").tobytes()
            values, sound = decode_tables([coded], np.array([rows]), 1)
            assert sound.all()
            assert values[:20, 0].tolist() == [row[0] for row in table(coded, rows, 1)][:20]
        assert values[:, 0].tolist() == [row[0] for row in table(coded, rows, 1)]


def test_sums_beyond_64_bits_end_no_long_table():
    """Exceptions of 2^62 in each row: no writer makes them, and any numbers are right."""
    rows = 5000
    for order in (1, 2, 3):
        head = bytes([32 * order]) + bytes(4) + (rows - 1).to_bytes(4, "little")
        unary = np.tile(np.arange(25) == 24, rows - 1)
        raw = head + (2**62).to_bytes(8, "little") * (rows - 1) + np.packbits(unary, bitorder="little").tobytes()
        values, sound = decode_tables([raw], np.array([rows]), 1)
        assert sound.all()
        assert len(values) == rows


@pytest.mark.parametrize("order", [0, 4, 7])
def test_one_column_of_an_order_that_is_none_spoils_its_table(order):
    """Orders are 1 to 3; a code of order 0 and some k is none."""
    coded = bytearray(one([[10, 10], [12, 12], [11, 11]]))
    assert coded[0] & 31 > 0
    assert decode_tables([bytes(coded)], np.array([3]), 2)[1].all()
    coded[0] = 32 * order + (coded[0] & 31)
    assert not decode_tables([bytes(coded)], np.array([3]), 2)[1].any()


@pytest.mark.parametrize(("zeros", "is_sound"), [(ESCAPE - 1, True), (ESCAPE + 1, False)])
def test_a_quotient_above_the_escape_spoils_its_table_alone(zeros, is_sound):
    """As `test_a_column_by_hand`, with other quotients: so many zeros before a one, then a one."""
    raw = bytes([33, 20, 0, 0, 0, 0, 0, 0, 0, 0b10]) + (0b11 << zeros).to_bytes(4, "little")
    values, sound = decode_tables([raw, one([[10], [12], [11]])], np.array([3, 3]), 1)
    assert sound.tolist() == [is_sound, True]
    assert values[-3:].tolist() == [[10], [12], [11]]


def test_a_table_that_ends_within_its_head_is_none():
    _, sound = decode_tables([bytes(5 * 4 + 3), bytes(5 * 4 + 4)], np.array([2, 2]), 4)
    assert sound.tolist() == [False, True]


@given(st.binary(max_size=200), st.integers(1, 50), st.integers(1, 5))
@settings(max_examples=150, deadline=None)
def test_any_bytes_are_a_table_or_none(raw, rows, columns):
    values, sound = decode_tables([raw, one([[3] * columns] * rows)], np.array([rows, rows]), columns)
    assert sound[1]
    assert len(values) == rows * sound.sum()
    assert (values[-rows:] == 3).all()


@pytest.mark.parametrize("count", [2**31, 2**32 - 1])
def test_a_count_of_exceptions_that_cannot_be_is_no_table_and_takes_no_memory(count):
    raw = bytes([33, 0, 0, 0, 0]) + count.to_bytes(4, "little") + bytes(100)
    tracemalloc.start()
    _, sound = decode_tables([raw], np.array([4000]), 1)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert not sound.any()
    assert most < 1 << 20


def test_an_exception_that_no_quotient_marks_spoils_its_table():
    """As `test_a_column_by_hand`, with an exception of eight bytes more."""
    raw = bytes([33, 20, 0, 0, 0, 1, 0, 0, 0, 0b10]) + bytes(8) + bytes([0b1100])
    assert not decode_tables([raw], np.array([3]), 1)[1].any()
    assert table(one([[10], [12], [11]]), 3, 1) == [[10], [12], [11]]

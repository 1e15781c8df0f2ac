"""Times of frames from a sensor's clock that stumbles, wraps around or is set."""

from __future__ import annotations

import pytest

from capture.frame_clock import FrameClock


def test_one_late_frame_is_left_out_and_the_next_one_says_so():
    clock = FrameClock(30.0)
    assert [clock.place(time) for time in (1.0, 1.1, 0.5)] == [1.0, 1.1, None]
    assert clock.place(1.2) == 1.2
    assert clock.has_jumped
    assert clock.place(1.3) == 1.3
    assert not clock.has_jumped


def test_one_frame_an_hour_ahead_is_left_out_and_those_after_it_are_where_they_were():
    clock = FrameClock(10.0)
    assert [clock.place(time) for time in (1.0, 3601.0, 1.2)] == [1.0, None, 1.2]
    assert clock.has_jumped


def test_two_leaps_in_different_ways_are_no_clock_that_was_set():
    """Only the last three agree with each other."""
    clock = FrameClock(10.0)
    times = [1.0, 500.0, 0.3, 200.0, 200.1]
    assert [clock.place(time) for time in times] == [1.0, None, None, None, None]
    assert clock.place(200.2) == pytest.approx(1.5)


def test_a_gap_of_five_seconds_is_a_gap_and_not_a_clock_that_was_set():
    clock = FrameClock(30.0)
    assert [clock.place(time) for time in (1.0, 6.0, 11.1)] == [1.0, 6.0, None]


def test_a_clock_that_runs_backwards_all_the_time_never_places_a_frame():
    clock = FrameClock(30.0)
    assert [clock.place(9.0 - 0.1 * number) for number in range(40)] == [9.0, *[None] * 39]
    assert clock.now == pytest.approx(9.0 + 39 / 30)

"""Times of frames from a sensor's clock that repeats times, wraps around or is set."""

from __future__ import annotations

import pytest

from capture.recording.frame_clock import FrameClock


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


def test_two_jumps_in_different_directions_are_no_clock_that_was_set():
    """Only the last three agree with each other."""
    clock = FrameClock(10.0)
    times = [1.0, 500.0, 0.3, 200.0, 200.1]
    assert [clock.place(time) for time in times] == [1.0, None, None, None, None]
    assert clock.place(200.2) == pytest.approx(1.5)


def test_of_three_frames_far_ahead_each_must_follow_the_one_before():
    """202 s follow 200 s, and not the 204 s between; 209.8 s follow 204.9 s, and not 200 s."""
    clock = FrameClock(10.0)
    assert [clock.place(time) for time in (1.0, 200.0, 204.0, 202.0, 202.1)] == [1.0, None, None, None, None]
    assert clock.place(202.2) == pytest.approx(1.5)
    clock = FrameClock(10.0)
    assert [clock.place(time) for time in (1.0, 200.0, 204.9)] == [1.0, None, None]
    assert clock.place(209.8) == pytest.approx(1.3)


def test_the_dropped_frames_must_account_for_nine_tenths_of_a_leap():
    """At 5 a second, 24 dropped and the frame itself are 5.0 s of 5.5 s; 23 are 4.8 s, which lack 0.7 s."""
    assert [FrameClock(5.0).place(1.0), _after_one(24), _after_one(23)] == [1.0, 6.5, None]


def _after_one(dropped):
    clock = FrameClock(5.0)
    clock.place(1.0)
    return clock.place(6.5, dropped=dropped)


def test_a_gap_of_five_seconds_is_a_gap_and_not_a_clock_that_was_set():
    clock = FrameClock(30.0)
    assert [clock.place(time) for time in (1.0, 6.0, 11.1)] == [1.0, 6.0, None]


def test_a_clock_that_runs_backwards_all_the_time_never_dates_a_frame():
    clock = FrameClock(30.0)
    assert [clock.place(9.0 - 0.1 * number) for number in range(40)] == [9.0, *[None] * 39]
    assert clock.now == pytest.approx(9.0 + 39 / 30)


def test_a_jump_that_the_dropped_frames_account_for_is_a_pause():
    """300 dropped of 30 a second are 10 s; 100 are 3.4 s, and then the clock was set."""
    clock = FrameClock(30.0)
    assert [clock.place(1.0), clock.place(11.0, dropped=300), clock.place(11.1)] == [1.0, 11.0, 11.1]
    assert not clock.has_jumped
    assert clock.place(21.0, dropped=100) is None


def test_a_jump_that_the_hosts_clock_shows_too_is_a_pause_and_another_one_is_not():
    """The host's clock is 500 s ahead. A frame that waited meanwhile is handed over late, the next one at once."""
    clock = FrameClock(30.0)
    assert [clock.place(time, host_time=time + 500.0) for time in (1.0, 1.1)] == [1.0, 1.1]
    assert clock.place(1.2, host_time=511.3) == 1.2
    assert clock.place(11.4, host_time=511.4) == 11.4
    assert clock.place(31.5, host_time=511.5) is None


def test_a_pause_during_which_the_clock_was_set_is_as_long_as_the_hosts_clock_says():
    """Three frames after the pause begins a clock at 0: they are 10.0, 10.1 and 10.2 s after the last one."""
    clock = FrameClock(10.0)
    assert clock.place(7.0, host_time=507.0) == 7.0
    assert [clock.place(0.1 * k, host_time=517.0 + 0.1 * k) for k in range(2)] == [None, None]
    assert clock.place(0.2, host_time=517.2) == pytest.approx(17.2)
    assert clock.place(0.3, host_time=517.3) == pytest.approx(17.3)


@pytest.mark.parametrize(("late", "time"), [(0.4, 7.3), (0.6, 7.9)])
def test_the_hosts_clock_shows_no_pause_of_half_a_second_or_less_while_a_clock_is_set(late, time):
    """Three frames of 0.1 s after 7.0 s are at 7.3 s."""
    clock = FrameClock(10.0)
    clock.place(7.0, host_time=507.0)
    found = [clock.place(0.1 * k, host_time=507.1 + late + 0.1 * k) for k in range(3)]
    assert found == [None, None, pytest.approx(time)]


def test_frames_dropped_before_one_that_is_left_out_count_for_the_next_one():
    clock = FrameClock(10.0)
    assert clock.place(1.0, dropped=1) == 1.0
    assert clock.dropped == 1
    assert clock.place(0.2, dropped=2) is None
    assert clock.place(1.4, dropped=1) == 1.4
    assert clock.dropped == 3
    assert [clock.place(9.0 + 0.1 * k, dropped=4 * (k == 1)) for k in range(2)] == [None, None]
    assert clock.place(9.2) == pytest.approx(1.4 + 0.1 * (3 + 4))

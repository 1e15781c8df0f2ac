"""The pre-roll is measured in seconds, at every frame rate and with uneven frames."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from capture.appliance.pre_roll import PreRoll


def held_after(times, seconds=2.0):
    ring = PreRoll(seconds)
    for time in times:
        ring.add(SimpleNamespace(time=time))
    return ring


@pytest.mark.parametrize("fps", [15, 24, 30, 60])
def test_two_seconds_are_two_seconds_at_every_rate_with_a_third_of_jitter(fps):
    """The oldest frame lies 2 s back, and at most one frame's time with its jitter more."""
    rng = np.random.default_rng(fps)
    times = (np.arange(10 * fps) + rng.uniform(-0.33, 0.33, 10 * fps)) / fps
    ring = held_after(times)
    assert 2.0 <= ring.span <= 2.0 + 1.66 / fps
    assert len(ring) in range(2 * fps, 2 * fps + 3)


@given(st.lists(st.floats(0.001, 0.3), min_size=1, max_size=200), st.floats(0.0, 5.0))
def test_the_held_entries_cover_the_time_and_no_more(steps, seconds):
    times = np.cumsum(steps)
    ring = held_after(times, seconds)
    held = [entry.time for entry in ring.take()]
    assert held[-1] == times[-1]
    assert held[-1] - held[0] >= min(seconds, times[-1] - times[0]) or held[0] == times[0]
    assert len(held) < 2 or held[-1] - held[1] < seconds or seconds == 0.0
    assert len(ring) == 0


def test_a_gap_longer_than_the_pre_roll_leaves_the_frame_before_it():
    """Frames at 0, 1, 9 s: what is 2 s old or younger is the last; the one before it stays, so that 2 s are covered."""
    assert [entry.time for entry in held_after([0.0, 1.0, 9.0]).take()] == [1.0, 9.0]


def test_a_pre_roll_of_no_seconds_holds_one_frame():
    assert len(held_after(np.arange(100) / 30, 0.0)) == 1

"""A recording played as a live sensor: its pace, frames lost by a late reader, and unplugging."""

from __future__ import annotations

import numpy as np
import pytest

from firmware_host.errors import SensorStalledError, SensorUnavailableError
from firmware_host.paced import PacedSensor
from tests.capture.stage import StageSensor

FPS = 10.0


class Clock:
    """A clock that advances only in sleep, and a little at every reading."""

    def __init__(self):
        self.now = 100.0

    def __call__(self):
        self.now += 1e-6
        return self.now

    def sleep(self, seconds):
        self.now += seconds


def numbered(count):
    """Return frames whose depth encodes their number."""
    return [(np.full((2, 2), k, np.uint16), np.zeros((2, 2, 3), np.uint8)) for k in range(count)]


@pytest.fixture
def clock():
    return Clock()


def played(clock, cord=None, count=4):
    return PacedSensor(
        lambda: StageSensor(numbered(count), fps=FPS), "live:stage", cord, clock=clock, sleep=clock.sleep
    )


def shown(frame):
    return int(frame.depth[0, 0])


def test_it_says_that_it_is_live_and_never_ends(clock):
    sensor = played(clock)
    assert sensor.info.is_live
    assert sensor.info.frame_count is None
    frames = [sensor.read() for _ in range(9)]
    assert [shown(frame) for frame in frames] == [0, 1, 2, 3, 0, 1, 2, 3, 0]
    assert np.diff([frame.time_s for frame in frames]) == pytest.approx(1 / FPS)
    assert clock.now == pytest.approx(100.0 + 8 / FPS, abs=1e-3)
    assert not any(frame.dropped_before for frame in frames)


def test_a_reader_that_is_late_by_two_frames_misses_two_and_reports_them(clock):
    sensor = played(clock)
    sensor.read()
    clock.sleep(0.35)
    late = sensor.read()
    assert (shown(late), late.dropped_before, late.index) == (3, 2, 3)
    assert sensor.read().dropped_before == 0


def test_after_a_second_in_which_nobody_read_the_recording_goes_on_from_where_it_was(clock):
    sensor = played(clock)
    sensor.read()
    clock.sleep(1.05)
    late = sensor.read()
    assert (shown(late), late.dropped_before) == (1, 9)


def test_a_silent_cord_stalls_after_the_time_that_is_waited_for(clock, tmp_path):
    cord = tmp_path / "cord"
    sensor = played(clock, cord)
    sensor.read()
    cord.write_text("silent\n")
    with pytest.raises(SensorStalledError, match="no frame for 2 s"):
        sensor.read(timeout_s=2.0)
    assert 102.0 <= clock.now < 102.2
    cord.write_text("")
    assert sensor.read().dropped_before == 19  # 2.0 s at ten frames a second, but for the first and this one


def test_an_unplugged_cord_fails_at_once_and_cannot_be_opened(clock, tmp_path):
    cord = tmp_path / "cord"
    sensor = played(clock, cord)
    cord.write_text("unplugged")
    with pytest.raises(SensorStalledError, match="was unplugged"):
        sensor.read()
    with pytest.raises(SensorUnavailableError, match="no depth sensor is connected"):
        played(clock, cord)


def test_a_closed_one_gives_no_more_frames(clock):
    sensor = played(clock)
    sensor.close()
    assert sensor.read() is None

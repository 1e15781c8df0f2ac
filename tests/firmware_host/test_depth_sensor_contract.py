"""The contract test of every depth sensor: the synthetic one, and OpenNI2 playing a file."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from firmware_host.depth_sensor import DepthSensor
from firmware_host.openni2_sensor import OpenNI2Sensor
from firmware_host.synthetic.sensor import SyntheticSensor
from tests.firmware_host.scenes import flat_world, write_recording

Opener = Callable[[], DepthSensor]
FRAMES = 4


@pytest.fixture(params=["synthetic", pytest.param("openni2_file", marks=pytest.mark.openni)])
def open_it(request: pytest.FixtureRequest, tmp_path: Path) -> Opener:
    if request.param == "synthetic":
        return lambda: SyntheticSensor(flat_world(FRAMES), "synthetic:flat")
    request.getfixturevalue("openni")
    path = write_recording(tmp_path / "a.oni", FRAMES)
    return lambda: OpenNI2Sensor(path)


def test_the_size_announced_is_the_size_delivered(open_it: Opener) -> None:
    with open_it() as sensor:
        info, frame = sensor.info, sensor.read()
    assert frame is not None
    assert frame.depth.shape == (info.height, info.width)
    assert frame.depth.dtype == np.uint16
    assert frame.colour is not None
    assert frame.colour.shape == (info.height, info.width, 3)
    assert frame.colour.dtype == np.uint8
    assert (info.intrinsics.width, info.intrinsics.height) == (info.width, info.height)


def test_all_four_frames_come_counted_from_zero_without_a_gap(open_it: Opener) -> None:
    with open_it() as sensor:
        frames = list(sensor.frames())
        assert sensor.info.frame_count in (FRAMES, None)
    assert [frame.index for frame in frames] == [0, 1, 2, 3]
    assert [frame.dropped_before for frame in frames] == [0, 0, 0, 0]


def test_frames_are_a_thirtieth_of_a_second_apart(open_it: Opener) -> None:
    with open_it() as sensor:
        times = [frame.time_s for frame in sensor.frames()]
        assert sensor.info.fps == 30
    # Time stamps are whole microseconds.
    np.testing.assert_allclose(np.diff(times), 1 / 30, atol=2e-6)
    assert times[0] > 0


def test_a_frame_bears_the_time_of_the_hosts_clock_while_it_was_read(open_it: Opener) -> None:
    """A monotonic clock; the contract does not state whether it continues while the computer sleeps."""

    def clocks() -> np.ndarray:
        return np.array([time.clock_gettime(clock) for clock in (time.CLOCK_MONOTONIC, time.CLOCK_BOOTTIME)])

    with open_it() as sensor:
        times = []
        for _ in range(FRAMES):
            before, frame, after = clocks(), sensor.read(), clocks()
            assert frame is not None
            assert ((before <= frame.host_time_s) & (frame.host_time_s <= after)).any()
            times.append(frame.host_time_s)
    assert len(set(times)) == FRAMES


def test_the_end_is_none_and_stays_none(open_it: Opener) -> None:
    with open_it() as sensor:
        assert len(list(sensor.frames())) == FRAMES
        assert sensor.read() is None
        assert sensor.read() is None


def test_a_frame_kept_does_not_change_when_the_next_is_read(open_it: Opener) -> None:
    with open_it() as sensor:
        first = sensor.read()
        assert first is not None
        depth, colour = first.depth.copy(), np.array(first.colour)
        list(sensor.frames())
    np.testing.assert_array_equal(first.depth, depth)
    np.testing.assert_array_equal(first.colour, colour)


def test_two_openings_show_the_same_pictures(open_it: Opener) -> None:
    with open_it() as once:
        first = list(once.frames())
    with open_it() as again:
        second = list(again.frames())
    assert len(first) == FRAMES
    for one, other in zip(first, second, strict=True):
        np.testing.assert_array_equal(one.depth, other.depth)
        np.testing.assert_array_equal(one.colour, other.colour)
        assert one.time_s == other.time_s


def test_leaving_early_and_closing_twice_is_allowed(open_it: Opener) -> None:
    sensor = open_it()
    assert sensor.read() is not None
    sensor.close()
    sensor.close()


def test_a_frame_cannot_be_altered_field_by_field(open_it: Opener) -> None:
    with open_it() as sensor:
        frame = sensor.read()
    with pytest.raises(dataclasses.FrozenInstanceError):
        frame.index = 7  # type: ignore[union-attr,misc]


def test_a_file_or_a_made_up_world_is_not_live(open_it: Opener) -> None:
    with open_it() as sensor:
        assert not sensor.info.is_live
        assert sensor.info.name

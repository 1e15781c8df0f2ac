"""Recordings with a frame that decompresses to too few pixels, through the real OpenNI2 library."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from firmware_host.errors import RecordingError
from firmware_host.oni_records import RecordType, read_records
from firmware_host.oni_writer import OniWriter
from firmware_host.openni2_sensor import OpenNI2Sensor
from tests.firmware_host.oni_depth import decode_depth
from tests.firmware_host.scenes import PERIOD_US, SMALL, payload_of, picture, write_recording


def with_fewer_pixels(packed: bytes) -> bytes:
    """Turn the lowest bit of one byte of a packed `picture`, one that makes two pixels fewer of it."""
    begin = min(1300, len(packed))  # a little before the first of those in its latter half
    for place in (*range(begin, len(packed)), *range(begin)):
        turned = bytearray(packed)
        turned[place] ^= 1
        try:
            decode_depth(bytes(turned), (48, 64))
        except ValueError as error:
            if "3070 into shape" in str(error):
                return bytes(turned)
    raise AssertionError("no bit does")


@pytest.mark.openni
@pytest.mark.usefixtures("openni")
def test_a_depth_frame_with_a_turned_bit_is_left_out_and_counted_as_dropped(tmp_path: Path) -> None:
    path = write_recording(tmp_path / "a.oni", 6)
    third = [r for r in read_records(path) if r.type == RecordType.NEW_DATA and r.node == 1][2]
    data = bytearray(path.read_bytes())
    place = payload_of(third)
    data[place] = with_fewer_pixels(bytes(data[place]))
    path.write_bytes(data)
    with OpenNI2Sensor(path) as sensor:
        frames = list(sensor.frames())
    assert [(frame.index, frame.dropped_before) for frame in frames] == [(0, 0), (1, 0), (3, 1), (4, 0), (5, 0)]
    for frame in frames:
        np.testing.assert_array_equal(frame.depth, picture(frame.index)[0])
        np.testing.assert_array_equal(frame.colour, picture(frame.index)[1])


@pytest.mark.openni
@pytest.mark.usefixtures("openni")
def test_damaged_frames_before_the_first_intact_one_are_counted_as_dropped(tmp_path: Path) -> None:
    path = tmp_path / "a.oni"
    with OniWriter(path, SMALL, depth_codec="NONE", with_colour=False) as writer:
        for number in range(5):
            content = picture(number)[0].tobytes()
            writer._append(writer._depth, 1000 + number * PERIOD_US, content[:-2] if number < 2 else content)
    with OpenNI2Sensor(path) as sensor:
        frames = list(sensor.frames())
    assert [(frame.index, frame.dropped_before) for frame in frames] == [(2, 2), (3, 0), (4, 0)]


@pytest.mark.openni
@pytest.mark.usefixtures("openni")
def test_a_colour_frame_with_too_few_bytes_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "a.oni"
    with OniWriter(path, SMALL) as writer:
        for number in range(4):
            depth, colour = picture(number)
            writer.write_depth(1000 + number * PERIOD_US, depth)
            content = colour.tobytes()
            writer._append(writer._colour, 2000 + number * PERIOD_US, content[:-3] if number == 2 else content)
    with OpenNI2Sensor(path) as sensor:
        assert [frame.colour is None for frame in sensor.frames()] == [False, False, True, False]


@pytest.mark.openni
@pytest.mark.usefixtures("openni")
def test_a_recording_without_one_whole_depth_frame_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "a.oni"
    with OniWriter(path, SMALL, depth_codec="NONE", with_colour=False) as writer:
        for number in range(3):
            writer._append(writer._depth, 1000 + number * PERIOD_US, picture(number)[0].tobytes()[:-2])
    with OpenNI2Sensor(path) as sensor, pytest.raises(RecordingError, match="every depth frame is damaged; copy"):
        list(sensor.frames())

"""Recordings by other programs with other clocks, numbers or images: read correctly, or refused with the cause."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from firmware_host import openni2_library
from firmware_host.errors import RecordingError
from firmware_host.oni_records import RECORD_HEADER, RecordType, read_records, summarise
from firmware_host.openni2_sensor import OpenNI2Sensor
from tests.firmware_host.test_openni2_sensor import write_recording

pytestmark = [pytest.mark.openni, pytest.mark.usefixtures("openni")]


def restamped(path, stamp_of, number_of=lambda k: k + 1):
    """Change timestamp [us] and number of the k-th frame of each stream."""
    raw, seen = bytearray(path.read_bytes()), {}
    for record in read_records(path):
        if record.type == RecordType.NEW_DATA:
            k = seen[record.node] = seen.get(record.node, -1) + 1
            struct.pack_into("<QI", raw, record.position + RECORD_HEADER.size, stamp_of(k), number_of(k))
    path.write_bytes(raw)
    return path


def test_stamps_that_run_125_times_as_fast_as_the_stated_rate_are_refused(tmp_path):
    """267 us apart at 30 frames a second: 1e6 / 30 / 267 = 124.8."""
    path = restamped(write_recording(tmp_path / "a.oni", 12), lambda k: 267 * (k + 1))
    with pytest.raises(
        RecordingError, match=r"its stamps run 125 times as fast as its 30 frames a second, 267 us apart"
    ):
        OpenNI2Sensor(path)


@pytest.mark.parametrize(
    ("interval", "how"),
    [(33, "1010 times as fast as its 30 frames a second, 33"), (33_333_333, "1000 times as slowly .*, 33333333")],
)
def test_stamps_in_another_unit_are_told_without_an_exponent(tmp_path, interval, how):
    path = restamped(write_recording(tmp_path / "a.oni", 12), lambda k: interval * (k + 1))
    with pytest.raises(RecordingError, match=f"its stamps run {how} us apart; record again with stamps in micro"):
        OpenNI2Sensor(path)


@pytest.mark.parametrize(
    ("interval", "how"),
    [(66_667, "2 times as slowly"), (333_333, "10 times as slowly"), (41_000, "1.23 times as slowly"),
     (27_000, "1.23 times as fast")],
)  # fmt: skip
def test_stamps_more_than_a_fifth_off_the_stated_rate_are_refused_or_accepted(tmp_path, interval, how):
    """The sensor may have slowed down in dim light, or its stamps be wrong, and a fit would find another fabric."""
    path = restamped(write_recording(tmp_path / "a.oni", 12), lambda k: interval * (k + 1))
    told = (
        f"its stamps run {how} as its 30 frames a second, {interval} us apart; record again with a steady rate; where"
    )
    with pytest.raises(RecordingError, match=told):
        OpenNI2Sensor(path)
    with OpenNI2Sensor(path, anyway=True) as sensor:
        assert sensor.info.notes[-1] == f"its frames come at {1e6 / interval:.1f} a second, the recording states 30"


@pytest.mark.parametrize("stamp_of", [lambda k: 0, lambda k: 5, lambda k: 33_333 * (100 - k)])
def test_stamps_that_never_increase_are_named_as_the_fault_of_the_recording(tmp_path, stamp_of):
    path = restamped(write_recording(tmp_path / "a.oni", 12), stamp_of)
    with pytest.raises(RecordingError) as caught:
        OpenNI2Sensor(path)
    assert caught.value.what == "the stamps of its 12 depth frames never increase"
    assert caught.value.advice == "record again, with stamps of a clock in microseconds"
    OpenNI2Sensor(path, anyway=True).close()


def test_a_clock_that_is_set_back_once_does_not_stand_still(tmp_path):
    path = restamped(
        write_recording(tmp_path / "a.oni", 12), lambda k: 33_333 * (k + 1) - (k > 5) * 1_000_000 + 1_000_000
    )
    OpenNI2Sensor(path).close()


def test_a_recording_that_is_refused_leaves_no_stream_behind(tmp_path):
    """A stream that Python collects after its device was closed ends the process."""
    path = restamped(write_recording(tmp_path / "a.oni", 12), lambda k: 250_000 * (k + 1))
    with pytest.raises(RecordingError, match="frames a second") as kept:
        OpenNI2Sensor(path)
    assert kept.traceback  # its frames hold the streams
    assert not any(openni2_library.load()._registered_video_streams)


@pytest.mark.parametrize("interval", [29_000, 39_000])
def test_stamps_within_a_fifth_of_the_stated_rate_are_accepted(tmp_path, interval):
    path = restamped(write_recording(tmp_path / "a.oni", 12), lambda k: interval * (k + 1))
    with OpenNI2Sensor(path) as sensor:
        assert not any("the recording states" in note for note in sensor.info.notes)


def test_a_recording_of_fewer_than_five_frames_a_second_is_refused_or_accepted(tmp_path, monkeypatch):
    path = restamped(write_recording(tmp_path / "a.oni", 12), lambda k: 250_000 * (k + 1))
    monkeypatch.setattr("firmware_host.openni2_sensor.RATE_WITHIN", 10.0)  # as if the file stated 4 frames a second
    told = "has 4 frames a second; a garment needs 5 to 1000; record with more frames a second, or accept them with"
    with pytest.raises(RecordingError, match=told):
        OpenNI2Sensor(path)
    with OpenNI2Sensor(path, anyway=True) as sensor:
        assert next(sensor.frames()).time_s == 0.25


def test_numbers_that_begin_anew_while_the_clock_goes_on_are_further_frames(tmp_path):
    """Six and six: all twelve are given, numbered on."""
    path = restamped(write_recording(tmp_path / "a.oni", 12), lambda k: 30_000 * (k + 1), lambda k: k % 6 + 1)
    with OpenNI2Sensor(path) as sensor:
        assert [frame.index for frame in sensor.frames()] == list(range(12))


def test_frames_whose_numbers_are_above_their_count_are_said_to_be_left_out(tmp_path):
    """Numbers 1, 4, ... 34 of twelve frames: 1 to 10 are played, four frames."""
    path = restamped(write_recording(tmp_path / "a.oni", 12), lambda k: 33_333 * (k + 1), lambda k: 3 * k + 1)
    with OpenNI2Sensor(path) as sensor:
        assert "8 of its 12 depth frames have numbers above 12 and are left out" in sensor.info.notes
        assert sensor.info.left_out == 8
        assert not sensor.info.is_turned
        assert len(list(sensor.frames())) == 4


def test_a_recording_whose_numbers_are_all_above_their_count_is_refused(tmp_path):
    path = restamped(write_recording(tmp_path / "a.oni", 12), lambda k: 33_333 * (k + 1), lambda k: k + 100)
    told = r"a\.oni: the numbers of all its 12 depth frames are above 12, so none of them can be played; record again"
    with pytest.raises(RecordingError, match=told):
        OpenNI2Sensor(path)


def test_a_stamp_that_lies_centuries_away_is_refused_with_its_file(tmp_path, monkeypatch):
    """The player of the test stops before stamps of centuries, so they begin at 0.05 s here."""
    monkeypatch.setattr("firmware_host.openni2_sensor.LATEST", 50_000)
    path = restamped(write_recording(tmp_path / "a.oni", 12), lambda k: 33_333 * (k + 1))
    told = r"a\.oni: the stamp of frame 2 is 6\.667e\+04 us, centuries away; record again, with stamps of a clock"
    with OpenNI2Sensor(path) as sensor, pytest.raises(RecordingError, match=told):
        list(sensor.frames())


def test_stamps_of_32_bits_that_begin_anew_go_on(tmp_path):
    """4294.967 s are followed by 0.01 s."""
    path = restamped(write_recording(tmp_path / "a.oni", 8), lambda k: (2**32 - 100_000 + 33_333 * k) % 2**32)
    with OpenNI2Sensor(path) as sensor:
        frames = list(sensor.frames())
    np.testing.assert_allclose(np.diff([frame.time_s for frame in frames]), 0.033333, atol=1e-9)
    assert all(frame.colour is not None for frame in frames)


def test_pictures_that_the_recording_says_are_mirrored_are_turned_round(tmp_path):
    path = write_recording(tmp_path / "a.oni", 3)
    with OpenNI2Sensor(path) as sensor:
        plain = next(sensor.frames())
    raw = path.read_bytes()
    name = b"xnMirror\0" + struct.pack("<I", 8)
    path.write_bytes(raw.replace(name + struct.pack("<Q", 0), name + struct.pack("<Q", 1)))
    assert summarise(path).mirrored == {2, 3}
    with OpenNI2Sensor(path) as sensor:
        turned = next(sensor.frames())
        assert "mirrored; Hangtime turns mirrored pictures round" in sensor.info.notes[-1]
        assert sensor.info.is_turned
    assert np.array_equal(turned.depth, plain.depth[:, ::-1])
    assert np.array_equal(turned.colour, plain.colour[:, ::-1])

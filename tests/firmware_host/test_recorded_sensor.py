"""Recordings played in a separate process: any file name works, and a crash of the library gives one sentence."""

from __future__ import annotations

import os
import pickle
import select
import struct
import tempfile
import time

import numpy as np
import pytest

from firmware_host.errors import RecordingError, SensorUnavailableError
from firmware_host.openni2_sensor import CLOCK, OpenNI2Sensor
from firmware_host.recorded_sensor import RecordedSensor
from tests.firmware_host.test_openni2_sensor import write_recording

pytestmark = pytest.mark.openni


@pytest.mark.parametrize("name", ["plain.oni", "Rück-\u80cc.oni", os.fsdecode(b"\xff.oni")])
def test_a_recording_of_any_name_gives_the_same_frames_as_in_this_process(tmp_path, name):
    """Eight frames; OpenNI2 itself ends with a segmentation fault on names that are not ASCII."""
    plain = write_recording(tmp_path / "a.oni", 8)
    with OpenNI2Sensor(plain) as sensor:
        wanted = list(sensor.frames())
    with RecordedSensor(plain.rename(tmp_path / name)) as sensor:
        assert sensor.info.uri == str(tmp_path / name)
        found = list(sensor.frames())
        assert sensor.read() is None
    assert len(found) == len(wanted) == 8
    for one, other in zip(found, wanted, strict=True):
        assert (one.index, one.time_s) == (other.index, other.time_s)
        assert np.array_equal(one.depth, other.depth)
        assert np.array_equal(one.colour, other.colour)


@pytest.mark.parametrize("folder", ["Rück-\u80cc", os.fsdecode(b"\xff")])
def test_a_recording_is_played_whatever_the_letters_of_the_folder_for_temporary_files(tmp_path, monkeypatch, folder):
    (tmp_path / folder).mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / folder))
    with RecordedSensor(write_recording(tmp_path / "a.oni", 3)) as sensor:
        assert len(list(sensor.frames())) == 3
    assert not list((tmp_path / folder).iterdir())


def test_a_library_that_crashes_is_one_sentence_and_leaves_no_process(tmp_path):
    """The process that plays is killed after its second frame, as by a segmentation fault."""
    with RecordedSensor(write_recording(tmp_path / "a.oni", 200)) as sensor:
        sensor.read()
        os.kill(sensor._process.pid, 11)
        with pytest.raises(RecordingError, match=r"a\.oni: OpenNI2 crashed while it played this recording; copy"):
            list(sensor.frames())
        assert sensor._process.poll() == -11


def test_a_file_that_is_no_recording_is_refused_before_a_process_is_begun(tmp_path):
    (tmp_path / "a.oni").write_bytes(b"no recording")
    with pytest.raises(RecordingError, match=r"a\.oni: "):
        RecordedSensor(tmp_path / "a.oni")
    with pytest.raises(RecordingError, match=r"gone\.oni: the recording cannot be read"):
        RecordedSensor(tmp_path / "gone.oni")


def test_a_recording_that_was_closed_is_at_its_end_and_may_be_closed_again(tmp_path):
    sensor = RecordedSensor(write_recording(tmp_path / "a.oni", 2))
    sensor.close()
    sensor.close()
    assert sensor.read() is None


def test_an_error_of_the_player_names_the_recording_and_not_the_link(tmp_path, monkeypatch):
    """Without the library, the process says so, as this one would."""
    (tmp_path / "openni").mkdir()
    (tmp_path / "openni/__init__.py").write_text("raise ModuleNotFoundError('openni')")
    path = write_recording(tmp_path / "a.oni", 2)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(SensorUnavailableError, match="the Python package `openni` is not installed"):
        RecordedSensor(path)


def test_a_frame_of_five_megapixels_with_colour_passes_through_the_pipe(tmp_path):
    """25 MB: depth of 2 bytes and colour of 3 bytes a pixel."""
    content = pickle.dumps(bytes(25_000_000), protocol=5)
    (tmp_path / "pipe").write_bytes(struct.pack("<Q", len(content)) + content)
    sensor = object.__new__(RecordedSensor)
    with (tmp_path / "pipe").open("rb") as sensor._pipe:
        assert len(sensor._receive()) == 25_000_000


def test_a_frame_is_delivered_when_it_leaves_the_pipe(tmp_path):
    """By this process's clock, and not by that of the process that plays, which may be far ahead."""
    with RecordedSensor(write_recording(tmp_path / "a.oni", 3)) as sensor:
        sensor.read()
        select.select([sensor._pipe], [], [], 60.0)  # the next one has left the other process
        before = time.clock_gettime(CLOCK)
        assert before <= sensor.read().host_time_s <= time.clock_gettime(CLOCK)

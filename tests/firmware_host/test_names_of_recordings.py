"""Recordings play whatever their path: OpenNI2 itself ends the process at some, and refuses long ones."""

from __future__ import annotations

import pytest

from firmware_host import openni2_library
from firmware_host.openni2_sensor import OpenNI2Sensor
from tests.firmware_host.test_openni2_sensor import write_recording

pytestmark = [pytest.mark.openni, pytest.mark.usefixtures("openni")]

LONG = "d" * 200


@pytest.mark.parametrize(
    "name",
    ["J\u00fcrgen.oni", "\u65e5\u672c/a.oni", "\udcff.oni", f"{LONG}/{LONG}.oni", "a b'c.oni"],
    ids=["umlaut", "folder", "no UTF-8", "long", "plain"],
)
def test_a_recording_of_any_name_plays_twice_to_its_end(tmp_path, name):
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    write_recording(path, 12)
    for _ in range(2):
        with OpenNI2Sensor(path) as sensor:
            frames = [sensor.read() for _ in range(13)]
            assert sensor.info.uri == str(path)
        assert [frame is None for frame in frames] == [False] * 12 + [True]
    assert openni2_library.live_uris() == []


@pytest.mark.parametrize("length", [255, 256])
def test_a_recording_plays_whose_path_is_as_long_as_the_library_holds_or_a_letter_longer(tmp_path, length):
    room = length - len(str(tmp_path)) - len("/.oni")
    path = tmp_path / f"{'x' * room}.oni"
    assert len(str(path)) == length
    write_recording(path, 2)
    with openni2_library.playable(path) as name, OpenNI2Sensor(path) as sensor:
        assert name == str(path) or length == 256
        assert sensor.read() is not None

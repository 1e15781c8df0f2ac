"""The doctor's check of the hanger's markers, on images with markers drawn by OpenCV."""

from __future__ import annotations

from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest
from typer.testing import CliRunner

from capture.sensor_check import markers_visible
from firmware_host.depth_sensor import SensorFrame, SensorInfo
from firmware_host.doctor.checks import Examination, StreamSample, Verdict
from firmware_host.oni_writer import OniWriter
from formats.arrays import Bytes
from formats.command import app, gather_commands
from formats.rig import Hanger, Rig, Sensor
from tests import openni2
from tests.capture.hanger.test_colour_dots import RIG as DOT_RIG
from tests.capture.hanger.test_colour_dots import dots as drawn_dots
from tests.capture.stage import CAMERA, pictures

SENSOR = Sensor(width=320, height=240, fx=288.0, fy=288.0, cx=159.5, cy=119.5)


def drawn(*ids: int) -> Bytes:
    """A white picture, RGB, (240, 320, 3), with these markers of DICT_4X4_50 side by side, 24 px each."""
    picture = np.full((240, 320), 255, np.uint8)
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    for place, number in enumerate(ids):
        picture[100:124, 40 + 80 * place : 64 + 80 * place] = cv2.aruco.generateImageMarker(dictionary, number, 24)
    return np.repeat(picture[..., None], 3, axis=2)


def examined(*pictures: Bytes | None, rig: Rig | None = None) -> Examination:
    """An examination with these colour pictures half a second apart."""
    info = SensorInfo(name="s", uri="s", width=320, height=240, fps=30.0, intrinsics=SENSOR, is_live=False)
    sample = StreamSample(info=info)
    for number, colour in enumerate(pictures):
        depth = np.ones((240, 320), np.uint16)
        sample.add(SensorFrame(index=number, time_s=0.5 * number, host_time_s=0.0, depth=depth, colour=colour))
    return Examination(sample=sample, rig=rig)


def rig(*ids: int) -> Rig:
    corner = (0.0, 0.0, 0.0)
    hanger = Hanger(
        dictionary="DICT_4X4_50",
        ids=(ids[0], ids[1]),
        marker_size_m=0.06,
        marker_distance_m=0.3,
        held_m=(corner, corner),
    )
    return Rig(format="hangtime-rig/1", name="r", gravity=(0.0, 1.0, 0.0), hanger=hanger, sensor=SENSOR)


def test_both_markers_in_three_of_four_pictures_are_enough() -> None:
    finding = markers_visible(examined(drawn(0, 1), drawn(0), drawn(1, 0), drawn(0, 1)))
    assert finding.verdict is Verdict.OK
    assert finding.text == "DICT_4X4_50 marker 0 in 100 %, marker 1 in 75 % of 4 frames"


def test_a_marker_in_one_of_three_pictures_is_a_problem() -> None:
    finding = markers_visible(examined(drawn(0, 1), drawn(0), drawn(0)))
    assert finding.verdict is Verdict.PROBLEM
    assert "marker 1 in 33 % of 3 frames; hang the hanger" in finding.text


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        (
            lambda picture: picture[:, ::-1].copy(),
            "both are seen in the picture's mirror image: switch the sensor's mirror off",
        ),
        (lambda picture: 255 - picture, "both are seen white on black: print them black on white"),
        (
            lambda picture: 0 * picture,
            "hang the hanger 1.2 to 2.5 m before the sensor, markers towards it, in even light",
        ),
    ],
)
@pytest.mark.parametrize("whose", [None, rig(0, 1)])
def test_markers_that_are_seen_otherwise_are_told_with_the_remedy(changed, told, whose) -> None:
    finding = markers_visible(examined(changed(drawn(0, 1)), rig=whose))
    assert finding.text == f"DICT_4X4_50 marker 0 in 0 %, marker 1 in 0 % of 1 frames; {told}"


def test_other_markers_are_named_and_the_rig_that_has_them_is_right() -> None:
    assert "markers [7, 9] are there instead: give the rig" in markers_visible(examined(drawn(7, 9))).text
    assert markers_visible(examined(drawn(7, 9), rig=rig(7, 9))).verdict is Verdict.OK


def test_dots_are_sought_where_the_rig_says_dots() -> None:
    dots = msgspec.structs.replace(DOT_RIG, name="dots")
    depth, colour = pictures(drawn_dots(), np.random.default_rng(1))
    frame = SensorFrame(index=0, time_s=0.0, host_time_s=0.0, depth=depth, colour=colour)
    info = SensorInfo(name="s", uri="s", width=640, height=480, fps=30.0, intrinsics=CAMERA, is_live=False)
    sample = StreamSample(info=info)
    sample.add(frame)
    assert markers_visible(Examination(sample=sample, rig=dots)).text == "both dots in 100 % of 1 frames"
    blue = msgspec.structs.replace(dots.hanger, dot_colours=((0, 0, 255), (0, 0, 255)))
    finding = markers_visible(Examination(sample=sample, rig=msgspec.structs.replace(dots, hanger=blue)))
    assert finding.verdict is Verdict.PROBLEM


def test_without_colour_there_is_nothing_to_look_at() -> None:
    assert markers_visible(examined(None, None)).verdict is Verdict.SKIPPED
    assert markers_visible(Examination()).verdict is Verdict.SKIPPED


@pytest.mark.openni
def test_a_good_recording_passes_every_line_and_the_doctor_exits_with_0(tmp_path: Path) -> None:
    if not openni2.is_available():
        pytest.skip("libopenni2 is not installed (apt-get install libopenni2-0)")
    with OniWriter(tmp_path / "a.oni", SENSOR) as writer:
        for number in range(20):
            writer.write_depth(1000 + 33_333 * number, np.full((240, 320), 1500, np.uint16))
            writer.write_colour(2000 + 33_333 * number, drawn(0, 1))
    gather_commands()
    result = CliRunner().invoke(app, ["sensor", "doctor", str(tmp_path / "a.oni")])
    assert result.exit_code == 0, result.output
    assert [line.split()[0] for line in result.output.splitlines()] == ["streams", "frame", "depth", "markers"]
    assert result.output.count("  ok: ") == 4

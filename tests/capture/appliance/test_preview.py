"""The preview: its line, and its picture with markers, outline and points drawn in."""

from __future__ import annotations

import base64
import dataclasses

import cv2
import numpy as np
import pytest

from capture.appliance.preview import Preview
from capture.garment.sight import nothing_found
from capture.hanger.fiducial_tracker import nothing_seen
from capture.recording.tracking import Tracked
from firmware_host.depth_sensor import SensorFrame
from formats.take import FrameState

SQUARE = np.array([[0, 0], [40, 0], [40, 40], [0, 40.0]])
NO_DEPTH = np.zeros((480, 640), np.uint16)
LOST = FrameState.MARKER_LOST | FrameState.GARMENT_LOST


def a_sight(*, is_found, state=0):
    hanger, cloth = nothing_seen(), nothing_found(2)
    if is_found:
        hanger = dataclasses.replace(
            hanger, valid=np.array([True, True]), positions=np.array([[0, 0, 1.5], [0.3, 0, 1.7]]),
            corners=np.stack([SQUARE + 20, SQUARE + np.array([500, 20])]), centres=np.ones((2, 2)),
        )  # fmt: skip
        cloth = dataclasses.replace(
            cloth, valid=np.array([True, False]), pixels=np.array([[320.0, 300], [np.nan, np.nan]]),
            outline=SQUARE * 8 + np.array([160, 150]),
        )  # fmt: skip
    return Tracked(hanger, cloth, int(state), np.full((2, 3), np.nan))


def a_frame(colour, depth=NO_DEPTH):
    return SensorFrame(index=0, time_s=0.0, host_time_s=0.0, depth=depth, colour=colour)


def pictured(frame, sight):
    preview = Preview()
    preview.keep(frame, sight)
    answer = preview.answer()
    raw = np.frombuffer(base64.b64decode(answer["png"]), np.uint8)
    return answer["line"], cv2.cvtColor(cv2.imdecode(raw, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)


def test_before_the_first_frame_there_is_no_picture():
    assert Preview().answer() == {"line": "no frame yet", "png": ""}


def test_a_seen_hanger_has_its_distance_and_the_drawing_its_colours_and_leaves_the_frame_alone():
    colour = np.full((480, 640, 3), 100, np.uint8)
    line, picture = pictured(a_frame(colour), a_sight(is_found=True))
    assert line.endswith(": hanger 1.60 m away, 1 of 2 points")
    assert picture.shape == (240, 320, 3)
    assert picture[60, 60].tolist() == [100, 100, 100]
    for row, column, wanted in ((10, 20, (0, 200, 0)), (150, 157, (255, 160, 0)), (75, 120, (0, 120, 255))):
        # A line of one pixel has a quarter to half of its colour in a picture of half the size.
        change, full = picture[row, column] - 100.0, np.array(wanted) - 100.0
        assert change @ full > 0.2 * full @ full
    assert (colour == 100).all()


@pytest.mark.parametrize(("is_found", "state", "said"), [(False, LOST, "no markers"), (True, 0, "hanger 1.60 m")])
def test_the_line_says_what_is_seen_and_what_to_do(is_found, state, said):
    preview = Preview()
    preview.keep(a_frame(np.zeros((480, 640, 3), np.uint8)), a_sight(is_found=is_found, state=state))
    line = preview.answer()["line"]
    assert said in line
    assert ("hanger 1.60 m away" in line) is is_found
    assert ("; show both markers" in line) is not is_found


def test_a_fault_of_a_seen_hanger_has_its_advice_behind_the_distance():
    line, _ = pictured(a_frame(np.zeros((480, 640, 3), np.uint8)), a_sight(is_found=True, state=FrameState.TOO_FAR))
    assert line.startswith("too far: hanger 1.60 m away, 1 of 2 points; come closer")


def test_without_colour_the_picture_is_the_depth_in_grey_with_16_mm_a_shade():
    _, picture = pictured(a_frame(None, np.full((240, 640), 1600, np.uint16)), a_sight(is_found=False, state=LOST))
    assert picture.shape == (120, 320, 3)
    assert (picture == 100).all()
    _, far = pictured(a_frame(None, np.full((240, 640), 9000, np.uint16)), a_sight(is_found=False, state=LOST))
    assert (far == 255).all()

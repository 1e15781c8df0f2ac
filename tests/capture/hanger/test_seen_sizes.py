"""The rig's value that a recording contradicts, with marker sizes in metres computed by hand.

A side of 24 px at 0.72 m and a focal length of 288 px is 24 * 0.72 / 288 = 0.06 m; 80 px between the centres are 0.2 m.
"""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from capture.hanger.seen_sizes import _depth_within, _placed, sizes_seen, wrong_size, wrong_unit
from capture.sensor_check import markers_visible
from firmware_host.doctor.checks import Verdict
from tests.capture.test_sensor_check import drawn, examined, rig

DEPTH = np.full((240, 320), 720, np.uint16)


def stated(focal=288.0, **sizes):
    """A rig of two markers of 6 cm that are 20 cm apart, or of others."""
    whole = rig(0, 1)
    hanger = msgspec.structs.replace(whole.hanger, **{"marker_distance_m": 0.2, **sizes})
    return msgspec.structs.replace(
        whole, hanger=hanger, sensor=msgspec.structs.replace(whole.sensor, fx=focal, fy=focal)
    )


def test_markers_are_measured_by_depth_and_not_by_what_the_rig_says():
    """A corner is found to half a pixel: 0.5 * 0.72 / 288 = 1.25 mm."""
    for told in (stated(), stated(marker_size_m=0.006, marker_distance_m=3.0)):
        assert sizes_seen(drawn(0, 1), DEPTH, told) == pytest.approx((0.06, 0.2), abs=2.5e-3)


@pytest.mark.parametrize(
    ("told", "says"),
    [
        (stated(), ""),
        (stated(marker_distance_m=0.215), ""),
        (stated(marker_distance_m=0.24), ": measure hanger.marker_distance_m again"),
        (stated(marker_distance_m=2.0), ": measure hanger.marker_distance_m again"),
        (stated(marker_size_m=0.03), ": measure hanger.marker_size_m again"),
        (stated(focal=576.0), ": sensor.fx and fy are 576, and about 288 would fit"),
    ],
)
def test_the_number_that_depth_contradicts_is_named_by_record_and_by_the_doctor(told, says):
    words = wrong_size(told.hanger, told.sensor, sizes_seen(drawn(0, 1), DEPTH, told))
    assert words.endswith(says)
    assert bool(words) == bool(says)
    examination = examined(drawn(0, 1), rig=told)
    examination.sample.frames[0].depth[:] = DEPTH
    finding = markers_visible(examination)
    assert finding.verdict == (Verdict.PROBLEM if says else Verdict.OK)
    assert finding.text.endswith(f"of other sizes than the rig's; {words}" if says else "of 1 frames")


def test_a_wrong_length_is_named_with_both_that_depth_shows():
    """Of 60 mm and 200 mm; within a tenth of either nothing is wrong, and within a tenth of each other fx is."""

    def told(size, distance):
        return wrong_size(stated().hanger, stated().sensor, (size, distance))

    shown = "depth shows markers of 60 mm that are 250 mm apart"
    assert told(0.0604, 0.2496) == f"{shown}: measure hanger.marker_distance_m again"
    assert told(0.08, 0.2) == "depth shows markers of 80 mm that are 200 mm apart: measure hanger.marker_size_m again"
    assert told(0.0655, 0.181) == told(0.0545, 0.219) == ""
    assert told(0.0665, 0.2).endswith("marker_size_m again")
    assert told(0.06, 0.179).endswith("marker_distance_m again")
    both = "depth shows markers of 90 mm that are 300 mm apart: sensor.fx and fy are 288, and about 432 would fit"
    assert told(0.09, 0.3) == both
    assert told(0.09 * 1.09, 0.3).endswith("would fit")
    assert told(0.09 * 0.91, 0.3).endswith("would fit")
    assert told(0.09 * 1.11, 0.3).endswith("marker_size_m again")
    assert told(0.09 * 0.89, 0.3).endswith("marker_distance_m again")


def test_depth_of_a_marker_is_the_median_in_its_box_inside_the_picture():
    """From the corners' floors to the pixel after their ends: columns 2 to 5 and rows 3 to 6."""
    quad = np.array([[2.6, 3.2], [4.9, 3.2], [4.9, 5.8], [2.6, 5.8]])
    depth = np.full((12, 10), 9000, np.uint16)
    depth[3:6, 2:5] = 700
    assert _depth_within(quad, depth) == 0.7
    depth[3:6, 2:5] = [[600, 700, 800], [0, 0, 0], [0, 300, 400]]
    assert _depth_within(quad, depth) == 0.65
    assert _depth_within(quad, depth, nearest=0.0) == 0.6
    assert np.isnan(_depth_within(quad, np.zeros_like(depth)))
    depth[:] = 500
    depth[:2, :3] = 800
    assert _depth_within(quad - [4.0, 5.0], depth) == 0.8


def test_corners_are_placed_at_one_depth_with_each_axis_its_own_focal_length():
    sensor = msgspec.structs.replace(stated().sensor, fx=200.0, fy=400.0, cx=100.0, cy=50.0)
    places = _placed(np.array([[300.0, 50.0], [100.0, 150.0]]), 2.0, sensor)
    assert places == pytest.approx(np.array([[2.0, 0.0, 2.0], [0.0, 0.5, 2.0]]))


def test_nothing_is_measured_without_both_markers_or_their_depth():
    assert sizes_seen(drawn(0), DEPTH, stated()) is None
    assert sizes_seen(drawn(0, 1), np.ones_like(DEPTH), stated()) is None
    assert sizes_seen(drawn(0, 1), DEPTH[:120], stated()) is None
    dots = msgspec.structs.replace(stated(), hanger=msgspec.structs.replace(stated().hanger, marker="dot"))
    assert sizes_seen(drawn(0, 1), DEPTH, dots) is None


@pytest.mark.parametrize(
    ("depth", "unit"),
    [(1, "metres"), (7, "decimetres"), (72, "centimetres"), (7200, "tenths of a millimetre"),
     (6800, "tenths of a millimetre"), (720, ""), (650, ""), (1440, ""), (0, ""), (28, "inches"),
     (90, "units of 8 mm, as after three bits too many of a Kinect's player were cut off"),
     (85, "units of 8 mm, as after three bits too many of a Kinect's player were cut off"), (76, "centimetres"),
     (5760, "eighths of a millimetre, above the three bits of a Kinect's player")],
)  # fmt: skip
def test_depth_in_another_unit_than_millimetres_is_named_by_the_size_of_the_markers(depth, unit):
    """They are 720 mm away by their size."""
    words = wrong_unit(drawn(0, 1), np.full_like(DEPTH, depth), stated())
    assert words.startswith(f"depth at the markers is {depth} mm, and by their size they are 7" if unit else "")
    assert words.endswith(f"mm away: depth is probably in {unit}; record it in millimetres" if unit else "")
    assert bool(words) == bool(unit)
    examination = examined(drawn(0, 1), rig=stated())
    examination.sample.frames[0].depth[:] = depth
    assert not unit or markers_visible(examination).text.endswith(f"of other sizes than the rig's; {words}")


@pytest.mark.parametrize(
    ("metres", "whole"), [(1.2, 1), (1.645, 1), (1.645, 2), (1.99, 1), (2.4, 2)], ids=str,
)  # fmt: skip
def test_whole_metres_are_named_whether_they_were_cut_off_or_rounded(metres, whole):
    """Sizes of the rig times `metres` / 0.72 put the same picture at `metres`."""
    share = metres / 0.72
    told = wrong_unit(
        drawn(0, 1), np.full_like(DEPTH, whole), stated(marker_size_m=0.06 * share, marker_distance_m=0.2 * share)
    )
    assert told.endswith("depth is probably in metres; record it in millimetres")


def test_no_focal_length_is_named_that_no_sensor_has():
    """At 12 times the depth, 3456 px would let 320 pixels span 5.3 degrees; at half of it, 576 px 31 degrees."""
    hanger, sensor = stated().hanger, stated().sensor
    sizes = hanger.marker_size_m, hanger.marker_distance_m
    told = wrong_size(hanger, sensor, tuple(12.0 * size for size in sizes))
    assert told.endswith("apart: depth is 12 times what the rig's sizes say; record depth in millimetres")
    assert wrong_size(hanger, sensor, tuple(2.0 * size for size in sizes)).endswith("and about 576 would fit")


def test_depth_at_the_end_of_its_bits_is_no_distance_and_a_wrong_length_of_the_rig_no_unit():
    told = wrong_unit(drawn(0, 1), np.full_like(DEPTH, 65535), stated())
    assert told == "depth at the markers is 65535, the end of its 16 bits and no distance; record depth in millimetres"
    assert wrong_unit(drawn(0, 1), DEPTH, stated(marker_size_m=0.006)) == ""
    assert wrong_unit(drawn(0), np.full_like(DEPTH, 72), stated()) == ""


def test_depth_at_the_nearest_distance_is_no_distance():
    """Sensors write small values where they measure nothing: 300 mm is left out and 301 mm counts."""
    depth = np.full_like(DEPTH, 300)
    assert sizes_seen(drawn(0, 1), depth, stated()) is None
    depth[::2] = 301
    assert sizes_seen(drawn(0, 1), depth, stated())[0] == pytest.approx(24 * 0.301 / 288, rel=0.05)

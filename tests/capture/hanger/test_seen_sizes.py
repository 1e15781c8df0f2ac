"""The rig's value that a recording contradicts, with marker sizes in metres computed by hand.

A side of 24 px at 0.72 m and a focal length of 288 px is 24 * 0.72 / 288 = 0.06 m; 80 px between the centres are 0.2 m.
"""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from capture.hanger.seen_sizes import sizes_seen, wrong_size, wrong_unit
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


def test_nothing_is_measured_without_both_markers_or_their_depth():
    assert sizes_seen(drawn(0), DEPTH, stated()) is None
    assert sizes_seen(drawn(0, 1), np.ones_like(DEPTH), stated()) is None
    assert sizes_seen(drawn(0, 1), DEPTH[:120], stated()) is None
    dots = msgspec.structs.replace(stated(), hanger=msgspec.structs.replace(stated().hanger, marker="dot"))
    assert sizes_seen(drawn(0, 1), DEPTH, dots) is None


@pytest.mark.parametrize(
    ("depth", "unit"),
    [(1, "metres"), (7, "decimetres"), (72, "centimetres"), (7200, "tenths of a millimetre"), (720, ""), (650, ""),
     (1440, "")],
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

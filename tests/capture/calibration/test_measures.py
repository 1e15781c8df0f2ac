"""The closed forms of a calibration, worked by hand."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from capture.calibration.accelerometer import ZERO_SD, gravity_of_readings
from capture.calibration.depth_offset import plate_offset
from capture.calibration.frames import StillFrames, StillRun, watch
from capture.calibration.measures import (
    Estimate,
    depth_scale,
    gravity_of_plumb_line,
    held_ends_seen,
    mean_offset,
    median_of_frames,
    place_of_frames,
)
from capture.calibration.report import lines
from capture.calibration.session import Measured
from capture.errors import CalibrationError
from capture.hanger.marker_plates import MARKER_CENTRE_SD, PlatePlacer
from firmware_host.usb_control.kinect_motor import MotorState
from formats.rig import Hanger, Rig, Sensor
from tests.capture.stage import StageSensor

CAMERA = Sensor(width=640, height=480, fx=500.0, fy=400.0, cx=319.5, cy=239.5)
RIG = Rig(format="hangtime-rig/1", name="bench", gravity=(0.0, 1.0, 0.0))


def test_the_deviation_of_a_median_by_hand():
    """-1, 3, -2, 1, 0: median 0, median distance 1; lag products -3 - 6 - 2 + 0 < 0 count as none.

    sqrt(pi / 2 / 5) 1.4826 = 0.831.
    """
    found = median_of_frames(np.array([-1.0, 3.0, -2.0, 1.0, 0.0]))
    assert float(found.value) == 0.0
    assert float(found.sd) == pytest.approx(1.4826 * math.sqrt(0.5 * math.pi / 5))


def test_values_that_follow_one_another_count_as_fewer():
    """-3 to 3: squares 28, lag products 6 + 2 + 0 + 0 + 2 + 6 = 16: r = 4/7, 7 (3/7) / (11/7) = 1.909."""
    found = median_of_frames(np.arange(-3.0, 4.0))
    assert float(found.sd) == pytest.approx(1.4826 * 2 * math.sqrt(0.5 * math.pi * 11 / 21))
    # One that hardly changes at all is never less than one value.
    drifting = median_of_frames(np.repeat([-1.0, 1.0], 60))
    assert float(drifting.sd) == pytest.approx(1.4826 * math.sqrt(0.5 * math.pi / (120 * 0.05 / 1.95)))
    assert float(median_of_frames(np.array([-1.0, -1.0, -1.0, 1.0, 1.0])).sd) == 0.0
    short = median_of_frames(np.array([0.0, 0.0, 2.0, 2.0]))  # r = 0.25, 4 / (5/3) = 2.4
    assert float(short.sd) == pytest.approx(1.4826 * math.sqrt(0.5 * math.pi / 2.4))


def test_medians_are_taken_of_each_value_and_of_the_frames_that_show_it():
    values = np.array([[[1.0, np.nan]], [[2.0, np.nan]], [[np.nan, 7.0]], [[3.0, np.nan]]])
    found = median_of_frames(values)
    assert found.value.shape == found.sd.shape == (1, 2)
    assert found.value[0, 0] == 2.0
    assert np.isnan([found.value[0, 1], found.sd[0, 1]]).all()
    assert float(median_of_frames(np.array([4.0, 4.0])).sd) == 0.0


def test_the_position_of_a_marker_keeps_what_averaging_does_not_remove():
    """At 2 m a step is 4 / (0.6 x 500) = 13.3 mm, by sqrt 12 3.85 mm; x and y get their share along the ray."""
    found = place_of_frames(np.tile([0.5, -1.0, 2.0], (9, 1)), CAMERA)
    assert found.value.tolist() == [0.5, -1.0, 2.0]
    rounding = 4.0 / 300.0 / math.sqrt(12.0)
    across = [2.0 * MARKER_CENTRE_SD / 500.0, 2.0 * MARKER_CENTRE_SD / 400.0]
    expected = [math.hypot(across[0], 0.25 * rounding), math.hypot(across[1], 0.5 * rounding), rounding]
    assert found.sd == pytest.approx(expected)
    noisy = place_of_frames(np.array([0.5, -1.0, 2.0]) + np.array([-1, 3, -2, 1, 0.0])[:, None] * 1e-3, CAMERA)
    scatter = 1.4826e-3 * math.sqrt(0.5 * math.pi / 5)
    assert noisy.sd == pytest.approx(np.hypot(expected, scatter), rel=1e-3)


def test_scatter_of_the_markers_along_a_plumb_line_does_not_turn_it():
    """0.5 m down: sds of 3 and 4 mm across, 100 mm along. (9 + 16 + 0) / 2 + 2 mm^2 over 500 mm."""
    upper = Estimate(np.array([0.0, 0.0, 1.5]), np.array([3e-3, 0.1, 0.0]))
    lower = Estimate(np.array([0.0, 0.5, 1.5]), np.array([0.0, 0.1, 4e-3]))
    gravity = gravity_of_plumb_line(upper, lower)
    assert gravity.value.tolist() == [0.0, 1.0, 0.0]
    assert float(gravity.sd) == pytest.approx(math.sqrt(12.5 + 2.0) / 500.0)


def test_the_scale_takes_the_deviations_along_the_line_and_the_one_of_depth():
    """306 mm for 300, 3 and 4 mm along x: 5 mm; depth 3 and 4 mm at 1.5 m: 306 / 1500 x 5 / 2 = 0.51 mm."""
    left = Estimate(np.array([-0.153, 0.0, 1.4]), np.array([3e-3, 0.5, 3e-3]))
    right = Estimate(np.array([0.153, 0.0, 1.4]), np.array([4e-3, 0.5, 4e-3]))
    scale = depth_scale(left, right, 0.3)
    assert float(scale.value) == pytest.approx(1.02)
    common = 306 / 1400 * 5 / 2
    assert float(scale.sd) == pytest.approx(1.02 * math.sqrt((25 + common**2) / 306**2 + (0.5 / 300) ** 2))


def test_the_mean_depth_of_both_markers_counts():
    """(0.6, 0, 0.8) x 1 m apart at 1 and 1.8 m: along it 0.8 of the depth's 5 mm."""
    sd = np.array([0.0, 0.0, 3e-3]), np.array([0.0, 0.0, 4e-3])
    left, right = Estimate(np.array([0.0, 0.0, 1.0]), sd[0]), Estimate(np.array([0.6, 0.0, 1.8]), sd[1])
    along, common = 0.8 * 5e-3, 1.0 / 1.4 * 5e-3 / 2
    wanted = math.sqrt(along**2 + common**2 + (0.5e-3) ** 2)
    assert float(depth_scale(left, right, 1.0).sd) == pytest.approx(wanted)


def test_held_ends_in_the_hangers_frame_by_hand():
    """The hanger's x is the sensor's z: markers along z, 0.3 m apart, gravity down, so z of the hanger is -x."""
    left = Estimate(np.array([0.1, -0.2, 1.5]), np.array([2e-3, 0.0, 0.0]))
    right = Estimate(np.array([0.1, -0.2, 1.8]), np.array([2e-3, 0.0, 0.0]))
    ends = [Estimate(np.array([0.07, -0.12, 1.65]), np.array([0.0, 0.0, 7e-3])),
            Estimate(np.array([0.1, -0.2, 1.95]), np.zeros(3))]  # fmt: skip
    held = held_ends_seen(left, right, ends, 0.02, RIG)
    # z = x cross y = (0, 0, 1) x (0, 1, 0) = (-1, 0, 0).
    assert held.value == pytest.approx(np.array([[0.0, 0.08, 0.03], [0.3, 0.0, 0.0]]), abs=1e-12)
    turned = 0.02 * math.hypot(0.08, 0.03)
    middle = 0.25 * (4 + 4)  # mm^2 along the sensor's x
    wanted = [[math.sqrt(49 + 1 + (1e3 * turned) ** 2), math.hypot(1, 1e3 * turned),
               math.sqrt(middle + 1 + (1e3 * turned) ** 2)],
              [math.hypot(1, 6.0)] * 2 + [math.sqrt(middle + 1 + 36)]]  # fmt: skip
    assert 1e3 * held.sd == pytest.approx(np.array(wanted))


def test_offsets_are_averaged_along_each_axis_over_the_plates_that_show_it():
    """Cuts of 0.7 mm: 0.35 px at 1 m and 0.175 px at 2 m along u, 0.28 px at 1 m along v."""
    one = Estimate(np.array([1.0, 5.0]), np.array([0.3, 0.4]))
    two = Estimate(np.array([2.0, np.nan]), np.array([0.4, np.nan]))
    offset = mean_offset([one, two], [1.0, 2.0], CAMERA)
    assert offset.value.tolist() == [1.5, 5.0]
    u = math.sqrt(0.35**2 + 0.175**2 + 0.3**2 + 0.4**2) / 2
    assert offset.sd == pytest.approx([u, math.hypot(0.28, 0.4)])
    assert np.isnan([mean_offset([], [], CAMERA).value, mean_offset([], [], CAMERA).sd]).all()


def test_the_accelerometers_noise_counts_by_what_turns_gravity():
    """Four readings that differ by 0.1 g to all sides: 0.0995 of a unit vector, by sqrt 2 about one axis, by sqrt 4."""
    strays = ((0.1, 0.0), (-0.1, 0.0), (0.0, 0.1), (0.0, -0.1))
    readings = [MotorState(acceleration=(9.8 * x, 9.8, 9.8 * z), tilt_degrees=None, motor=0) for x, z in strays]
    gravity = gravity_of_readings(readings)
    assert gravity.value == pytest.approx([0.0, 1.0, 0.0], abs=1e-9)
    stray = 0.1 / math.hypot(1.0, 0.1)
    assert float(gravity.sd) == pytest.approx(math.hypot(stray / math.sqrt(2 * 4), ZERO_SD))


SQUARE = Sensor(width=640, height=480, fx=500.0, fy=500.0, cx=319.5, cy=239.5)


def quad(u, v, side):
    return np.array([u, v]) + 0.5 * side * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])


def plate_image(left, top, right, bottom, behind=2600):
    """A plate at 1.5 m in the columns and rows from left, top to right, bottom, all included."""
    depth = np.full((480, 640), behind, np.uint16)
    depth[top : bottom + 1, left : right + 1] = 1500
    return depth


def offset_of(depth, u=300.0, v=200.0, side=20.0):
    return plate_offset(PlatePlacer(SQUARE, 0.06), quad(u, v, side), depth).tolist()


def test_the_offset_is_the_middle_of_the_plate_less_that_of_the_marker():
    """The plate's columns 290 to 316, rows 185 to 211 have their middle at (303, 198)."""
    assert offset_of(plate_image(290, 185, 316, 211)) == pytest.approx([3.0, -2.0])
    assert offset_of(plate_image(290, 185, 316, 211), 300.25, 200.5) == pytest.approx([2.75, -2.5])


def test_a_missing_pixel_and_a_missing_rim_do_not_move_the_middle():
    depth = plate_image(287, 187, 313, 213, behind=0)
    depth[200, 300] = 0
    assert offset_of(depth) == pytest.approx([0.0, 0.0], abs=0.05)


def test_along_an_axis_on_which_the_plate_goes_on_there_is_no_offset():
    beam = offset_of(plate_image(200, 187, 400, 213))
    assert np.isnan(beam[0])
    assert beam[1] == pytest.approx(0.0)
    post = offset_of(plate_image(287, 100, 313, 300))
    assert post[0] == pytest.approx(0.0)
    assert np.isnan(post[1])
    # Half of the marker's rows are enough for an outline.
    for rows, is_seen in ((10, True), (9, False)):
        depth = plate_image(287, 187, 313, 213)
        depth[187 + rows : 214, 200:400] = 1500
        assert np.isfinite(offset_of(depth)[0]) == is_seen


def test_short_rows_at_the_rim_of_a_plate_do_not_count():
    """A tongue of 10 px to the right above the plate would draw the middle of rows aside; 11 px are half a marker."""
    for width, moves in ((10, False), (11, True)):
        depth = plate_image(287, 187, 313, 213)
        depth[181:187, 304 : 304 + width] = 1500
        assert (abs(offset_of(depth)[0]) > 0.5) == moves


def test_a_plate_without_depth_or_beyond_the_picture_has_no_offset():
    missing = plate_image(287, 187, 313, 213)
    missing[190:211, 290:311] = 0
    assert np.isnan(offset_of(missing)).all()
    assert np.isnan(offset_of(plate_image(287, 187, 313, 213), np.nan)).all()
    whole = np.full((480, 640), 1500, np.uint16)
    for u, v in ((21, 200), (300, 21), (618, 200), (300, 458)):
        assert np.isnan(offset_of(whole, u, v)).all()
    # A plate that is whole in the picture, where what is looked at around it is not.
    for left, top in ((3, 187), (610, 187), (287, 3), (287, 450)):
        assert np.isnan(offset_of(plate_image(left, top, left + 26, top + 26), left + 13.0, top + 13.0)).all()
    assert offset_of(plate_image(9, 187, 35, 213), 22.0) == pytest.approx([0.0, 0.0])
    assert offset_of(plate_image(604, 187, 630, 213), 617.0) == pytest.approx([0.0, 0.0])
    assert offset_of(plate_image(287, 9, 313, 35), 300.0, 22.0) == pytest.approx([0.0, 0.0])
    assert offset_of(plate_image(287, 444, 313, 470), 300.0, 457.0) == pytest.approx([0.0, 0.0])


@pytest.mark.parametrize(("behind", "is_seen"), [(1555, True), (1540, False)])
def test_a_surface_less_than_half_a_marker_behind_belongs_to_the_plate(behind, is_seen):
    """30 mm and four pixel noises of 5.3 mm at 1.5 m: 51 mm."""
    assert np.isfinite(offset_of(plate_image(287, 187, 313, 213, behind))).all() == is_seen


def test_a_marker_is_seen_when_half_of_the_frames_show_it():
    corners = np.zeros((4, 2, 4, 2))
    corners[:2, 0], corners[:3, 1] = np.nan, np.nan
    still = StillFrames(corners, [], 4)
    assert (still.sees(0), still.sees(1)) == (True, False)


@pytest.mark.parametrize("moved", [0, 3])
def test_one_reading_of_a_moved_sensor_is_enough_to_refuse_them(moved):
    readings = [
        MotorState(acceleration=(0.0, 9.8 if k != moved else 14.0, 0.0), tilt_degrees=None, motor=0) for k in range(4)
    ]
    assert [reading.is_still for reading in readings].count(False) == 1
    with pytest.raises(CalibrationError, match="was moved while"):
        gravity_of_readings(readings)


def corners_at(*centres):
    """Two markers of 20 px about their centres, NaN where not found."""
    return np.stack([quad(u, v, 20.0) for u, v in centres])


@pytest.mark.parametrize(("stray", "still"), [(0.69, 4), (0.71, 1)])
@pytest.mark.parametrize("axis", [0, 1])
def test_frames_are_still_in_which_no_marker_scatters_by_seven_tenths_of_a_pixel(stray, still, axis):
    """Of two markers far from each other the second moves aside and back; one that is unseen gives no evidence."""
    run, aside = StillRun(), np.zeros(2)
    aside[axis] = stray
    assert run.add(corners_at((100.0, 50.0), (300.0, 220.0))) == 1
    assert run.add(corners_at((100.0, 50.0), (np.nan, np.nan))) == 2
    assert run.add(corners_at((np.nan, np.nan), (300.0, 220.0))) == 3
    found = run.add(corners_at((100.0, 50.0), (300.0 + aside[0], 220.0 + aside[1])))
    assert found == still
    assert run.add(corners_at((100.0, 50.0), (300.0 + aside[0], 220.0 + aside[1]))) == still + 1


def test_slow_motion_counts_as_still_as_long_as_it_stays_within_the_limit():
    """0.3 px a frame: three frames are within 0.6 px, a fourth is not."""
    run = StillRun()
    assert [run.add(corners_at((100.0 + 0.3 * k, 50.0))) for k in range(5)] == [1, 2, 3, 3, 3]


def test_the_longest_still_part_is_found_between_two_motions():
    """Ten moving, twenty still, ten moving: frames 10 to 29, and up to 0.7 px of the motion beside them."""
    place = np.concatenate([np.arange(10) * 2.0, np.full(20, 30.0), 32 + np.arange(10) * 2.0])
    corners = np.tile(place[:, None, None, None], (1, 1, 4, 2))
    lengths = [1] * 10 + list(range(1, 21)) + [1] * 10
    run = StillRun()
    assert [run.add(frame) for frame in corners] == lengths
    corners[15] = np.nan  # once not found: nothing is known to have moved
    run = StillRun()
    assert [run.add(frame) for frame in corners] == lengths


def test_gravity_of_a_plumb_line_by_hand():
    """0.5 m long, 1 mm each: (1 + 1 + 2) mm^2 under the root over 500 mm are 4 mrad."""
    sd = np.full(3, 1e-3)
    upper, lower = Estimate(np.array([0.0, -0.2, 1.5]), sd), Estimate(np.array([0.0, 0.2, 1.8]), sd)
    gravity = gravity_of_plumb_line(upper, lower)
    assert gravity.value == pytest.approx([0.0, 0.8, 0.6])
    assert float(gravity.sd) == pytest.approx(4e-3)


def test_depth_scale_by_hand():
    """303 mm for 300, level, 2 mm of depth each at 1.6 m: 303 / 1600 * sqrt(8) / 2 = 0.268 mm; with 0.5 mm of ruler."""
    sd = np.array([0.0, 0.0, 2e-3])
    scale = depth_scale(Estimate(np.array([-0.1515, 0, 1.6]), sd), Estimate(np.array([0.1515, 0, 1.6]), sd), 0.3)
    assert float(scale.value) == pytest.approx(1.01)
    assert float(scale.sd) == pytest.approx(1.01 * np.hypot(0.268 / 303, 0.5 / 300), rel=2e-3)


def test_offsets_of_two_plates_are_averaged_with_what_cutting_leaves():
    """0.7 mm at f = 575.8 px and 1.6 m are 0.252 px; of two plates 0.178 px."""
    one, two = (Estimate(np.array([value, np.nan]), np.zeros(2)) for value in (1.0, 2.0))
    offset = mean_offset([one, two], [1.6, 1.6], msgspec.structs.replace(CAMERA, fx=575.8))
    assert offset.value[0] == 1.5
    assert offset.sd[0] == pytest.approx(0.178, abs=1e-3)
    assert np.isnan(offset.value[1])


def test_the_deviation_of_a_median_is_that_of_many_medians():
    """Of 400 medians of 60 normal values each; sqrt(pi / 2 / 60) = 0.162 within the 5 % that 400 leave open twice."""
    values = np.random.default_rng(5).standard_normal((400, 60))
    found = [median_of_frames(row) for row in values]
    assert np.std([float(one.value) for one in found]) == pytest.approx(0.162, rel=0.1)
    assert np.median([float(one.sd) for one in found]) == pytest.approx(0.162, rel=0.2)


class ShownMarkers:
    """A detector of one marker, at the column that the image's first pixel names."""

    ids = (0,)

    def in_picture(self, colour):
        return quad(float(colour[0, 0, 0]), 20.0, 10.0)[None]

    def refined(self, colour, row, corners):
        return corners


def test_frames_before_the_longest_still_period_are_left_out():
    """A marker moves by 10 px a frame for 7 frames, then rests for 16, moves again and rests for 15."""
    columns = [10 * k for k in range(7)] + [100] * 16 + [150, 160] + [200] * 15
    shown = [(np.full((8, 8), k + 1, np.uint16), np.full((8, 8, 3), column)) for k, column in enumerate(columns)]
    still = watch(StageSensor(shown), ShownMarkers(), 5.0)
    assert [int(depth[0, 0]) for depth in still.depth] == list(range(8, 24))
    assert still.corners.mean((1, 2, 3)).tolist() == [60.0] * 16
    assert still.seen == len(columns)


@pytest.mark.parametrize(
    ("value", "is_doubted"), [(1.0, False), (1.02, False), (0.98, False), (1.04, True), (0.96, True)]
)
def test_a_scale_that_is_three_deviations_from_one_is_doubted_on_either_side(value, is_doubted):
    hanger = Hanger(marker_size_m=0.06, marker_distance_m=0.3, ids=(0, 1), held_m=((0.0, 0.1, 0.0), (0.3, 0.1, 0.0)))
    scale = Estimate(np.array(value), np.array(0.01))
    measured = Measured(
        rig=msgspec.structs.replace(RIG, hanger=hanger), frames=20, seen=30, gravity=None, scale=scale, offset=None,
        held=None, distance_m=0.3 * value,
    )  # fmt: skip
    said = next(line for line in lines(measured, RIG) if line.startswith("depth scale"))
    assert f"{value:.4f} +- 0.0100: {300 * value:.1f} mm between the markers, the rig says 300.0" in said
    assert ("measure that distance again" in said) == is_doubted


@pytest.mark.parametrize("missing", ["scale", "hanger"])
def test_a_scale_without_both_markers_or_without_a_hanger_was_not_measured(missing):
    scale = None if missing == "scale" else Estimate(np.array(1.0), np.array(0.01))
    rig = RIG if missing == "scale" else msgspec.structs.replace(RIG, hanger=None)
    measured = Measured(
        rig=rig, frames=20, seen=30, gravity=None, scale=scale, offset=None, held=None, distance_m=0.3
    )  # fmt: skip
    said = next(line for line in lines(measured, RIG) if line.startswith("depth scale"))
    assert "not measured: the hanger's two markers were not seen together; kept as it was" in said

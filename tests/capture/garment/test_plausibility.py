"""Outlier rejection among detections of a point, and the standard deviations."""

from __future__ import annotations

import math

import numpy as np
import pytest

from capture.depth.surface import CorrelationMeter
from capture.garment.plausibility import UNSETTLED_SD, MotionGate
from capture.garment.tracker import SilhouetteTracker
from firmware_host.synthetic.garments import GARMENTS
from firmware_host.synthetic.scene import RIG

SD = np.full((1, 3), 0.002)
PERIOD = 1 / 30


def at(x):
    return np.array([[x, 0.0, 1.6]])


def test_a_point_that_was_never_lost_counts_at_once_and_with_its_own_deviation():
    gate = MotionGate(1)
    for k in range(5):
        valid, sd = gate.admit(at(0.05 * k), SD, k * PERIOD)  # 1.5 m/s
        assert valid.all()
        np.testing.assert_array_equal(sd, SD)


def test_an_outlier_is_refused_and_not_remembered():
    """60 m/s^2 dt^2 are 67 mm a frame; four deviations of 3.5 mm are 14 mm; 100 mm are an outlier."""
    gate = MotionGate(1)
    for k in range(3):
        gate.admit(at(0.0), SD, k * PERIOD)
    assert not gate.admit(at(0.1), SD, 3 * PERIOD)[0].any()
    assert gate.admit(at(0.0), SD, 4 * PERIOD)[0].all()


@pytest.mark.parametrize(("acceleration", "is_believed"), [(55.0, True), (85.0, False)])
def test_an_evenly_accelerated_point_is_followed_up_to_the_hardest_whip(acceleration, is_believed):
    """Its second difference is a dt^2: 61 mm at 55 m/s^2, and 94 at 85; the limit is 67 + 14 mm."""
    gate = MotionGate(1)
    believed = [gate.admit(at(0.5 * acceleration * (k * PERIOD) ** 2), SD, k * PERIOD)[0].all() for k in range(4)]
    assert all(believed) == is_believed


def test_a_point_that_comes_back_counts_from_its_second_sighting_even_when_it_is_fast():
    gate = MotionGate(1)
    gate.admit(at(0.0), SD, 0.0)
    gate.admit(at(np.nan), SD, 0.5 - PERIOD)
    back = [gate.admit(at(0.5 + 5.0 * k * PERIOD), SD, 0.5 + k * PERIOD) for k in range(4)]
    assert [bool(valid[0]) for valid, _ in back] == [False, True, True, True]
    unsettled = float(np.hypot(SD[0, 0], UNSETTLED_SD))
    assert [sd[0, 0] for _, sd in back[1:]] == pytest.approx([unsettled, unsettled, SD[0, 0]])


def test_a_fold_that_looks_like_a_corner_for_one_frame_is_never_accepted():
    gate = MotionGate(1)
    gate.admit(at(0.0), SD, 0.0)
    gate.admit(at(np.nan), SD, 0.5 - PERIOD)
    assert not gate.admit(at(0.3), SD, 0.5)[0].any()
    assert not gate.admit(at(np.nan), SD, 0.5 + PERIOD)[0].any()
    assert not gate.admit(at(0.0), SD, 0.5 + 2 * PERIOD)[0].any()
    assert gate.admit(at(0.0), SD, 0.5 + 3 * PERIOD)[0].all()


def test_ten_frames_a_second_are_followed_as_well():
    gate = MotionGate(1)
    assert all(gate.admit(at(0.02 * k), SD, 0.1 * k)[0].all() for k in range(5))


def test_a_point_that_is_first_seen_in_the_third_frame_counts_with_its_own_deviation():
    gate = MotionGate(1)
    for k in range(2):
        gate.admit(at(np.nan), SD, k * PERIOD)
    valid, sd = gate.admit(at(0.0), SD, 2 * PERIOD)
    assert valid.all()
    np.testing.assert_array_equal(sd, SD)


@pytest.mark.parametrize(("leap", "is_believed"), [(0.0795, True), (0.0815, False)])
def test_a_point_leaps_by_four_deviations_more_than_the_hardest_whip_allows(leap, is_believed):
    """60 m/s^2 dt^2 are 66.7 mm, and four deviations of 3.46 mm are 13.9."""
    gate = MotionGate(1)
    for k in range(3):
        gate.admit(at(0.0), SD, k * PERIOD)
    assert gate.admit(at(leap), SD, 3 * PERIOD)[0].all() == is_believed


def test_a_point_that_was_seen_once_gives_no_other_point_its_freedom():
    """The second point is seen for the first time where the first leaps, or is lost; it has no speed yet."""
    two, sd = MotionGate(2), np.repeat(SD, 2, axis=0)
    for k in range(3):
        two.admit(np.vstack([at(0.0), at(np.nan)]), sd, k * PERIOD)
    two.admit(np.vstack([at(np.nan), at(1.0)]), sd, 3 * PERIOD)
    assert two.admit(np.vstack([at(0.0), at(np.nan)]), sd, 4 * PERIOD)[0].tolist() == [True, False]
    two = MotionGate(2)
    for k in range(3):
        two.admit(np.vstack([at(0.0), at(1.0 if k == 2 else np.nan)]), sd, k * PERIOD)
    assert two.admit(np.vstack([at(0.15), at(1.0)]), sd, 3 * PERIOD)[0].tolist() == [False, True]


def test_the_centre_has_a_share_of_a_wrong_corners_error():
    """Of 10 mm in the first detections after a gap, 3.54 mm in a panel's diagonals; the tracker asks for that.

    The corner itself is wrong in depth, and across the view by 0.4 of it.
    """
    gate, sd = MotionGate(2, np.array([[0.4, 0.4, 1.0], [1 / (4 * math.cos(math.pi / 4))] * 3])), np.full((2, 3), 1e-6)
    places, gone = np.tile([0.0, 0.0, 1.6], (2, 1)), np.full((2, 3), np.nan)
    for k, shown in enumerate((places, places, gone, places)):
        found = gate.admit(shown, sd, k / 30)[1]
    assert found == pytest.approx(np.array([[0.004, 0.004, 0.010], [0.00354] * 3]), abs=1e-5)
    made = SilhouetteTracker(GARMENTS["swatch"](), RIG, CorrelationMeter())
    assert made._gate._unsettled == pytest.approx(np.array([[0.004, 0.004, 0.010]] * 4 + [[0.00354] * 3]), abs=1e-5)

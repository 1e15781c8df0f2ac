"""The errors and notes for an arm trajectory that is elsewhere or on another clock, and the accuracy of the offset."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from formats.errors import TakeError
from formats.importers.arm_path import (
    LONGEST_POSE_STEP,
    WHILE,
    ArmPath,
    check_arm_path,
    check_clock,
    path_beside,
    read_arm_path,
)
from formats.importers.clock_shift import _median, find_clock_shift
from tests.formats.test_clocks_by_hand import an_arm
from tests.formats.test_two_clocks import circling, recorded, swept, swept_arm

GIVE = "give a .npz with tcp_t, tcp_pose and tcp_to_corner_m, see docs/reference/file-formats.md"
UNITS = {"millimetres": 1e3, "centimetres": 1e2, "inches": 1 / 0.0254}
SECONDS = "Give seconds: divide milliseconds by 1e3, nanoseconds by 1e9, frame numbers by the frame rate"


def refused(check, *given):
    with pytest.raises(TakeError) as error:
        check(*given)
    return str(error.value)


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize(
    ("parts", "words"),
    [
        (("place",), "the places of 'tcp_pose'"), (("tool",), "'tcp_to_corner_m'"),
        (("place", "tool"), "'tcp_pose' and 'tcp_to_corner_m'"),
    ],
)  # fmt: skip
def test_a_path_in_another_unit_is_refused_with_the_unit_and_the_array(tmp_path, unit, parts, words):
    arm, time, corners = an_arm(tmp_path)
    wrong = replace(arm, **{name: UNITS[unit] * getattr(arm, name) for name in parts})
    said = refused(check_arm_path, wrong, time[:60:6], corners[:60:6])
    assert re.fullmatch(
        rf"{tmp_path}/arm\.npz: its held corners are \d[\d.e+]* m from those of the recording's pictures, in the "
        rf"median and at any shift up to 0\.5 s; give {words} in metres: the values seem to be {unit}", said,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("change", "advice"),
    [
        (lambda arm: {"turn": arm.turn[:, [3, 0, 1, 2]]},
         "give the quaternions as x y z w: the file's order seems to be w x y z"),
        (lambda arm: {"turn": arm.turn * [-1, -1, -1, 1]},
         "give rotations from the tool's frame: the file seems to hold their inverses"),
        (lambda arm: {"place": arm.place + 0.5},
         "give the path of the same take, in metres, in the frame of its points, on a clock of the same zero"),
    ],
)  # fmt: skip
def test_a_path_in_another_order_or_position_is_refused_with_what_to_give(tmp_path, change, advice):
    arm, time, corners = an_arm(tmp_path)
    said = refused(check_arm_path, replace(arm, **change(arm)), time[:60:6], corners[:60:6])
    assert said.endswith(f" up to 0.5 s; {advice}")


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"tcp_t": np.zeros(96)}, "its time does not increase from pose to pose; mend 'tcp_t'"),
        ({"tcp_pose": np.zeros((96, 6))},
         f"the array 'tcp_pose' has shape (96, 6) of numbers, not (96, 7) of real numbers; {GIVE}"),
        ({"tcp_t": np.full(96, "x")}, f"the array 'tcp_t' has shape (96,) of text, not (96,) of real numbers; {GIVE}"),
        ({"tcp_pose": np.ones((96, 7))}, "a rotation in 'tcp_pose' is no unit quaternion x y z w; export it again"),
        ({"tcp_to_corner_m": np.full((2, 3), np.nan)},
         "the array 'tcp_to_corner_m' holds a value that is not finite; export it again"),
        ({"tcp_to_corner_m": np.full((2, 3), -1001)}, "a place lies 1001 m away; give metres, at most 1000"),
        ({"tcp_t": np.arange(96) * 30.0},
         f"its frames are 30 s apart in the median; are these milliseconds? {SECONDS}"),
        ({"tcp_t": np.arange(1) * 1.0, "tcp_pose": np.array([[0, 0, 0, 0, 0, 0, 1.0]])},
         "its time does not increase from pose to pose; mend 'tcp_t'"),
    ],
)  # fmt: skip
def test_a_file_that_is_no_path_is_refused_with_what_is_wrong_in_it(tmp_path, changes, sentence):
    recorded(tmp_path, **changes)
    assert refused(read_arm_path, tmp_path / "arm/a.npz") == f"{tmp_path}/arm/a.npz: {sentence}"


@pytest.mark.parametrize("length", [0.991, 1.0, 1.009])
def test_quaternions_that_were_printed_with_two_decimals_turn_as_unit_ones_do(tmp_path, length):
    recorded(tmp_path, tcp_pose=np.tile([0.0, 0, 0, 0, 0, 0, length], (96, 1)))
    arm = read_arm_path(tmp_path / "arm/a.npz")
    np.testing.assert_allclose(arm.turn, [[0, 0, 0, 1]] * 96)
    np.testing.assert_allclose(arm.held, np.tile(arm.tool, (96, 1, 1)))


def test_the_path_for_a_recording_is_the_file_or_that_of_its_name_in_a_folder(tmp_path):
    assert path_beside(tmp_path, Path("elsewhere/a.npz")) == tmp_path / "a.npz"
    assert path_beside(tmp_path / "b.npz", Path("elsewhere/a.npz")) == tmp_path / "b.npz"


def test_a_path_is_unknown_in_holes_and_beyond_its_ends():
    time = np.array([0.0, 0.1, 0.1 + LONGEST_POSE_STEP - 1e-9, 0.8, 0.9])
    arm = ArmPath(Path("a"), time, np.zeros((5, 1, 3)), np.tile([0.0, 0, 0, 1], (5, 1)), np.ones((2, 3)))
    found = np.isfinite(arm.at(np.array([-0.01, 0.0, 0.05, 0.2, 0.5, 0.79, 0.85, 0.9, 0.91]))).all((1, 2))
    assert found.tolist() == [False, True, True, True, False, False, True, True, False]


@pytest.mark.parametrize(
    ("shift", "words"),
    [
        (0.12, r"its clock is 0\.12 s ahead of the recording's, with a standard error of 0\.00\d s; subtract 0\.12 s "
         "from 'tcp_t', or leave the shift to fit and diagnosis"),
        (-0.12, r"its clock is 0\.12 s behind the recording's, with a standard error of 0\.00\d s; add 0\.12 s to "
         "'tcp_t', or leave the shift to fit and diagnosis"),
        (0.0, ""),
    ],
)  # fmt: skip
def test_a_small_shift_is_reported_with_its_error_and_what_to_do(shift, words):
    time = np.arange(0, 10, 0.11)
    seen = swept(time) + np.random.default_rng(1).normal(0, 0.01, (len(time), 2, 3))
    assert re.fullmatch(words, check_arm_path(swept_arm(shift=shift), time, seen))
    assert re.fullmatch(words, check_clock(swept_arm(shift=shift), time, seen[:, ::-1]))


def test_an_error_that_is_too_small_to_be_shown_is_below_a_millisecond():
    time = np.arange(0, 10, 0.11)
    told = check_clock(swept_arm(shift=0.3), time, swept(time))
    assert told.startswith(
        "its clock is 0.30 s ahead of the recording's, with a standard error below 0.001 s; subtract"
    )


def test_larger_shifts_that_are_as_good_are_reported_two_at_most():
    """A circle in 0.8 s is as near after each round."""
    time = np.arange(0, 20, 0.11)
    told = check_clock(swept_arm(circling(0.8), 0.2, 30), time, circling(0.8)(time))
    assert "0.20 s ahead of the recording's (or 0.60 s behind or 1.00 s ahead: the motion repeats itself), with" in told


def test_a_large_shift_is_refused_with_how_near_the_path_is_there_and_here():
    time = np.arange(0, 10, 0.11)
    seen = swept(time) + np.random.default_rng(1).normal(0, 0.01, (len(time), 2, 3))
    said = refused(check_arm_path, swept_arm(shift=2.0), time, seen)
    assert re.fullmatch(
        r"arm\.npz: its clock is 2\.00 s ahead of the recording's: its held corners are 1\d mm from those of the "
        r"pictures at that shift, \d\d mm at any up to 0\.5 s; subtract 2\.00 s from 'tcp_t'", said,
    )  # fmt: skip
    alone = refused(check_clock, swept_arm(shift=2.0), time, seen)
    assert alone == "arm.npz: its clock is 2.00 s ahead of the recording's; subtract 2.00 s from 'tcp_t'"


def test_the_error_of_a_shift_is_the_jackknife_over_half_seconds():
    """Each half second is left out once; the errors and speeds of the rest are about their own means."""
    time, arm = np.arange(0, 10, 0.11), swept_arm(shift=0.3)
    seen = swept(time) + np.random.default_rng(3).normal(0, 0.003, (len(time), 2, 3))
    seen[time > 8.0, 1] = np.nan
    found = find_clock_shift(time, seen, arm.at)
    left = seen - arm.at(time + found.seconds)
    speed = (arm.at(time + found.seconds + 0.02) - arm.at(time + found.seconds - 0.02)) / 0.04
    speed[np.isnan(left)] = np.nan
    block = time // 0.5
    shifts = []
    for one in np.unique(block):
        errors, moves = (part[block != one] - np.nanmean(part[block != one], axis=0) for part in (left, speed))
        shifts.append(np.nansum(errors * moves) / np.nansum(moves**2))
    count = len(shifts)
    assert found.error == pytest.approx(
        np.sqrt((count - 1) / count * np.sum((shifts - np.mean(shifts)) ** 2)), rel=0.02
    )
    assert found.seconds == pytest.approx(0.3, abs=4 * found.error)


def test_a_median_of_rows_is_that_of_what_is_a_number():
    rows = np.array([[5.0, 1, 3, np.nan], [4, 2, np.nan, np.nan], [7, np.nan, np.nan, np.nan], [8, 6, 4, 1]])
    assert _median(rows, 1)[:, 0].tolist() == [3, 3, 7, 5]
    assert _median(rows.T, 0)[0].tolist() == [3, 3, 7, 5]
    assert np.isnan(_median(np.full((1, 3), np.nan), 1)).all()


def test_a_path_of_fewer_pictures_than_a_while_may_leave_the_corners(tmp_path):
    """A second of the pictures is nine of them; the path is elsewhere in three of eight, and in ten of thirty."""
    arm, time, corners = an_arm(tmp_path)
    few, many = slice(0, WHILE - 1), slice(0, 30)
    aside = corners.copy()
    aside[:3] += 0.5
    check_arm_path(arm, time[few], aside[few])
    aside[3 : WHILE + 1] += 0.5
    said = refused(check_arm_path, arm, time[many], aside[many])
    assert re.fullmatch(
        rf"{tmp_path}/arm\.npz: its held corners leave those of the recording's pictures: both are 0\.8\d* m apart "
        r"from 0\.0 to 0\.3 s; give the path of the whole take, or cut both files before that", said,
    )  # fmt: skip

"""Takes of two clocks, arms, pictures in letters and facings, each of numbers that are chosen."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from formats.errors import TakeError
from formats.importers.arm_path import FARTHEST_ARM, ArmPath, _apart, _turned, check_arm_path
from formats.importers.swatch_mocap import DOWNWARD, facing
from formats.importers.swung_cloth import _is_crossed, _line, _names
from formats.summary import _rate, describe, summarise
from formats.take import FrameState
from formats.take_picture import draw_in_letters, draw_png, paths_of, stretches
from formats.two_clocks import _nearest, at_times, shows_hanger, shows_points, with_hanger
from tests.formats.test_archive import a_take
from tests.formats.test_motion import moved


@pytest.mark.parametrize(
    ("instant", "place"), [(-9.0, 0), (0.0, 0), (0.5, 0), (0.51, 1), (2.4, 1), (2.6, 2), (4.0, 2), (99.0, 2)]
)
def test_the_nearest_of_increasing_times_is_the_earlier_one_where_two_are_as_near(instant, place):
    assert _nearest(np.array([0.0, 1.0, 4.0]), np.array([instant])).tolist() == [place]


def test_ends_between_two_sights_lie_on_a_straight_line_and_beyond_them_nowhere():
    time = np.array([0.0, 1.0, 3.0])
    held = np.zeros((3, 2, 3))
    held[:, 0, 0], held[:, 1, 2] = [0.0, 1.0, 5.0], [2.0, 0.0, 4.0]
    found = at_times(np.array([-0.1, 0.0, 0.5, 2.0, 3.0, 3.1]), time, held)
    assert np.isnan(found[[0, 5]]).all()
    assert found[1:5, 0, 0] == pytest.approx([0.0, 0.5, 3.0, 5.0])
    assert found[1:5, 1, 2] == pytest.approx([2.0, 1.0, 2.0, 4.0])
    assert not found[1:5, 0, 1:].any()


def two_clocks():
    """Pictures at 0, 0.1, 0.2 s, and the hanger at -0.05, 0.0009, 0.1011 and 0.3 s."""
    take = a_take(frames=3)
    take = replace(take, time=np.array([0.0, 0.1, 0.2]), points=np.arange(36.0).reshape(3, 4, 3) + 1,
                   points_valid=np.ones((3, 4), bool), state=np.array([0, 1, 0], np.uint16),
                   points_hidden=np.ones((3, 4), bool), quality=np.array([0.5, 0.6, 0.7]))  # fmt: skip
    held = np.arange(24.0).reshape(4, 2, 3)
    return take, held, with_hanger(take, np.array([-0.05, 0.0009, 0.1011, 0.3]), held, 0.004)


def test_frames_are_the_moments_of_both_clocks():
    """A sight within a millisecond of a picture shares its frame, at the picture's time."""
    take, held, both = two_clocks()
    assert both.time.tolist() == [-0.05, 0.0, 0.1, 0.1011, 0.2, 0.3]
    assert shows_points(both).tolist() == [False, True, True, False, True, False]
    assert shows_hanger(both).tolist() == [True, True, False, True, False, True]
    assert (both.held[[0, 1, 3, 5]] == held).all()
    assert np.isnan(both.held[[2, 4]]).all()
    assert both.held_valid.tolist() == [[seen] * 2 for seen in (True, True, False, True, False, True)]
    assert (both.held_sd == 0.004).all()
    assert np.array_equal(both.markers, both.held, equal_nan=True)
    for part in ("points", "points_valid", "points_sd", "state", "points_hidden", "quality"):
        assert getattr(both, part).dtype == getattr(take, part).dtype, part
    assert (both.points[[1, 2, 4]] == take.points).all()
    assert np.isnan(both.points[[0, 3, 5]]).all()
    assert both.points_valid.any(1).tolist() == [False, True, True, False, True, False]
    assert both.points_hidden.any(1).tolist() == [False, True, True, False, True, False]
    assert both.quality == pytest.approx([np.nan, 0.5, 0.6, np.nan, 0.7, np.nan], nan_ok=True)
    assert np.isnan(both.points_sd[0]).all()
    assert both.state[2] == 1 | FrameState.POINTS_ALONE
    assert both.state[1] == 0
    assert both.state[0] == FrameState.HANGER_ALONE
    bare = with_hanger(replace(take, points_hidden=None, quality=None), np.array([0.0, 0.5]), held[:2], 0.004)
    assert (bare.points_hidden, bare.quality) == (None, None)


def turn(axis, degrees):
    half = np.radians(degrees) / 2
    return np.append(np.sin(half) * np.asarray(axis, float), np.cos(half))


def test_positions_turn_about_their_axes_by_the_right_hand():
    found = _turned(np.array([[1.0, 2, 3]]), np.stack([turn([0, 0, 1], 90), turn([1, 0, 0], 180), turn([0, 1, 0], 0)]))
    assert found[:, 0] == pytest.approx(np.array([[-2, 1, 3], [1, -2, -3], [1, 2, 3]]))


def an_arm(tmp_path, shift=0.0):
    """A tool that swings by 0.2 m along x and turns by up to 60 degrees, and its corners at 30 pictures a second."""
    time = np.arange(0, 4, 0.02)

    def poses(instants):
        place = np.stack([0.2 * np.sin(3 * instants), 0 * instants, 1 + 0 * instants], 1)[:, None]
        turns = np.stack([turn([0, 0, 1], 60 * np.sin(2 * t)) for t in instants])
        return place, turns

    tool = np.array([[-0.2, 0.3, 0.0], [0.2, 0.3, 0.1]])
    arm = ArmPath(tmp_path / "arm.npz", time, *poses(time), tool)
    pictures = np.arange(0.6, 3.4, 1 / 30)
    place, turns = poses(pictures + shift)
    return arm, pictures, place + _turned(tool, turns)


@pytest.mark.parametrize("shift", [0.0, 0.4, -0.4])
def test_a_path_on_a_late_clock_is_near_at_some_shift_and_in_either_order(tmp_path, shift):
    arm, time, corners = an_arm(tmp_path, shift)
    assert np.nanmedian(_apart(arm, time, corners)) < 2e-3
    assert np.nanmedian(_apart(arm, time, corners[:, ::-1])) < 2e-3
    assert not np.isfinite(_apart(arm, time + 100.0, corners)).any()
    check_arm_path(arm, time, corners)
    check_arm_path(arm, time, np.full_like(corners, np.nan))


def test_a_path_is_near_by_the_median_of_what_was_seen(tmp_path):
    arm, time, corners = an_arm(tmp_path)
    aside = corners + np.array([0.0, 0.0, 0.9 * FARTHEST_ARM])
    aside[::3] = np.nan
    aside[1::12] += 5.0
    check_arm_path(arm, time, aside)
    with pytest.raises(TakeError, match=r"are 0\.03\d* m from those of the recording's pictures.*of the same take"):
        check_arm_path(arm, time, corners + np.array([0.0, 0.0, 1.1 * FARTHEST_ARM]))


@pytest.mark.parametrize(
    ("change", "advice"),
    [
        (lambda arm: {"place": 1e3 * arm.place}, "places of 'tcp_pose' in metres: the values seem"),
        (lambda arm: {"place": 1e3 * arm.place, "tool": 1e3 * arm.tool}, "'tcp_pose' and 'tcp_to_corner_m' in metres"),
        (lambda arm: {"turn": arm.turn[:, [3, 0, 1, 2]]}, "order seems to be w x y z"),
        (lambda arm: {"turn": arm.turn * [-1, -1, -1, 1]}, "seems to hold their inverses"),
        (lambda arm: {"place": arm.place + 0.5}, "give the path of the same take"),
    ],
)
def test_a_path_in_another_unit_or_order_is_refused_with_its_name(tmp_path, change, advice):
    arm, time, corners = an_arm(tmp_path)
    with pytest.raises(TakeError) as refused:
        check_arm_path(replace(arm, **change(arm)), time, corners)
    assert advice in str(refused.value)


@pytest.mark.parametrize(
    ("across", "up", "front"),
    [((1, 0, 0), "z", "-y"), ((-1, 0, 0), "z", "y"), ((0, 1, 0), "z", "x"), ((1, 0, 0), "y", "z"),
     ((0, 0, 1), "y", "-x"), ((0, 1, 0), "x", "-z"), ((1, 0, 0), "-z", "y")],
)  # fmt: skip
def test_the_front_looks_where_the_held_corners_and_the_axis_say(across, up, front):
    """Seen from the front the left corner is on the left: x to the right, z up, and the front looks along -y."""
    held = np.zeros((5, 2, 3))
    held[:, 1] = 0.4 * np.array(across)
    held[2] = np.nan
    assert facing(held, up) == front
    assert set(DOWNWARD) == {"x", "y", "z", "-x", "-y", "-z"}


def test_lines_of_a_grid_are_numbered_and_its_positions_named():
    assert _line(np.array([0.3, 0.1, 0.3009, 0.2, 0.1])) == [2, 0, 2, 1, 0]
    assert _line(np.array([0.0, 0.0011])) == [0, 1]
    rest = np.array([[0.1, -0.1], [0.0, -0.1], [0.0, 0.0]])
    assert _names(rest) == ["row0_column1", "row0_column0", "row1_column0"]


def test_held_corners_are_crossed_where_they_lie_nearer_to_the_other_ends_when_all_is_seen():
    rest = np.array([[0.0, 0.0], [0.2, 0.0], [0.4, 0.0], [0.2, -0.4]])
    points = np.tile(np.column_stack([rest, np.zeros(4)]), (3, 1, 1))
    held = points[:, [0, 2]].copy()
    valid = np.ones((3, 4), bool)
    assert not _is_crossed(held, points, valid, rest)
    assert _is_crossed(held[:, ::-1], points, valid, rest)
    mixed = held.copy()
    mixed[:2] = mixed[:2, ::-1]
    assert _is_crossed(mixed, points, valid, rest)
    valid[0, 2] = valid[1, 0] = False
    assert not _is_crossed(mixed, points, valid, rest)


def test_stretches_of_two_frames_or_more_are_drawn():
    seen = np.array([True, True, False, True, False, True, True, True])
    assert stretches(seen) == [(0, 2), (5, 8)]
    assert stretches(~seen) == []


def test_paths_are_about_their_own_means_and_what_was_never_seen_is_nothing():
    take = moved([1, 0, 0])
    take.points[:, 1] = np.nan
    way, names, paths = paths_of(take)
    assert way == "sideways"
    assert paths.shape == (len(take.time), 6)
    assert paths[:, [0, 1, 3]].mean(0) == pytest.approx(np.zeros(3), abs=1e-12)
    assert np.isnan(paths[:, names.index(take.garment.point_names[1].replace("_", " "))]).all()


def test_a_picture_in_letters_has_a_dot_for_each_sight():
    """A rise from -50 to 50 mm: dots go from the lowest row at the left to the highest at the right."""
    take = moved([1, 0, 0])
    ramp = np.linspace(-0.05, 0.05, len(take.time))
    shift = (ramp - 0.0)[:, None, None] * np.array([1.0, 0, 0])
    take = replace(take, held=take.held[:1] + shift, points=take.points[:1] + shift)
    lines = draw_in_letters(take).splitlines()
    assert len(lines) == 11
    assert all(len(line) == 10 + 64 for line in lines[:8])
    assert lines[0].startswith("   +50 mm ")
    assert lines[7].startswith("   -50 mm ")
    assert lines[4].startswith("     0 mm ")
    instants = [(mark.start(), float(mark[1])) for mark in re.finditer(r"\|([\d.]+) s", lines[8][10:])]
    assert [instant for _, instant in instants] == [0, 0.5, 1, 1.5, 2, 2.5, 3, 3.5]
    for column, instant in instants:
        assert column == pytest.approx(63 * instant / (take.time[-1] - take.time[0]), abs=0.5)
    assert [line.strip() for line in lines[9:]] == [
        "motion sideways over 4.0 s, from each path's mean",
        "dotted: the held edge; drawn through: the lowest tracked point",
    ]
    letters = np.array([[ord(letter) - 0x2800 for letter in line[10:]] for line in lines[:8]])
    for row in range(8):
        columns = np.flatnonzero(letters[row])
        assert columns.min() == pytest.approx(64 - 8 * (row + 1), abs=1)
        assert columns.max() == pytest.approx(64 - 8 * row - 1, abs=1)
    assert letters[7, 0] & 0x40  # the lowest dot of the left column
    assert letters[0, -1] & 0x08  # the highest of the right one
    assert sum(bin(dot).count("1") for dot in letters.ravel()) <= len(take.time)


def test_a_still_take_and_a_single_frame_have_pictures_too():
    take = moved([0, 0, 0])
    assert "+10 mm" in draw_in_letters(take)
    single = replace(a_take(frames=1), time=np.array([3.0]))
    assert "over 1.0 s" in draw_in_letters(single)


def test_a_png_has_the_paths_colours_where_they_go(tmp_path):
    """A ramp of the held edge: blue below at the left and above at the right."""
    image = pytest.importorskip("PIL.Image")
    take = moved([1, 0, 0])
    shift = np.linspace(-0.05, 0.05, len(take.time))[:, None, None] * np.array([1.0, 0, 0])
    take = replace(take, held=take.held[:1] + shift, points=np.full_like(take.points, np.nan))
    draw_png(take, tmp_path / "a.png")
    with image.open(tmp_path / "a.png") as picture:
        pixels = np.asarray(picture.convert("RGB")).astype(int)
    assert pixels.shape == (540, 960, 3)
    blue = (np.abs(pixels - [0x1F, 0x77, 0xB4]) < 3).all(2)[:, :800]
    rows, columns = np.nonzero(blue)
    assert (columns.min(), columns.max()) == (pytest.approx(80, abs=2), pytest.approx(800, abs=3))
    assert np.median(rows[columns < 90]) == pytest.approx(484, abs=6)
    assert np.median(rows[columns > 790]) == pytest.approx(56, abs=6)
    assert np.corrcoef(rows, columns)[0, 1] < -0.99


def test_a_rate_is_that_of_the_time_in_which_no_frame_is_lost():
    """Ten frames at 20 a second with a second missing between the fifth and the sixth."""
    time = np.arange(10) / 20
    time[5:] += 1.0
    take = replace(a_take(frames=10), time=time)
    whole = 1 / float(np.diff(time).mean())
    assert _rate(take) == pytest.approx(whole, abs=0.01)
    assert _rate(replace(take, missing=((0.2, 1.25),))) == 20.0
    assert _rate(replace(take, missing=((0.3, 1.2),))) == pytest.approx(20.0)
    assert _rate(replace(take, missing=((-np.inf, -1.0), (9.0, np.inf)))) == pytest.approx(whole, abs=0.01)
    assert _rate(replace(a_take(frames=2), missing=((0.25, 0.25 + 1 / 30),))) is None


def test_a_summary_leaves_out_what_a_take_has_not():
    take = a_take(frames=20)
    lines = describe(summarise(take)).splitlines()
    assert [line.split()[0] for line in lines][:8] == [
        "take", "created", "length", "rig", "garment", "hanger", "motion", "tracked"
    ]  # fmt: skip
    assert not any(line.startswith(("missing", "quality", "surface", "calibrated")) for line in lines)
    assert f"length    {19 / 30:.3f} s, 20 frames, 30 a second" in lines
    assert "source    test" in lines
    assert "note      who: me" in lines
    assert any(line.startswith("state     marker lost in 1 frame") for line in lines)
    lost = replace(take, is_complete=False, missing=((0.3, 0.4),))
    assert describe(summarise(lost)).splitlines()[0] == "take      a   (INCOMPLETE)"
    assert describe(summarise(lost)).splitlines()[1] == "missing   0.05 to 0.15 s"

"""Dots in pictures of flat colours: their pixels are counted by hand."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from capture.errors import UntrackableError
from capture.hanger.colour_dot_search import Dot
from capture.hanger.colour_dots import DotTracker, _background, dot_near
from capture.hanger.fiducial_tracker import ImageTrack
from formats.rig import Calibration, Hanger, Rig, Sensor

SENSOR = Sensor(width=640, height=480, fx=500.0, fy=500.0, cx=319.5, cy=239.5)
HANGER = Hanger(marker="dot", marker_size_m=0.06, marker_distance_m=0.3, held_m=((-0.2, 0.09, 0.0), (0.2, 0.09, 0.0)))
RIG = Rig(format="hangtime-rig/1", name="dots", gravity=(0.0, 1.0, 0.0), hanger=HANGER, sensor=SENSOR)
RED, GREY = (200, 0, 0), (200, 200, 200)
LEFT, RIGHT = (245.0, 200.0), (395.0, 200.0)  # px: 150 px, which are 0.3 m at 1 m


def disc(x, y, diameter=30.0):
    """The pixels of a dot, (480, 640); at 1 m its diameter is 30 px."""
    rows, columns = np.indices((480, 640))
    return np.hypot(columns - x, rows - y) <= 0.5 * diameter


def scene(*places, depth=1000, diameter=30.0):
    picture = np.full((480, 640, 3), GREY, np.uint8)
    for x, y in places:
        picture[disc(x, y, diameter)] = RED
    return picture, np.full((480, 640), depth, np.uint16)


PIXELS = np.count_nonzero(disc(*LEFT))


def test_both_dots_of_a_flat_picture_have_all_that_is_known_of_them():
    sight = DotTracker(RIG).track(*scene(LEFT, RIGHT), 0.0)
    assert sight.is_found
    assert sight.corners.shape == (2, 4, 2)
    assert np.isnan(sight.corners).all()
    assert sight.centres == pytest.approx(np.array([LEFT, RIGHT]))
    side = math.sqrt(4 * PIXELS / math.pi)
    assert sight.sides == pytest.approx([side, side], rel=1e-5)
    assert sight.ranges == pytest.approx(500 * 0.06 / sight.sides)
    assert sight.positions == pytest.approx(np.array([[-0.149, -0.079, 1.0], [0.151, -0.079, 1.0]]))
    assert sight.distance_m == pytest.approx(0.3)
    assert sight.sd.shape == (2, 3)
    assert ((sight.sd > 0) & (sight.sd < 5e-3)).all()


def test_without_dots_nothing_is_known():
    sight = DotTracker(RIG).track(*scene(), 0.0)
    assert not sight.valid.any()
    arrays = (sight.corners, sight.centres, sight.sides, sight.ranges, sight.positions, sight.sd)
    assert [array.shape for array in arrays] == [(2, 4, 2), (2, 2), (2,), (2,), (2, 3), (2, 3)]
    assert all(np.isnan(array).all() for array in arrays)


def test_a_dot_is_placed_where_it_was_at_the_instant_of_the_depth():
    """It moves by 200 px/s to the right; colour that is 20 ms late shows it 4 px ahead."""
    tracker = DotTracker(RIG)
    tracker.track(*scene(LEFT, RIGHT), 1.0, 0.02)
    sight = tracker.track(*scene((LEFT[0] + 20, 200), (RIGHT[0] + 20, 200)), 1.1, 0.02)
    assert sight.centres[:, 0] == pytest.approx([265.0, 415.0])
    assert 500 * sight.positions[:, 0] + 319.5 == pytest.approx([261.0, 411.0])
    assert [track.time for track in tracker._tracks] == pytest.approx([1.12, 1.12])


def test_a_dot_keeps_the_colour_that_it_had_first():
    """Between two frames it darkens. An expected colour of the rig is kept as well."""
    tracker, picture = DotTracker(RIG), scene(LEFT, RIGHT)
    tracker.track(*picture, 0.0)
    picture[0][(picture[0] == RED).all(2)] = (170, 20, 20)
    assert tracker.track(*picture, 1 / 30).is_found
    assert [colour.tolist() for colour in tracker._colours] == [list(RED)] * 2
    told = msgspec.structs.replace(HANGER, dot_colours=((190, 10, 0), (200, 0, 10)))
    tracker = DotTracker(msgspec.structs.replace(RIG, hanger=told))
    assert tracker.track(*picture, 0.0).is_found
    assert [colour.tolist() for colour in tracker._colours] == [[190.0, 10.0, 0.0], [200.0, 0.0, 10.0]]


def test_a_dots_depth_is_aside_by_the_calibrated_offset():
    """Only 8 px right of and 5 px above the dots is it 1 m; around that it is 1.1 m."""
    picture, _ = scene(LEFT, RIGHT)
    depth = np.full((480, 640), 1100, np.uint16)
    for x, y in (LEFT, RIGHT):
        depth[disc(x + 8, y - 5)] = 1000
    moved = msgspec.structs.replace(RIG, calibration=Calibration(depth_offset_px=(8.0, -5.0)))
    assert DotTracker(moved).track(picture, depth, 0.0).positions[:, 2] == pytest.approx([1.0, 1.0], abs=1e-6)


def test_a_dot_without_depth_has_no_position_and_no_centre_and_the_other_one_has():
    tracker = DotTracker(RIG)
    tracker.track(*scene(LEFT, RIGHT), 0.0)
    picture, depth = scene(LEFT, RIGHT)
    depth[150:250, 200:300] = 0
    sight = tracker.track(picture, depth, 1 / 30)
    assert sight.valid.tolist() == [False, True]
    assert np.isnan([*sight.centres[0], sight.sides[0], sight.ranges[0], *sight.positions[0], *sight.sd[0]]).all()
    assert [track.time for track in tracker._tracks] == [0.0, 1 / 30]


@pytest.mark.parametrize("is_picked", [False, True])
def test_two_dots_too_far_apart_are_no_pair_and_only_picked_ones_are_followed(is_picked):
    """180 px at 1 m are 0.36 m."""
    wide = (LEFT, (RIGHT[0] + 30, 200.0))
    tracker = DotTracker(RIG, np.array(wide) if is_picked else None)
    if not is_picked:
        tracker.track(*scene(LEFT, RIGHT), 0.0)
    sight = tracker.track(*scene(*wide), 1 / 30)
    assert sight.distance_m == pytest.approx(0.36)
    assert not sight.valid.any()
    assert [track.time for track in tracker._tracks] == [1 / 30 if is_picked else 0.0] * 2


@pytest.mark.parametrize(("time", "is_found"), [(0.3, True), (0.31, False)])
def test_a_dot_is_sought_near_its_track_for_0_3_s_and_then_anywhere(time, is_found):
    """Other red dots make several pairs, of which none is chosen; beside a track they do not matter."""
    others = ((245.0, 400.0), (395.0, 400.0))
    tracker = DotTracker(RIG)
    tracker._tracks = [ImageTrack(0.0, np.array(at), np.zeros(2), 30.0) for at in (LEFT, RIGHT)]
    tracker._colours = [np.array(RED, float)] * 2
    assert tracker.track(*scene(LEFT, RIGHT, *others), time).is_found is is_found


def test_a_dot_that_is_lost_is_sought_anywhere_while_the_other_one_is_followed():
    tracker = DotTracker(RIG)
    tracker._tracks = [ImageTrack(0.0, np.array(LEFT), np.zeros(2), 30.0), None]
    tracker._colours = [np.array(RED, float), None]
    assert tracker.track(*scene(LEFT, RIGHT), 0.1).centres == pytest.approx(np.array([LEFT, RIGHT]))


def dropped(apart, first, second, time=1.0):
    """Which of two dots, `apart` px from each other along y, are left; of two tracks."""
    tracker = DotTracker(RIG)
    tracker._tracks = [first, second]
    dots = [Dot(np.array([100.0, 50.0 + apart * k]), 20.0 + 40.0 * k, np.zeros(3)) for k in range(2)]
    tracker._drop_doubled(dots, time)
    return [dot is None for dot in dots]


def track(time, at, velocity=(0.0, 0.0)):
    return ImageTrack(time, np.array(at, float), np.array(velocity), 20.0)


def test_one_dot_in_two_windows_is_that_of_the_newer_track():
    """As one dot count two within half of its diameter, 10 px."""
    older, newer = track(0.8, (100.0, 50.0)), track(0.9, (130.0, 50.0))
    assert dropped(10.0, older, newer) == [True, False]
    assert dropped(10.0, newer, older) == [False, True]
    assert dropped(10.1, older, newer) == [False, False]
    tracker = DotTracker(RIG)
    for dots in ([None, None], [Dot(np.zeros(2), 20.0, np.zeros(3)), None]):
        given = list(dots)
        tracker._drop_doubled(given, 1.0)
        assert given == dots


def test_one_dot_in_two_windows_of_one_age_is_that_of_the_track_that_expected_it_there():
    """The dot is at (100, 50). One track comes from 70 px left at 350 px/s in 0.2 s; the other one stood 20 px off."""
    moving, standing = track(0.8, (30.0, 50.0), (350.0, 0.0)), track(0.8, (120.0, 50.0))
    assert dropped(0.0, moving, standing) == [False, True]
    assert dropped(0.0, standing, moving) == [True, False]
    past = track(0.8, (30.0, 50.0), (500.0, 0.0))  # would be 30 px off
    assert dropped(0.0, past, standing) == [True, False]


@pytest.mark.parametrize(("area", "is_whole"), [(1.29, True), (1.31, False), (0.71, True), (0.69, False)])
def test_a_dot_is_whole_within_three_tenths_of_its_area(area, is_whole):
    """At 2 m its diameter is 15 px."""
    assert DotTracker(RIG)._is_whole(15.0 * math.sqrt(area), 2.0) == is_whole


def refusal(place, picture, depth):
    with pytest.raises(UntrackableError) as refused:
        DotTracker(RIG, np.array([place, LEFT])).track(picture, depth, 0.0)
    return str(refused.value)


@pytest.mark.parametrize("place", [(1.4, 200.0), (638.0, 200.0), (200.0, 1.4), (200.0, 477.6)])
def test_a_pick_within_two_pixels_of_the_pictures_border_is_outside(place):
    x, y = (round(part) for part in place)
    said = refusal(place, *scene(LEFT))
    assert said == f"--pick {x},{y}: lies outside the picture; pick within its 640 x 480 pixels"


@pytest.mark.parametrize("place", [(2.0, 200.0), (637.0, 200.0), (200.0, 2.0), (200.0, 477.0)])
def test_a_pick_needs_depth_within_two_pixels(place):
    x, y = (round(part) for part in place)
    picture, depth = scene(LEFT, depth=0)
    assert refusal(place, picture, depth) == f"--pick {x},{y}: there is no depth; pick the middle of a dot"
    for dx, dy in ((2, 2), (-2, -2), (2, -2)):
        depth[:] = 0
        depth[y + dy, x + dx] = 1000
        assert "there is no dot of 60 mm" in refusal(place, picture, depth)
    depth[:] = 1000
    depth[max(y - 2, 0) : y + 3, max(x - 2, 0) : x + 3] = 0
    assert "there is no depth" in refusal(place, picture, depth)


def test_a_pick_beside_a_dot_names_the_option_the_size_and_what_to_pick():
    assert refusal((100.0, 400.0), *scene(LEFT)) == (
        "--pick 100,400: there is no dot of 60 mm; pick the middle of a dot that is one colour, "
        "unlike what is behind it"
    )


@pytest.mark.parametrize(("area", "is_dot"), [(1.25, True), (0.75, True), (1.38, False), (0.62, False)])
def test_a_pick_is_on_a_dot_of_its_area_by_the_depth_that_is_known_there(area, is_dot):
    """Depth is missing in 20 of the 25 pixels around the pick. The picture's next dot has no depth and matters not."""
    picture, depth = scene(LEFT, diameter=30.0 * math.sqrt(area))
    x, y = (int(part) for part in LEFT)
    depth[y - 2 : y + 2, x - 2 : x + 3] = 0
    tracker = DotTracker(RIG)
    if is_dot:
        dot = tracker._picked(picture, depth, np.array(LEFT) + 0.4)
        assert dot.centre == pytest.approx(LEFT, abs=1e-4)
        assert dot.colour.tolist() == list(RED)
    else:
        with pytest.raises(UntrackableError):
            tracker._picked(picture, depth, np.array(LEFT))


def test_the_colour_of_a_picked_dot_is_the_median_of_nine_pixels():
    """Four of them are white, each at a corner; all others of the dot, and around these nine, are red."""
    picture, depth = scene(LEFT)
    x, y = (int(part) for part in LEFT)
    picture[y - 1 : y + 2 : 2, x - 1 : x + 2 : 2] = 255
    picture[y - 2 : y + 3 : 4, x - 2 : x + 3] = picture[y - 2 : y + 3, x - 2 : x + 3 : 4] = (205, 0, 0)
    assert DotTracker(RIG)._picked(picture, depth, np.array(LEFT)).colour.tolist() == list(RED)


def squares(*boxes, size=(120, 160), behind=GREY):
    """A picture with boxes: columns and rows from left, top to right, bottom, all included, and a colour."""
    picture = np.full((*size, 3), behind, np.uint8)
    for left, top, right, bottom, colour in boxes:
        picture[top : bottom + 1, left : right + 1] = colour
    return picture


def near(picture, at=(82.0, 62.0), reach=20.0, diameter=8.0, mark=RED):
    return dot_near(picture, np.array(at), reach, diameter, np.array(mark, float))


def has(dot, area, centre):
    assert dot.diameter == pytest.approx(math.sqrt(4 * area / math.pi), rel=1e-5)
    assert dot.centre == pytest.approx(centre, abs=1e-4)


def test_a_dot_off_the_pictures_corner_has_its_centre_in_the_picture():
    has(near(squares((80, 60, 87, 65, RED))), 48.0, [83.5, 62.5])


@pytest.mark.parametrize(("left", "top"), [(0, 0), (152, 114)])
def test_a_dot_in_a_corner_of_the_picture_is_whole(left, top):
    picture = squares((left, top, left + 7, top + 5, RED))
    has(near(picture, at=(left + 4.0, top + 2.0)), 48.0, [left + 3.5, top + 2.5])


def test_a_window_ends_a_pixel_beyond_the_reach_and_is_as_wide_as_a_dot():
    """From column 40 and row 42 to column 61 and row 63 of a dot that goes on: 17 x 17 pixels in the window."""
    picture = squares((45, 47, 159, 119, RED))
    has(near(picture, at=(50.9, 52.9), reach=10.0, diameter=17.0), 289.0, [53.0, 55.0])
    picture = squares((0, 50, 7, 57, RED), (76, 0, 83, 7, RED))
    assert near(picture, at=(-3.0, 54.0), reach=10.0, diameter=9.0) is not None
    assert near(picture, at=(-4.0, 54.0), reach=10.0, diameter=9.0) is None
    assert near(picture, at=(80.0, -3.0), reach=10.0, diameter=9.0) is not None
    assert near(picture, at=(80.0, -4.0), reach=10.0, diameter=9.0) is None


def test_of_two_dots_the_nearer_one_is_taken_and_none_that_is_too_small():
    """A fifth of 8 x 8 px are 12.8 pixels: 13 are a dot, and 12 are none."""
    picture = squares((70, 60, 75, 65, RED), (90, 58, 95, 63, RED))
    has(near(picture, at=(82.0, 62.0)), 36.0, [72.5, 62.5])
    has(near(picture, at=(84.0, 62.0)), 36.0, [92.5, 60.5])
    picture = squares((70, 60, 75, 65, RED), (84, 60, 86, 63, RED))
    has(near(picture, at=(84.0, 62.0)), 36.0, [72.5, 62.5])
    picture[64, 84] = RED
    has(near(picture, at=(84.0, 62.0)), 13.0, [(4 * 84 + 85 * 4 + 86 * 4 + 84) / 13, (3 * 246 + 64) / 13])
    assert near(squares((84, 60, 86, 63, RED))) is None


def test_a_dot_is_told_from_its_background_by_40_of_255():
    for step, is_seen in ((23, False), (24, True)):  # by sqrt 3: 39.8 and 41.6
        colour = (100 + step,) * 3
        picture = squares((80, 60, 87, 65, colour), behind=(100, 100, 100))
        assert (near(picture, mark=colour) is not None) == is_seen


def test_rim_pixels_count_by_their_share_and_those_beyond_do_not():
    """A fifth of red in a column beside the dot and in the next one; one of four fifths at a corner is outside too."""
    faint, strong = (200, 160, 160), (200, 40, 40)
    picture = squares((80, 60, 87, 65, RED), (88, 60, 89, 65, faint))
    area = 48 + 6 * 0.2
    has(near(picture), area, [(48 * 83.5 + 1.2 * 88) / area, 62.5])
    corner = squares((80, 60, 87, 65, RED), (88, 66, 88, 66, strong))
    has(near(corner), 48.8, [(48 * 83.5 + 0.8 * 88) / 48.8, (48 * 62.5 + 0.8 * 66) / 48.8])
    line = squares((80, 60, 87, 65, RED), (88, 66, 100, 66, strong))  # joined by a corner alone
    has(near(line), 48.8, [(48 * 83.5 + 0.8 * 88) / 48.8, (48 * 62.5 + 0.8 * 66) / 48.8])


def test_a_pixel_of_more_colour_than_the_dot_counts_once():
    """(180, 20, 20) on grey; pure red has a tenth more of that."""
    picture = squares((80, 60, 87, 65, (180, 20, 20)), (80, 60, 81, 65, RED))
    has(near(picture, mark=(180, 20, 20)), 48.0, [83.5, 62.5])


@pytest.mark.parametrize(("red", "counts"), [(60, True), (57, False)])
def test_a_colour_off_the_line_from_the_background_to_the_dot_is_no_mixture(red, counts):
    """Red and grey are 282.8 apart, and half of that is 141.4. A column of half shares is 140 or 143 off the line."""
    picture = squares((80, 60, 87, 65, RED), (88, 60, 88, 65, (red, 100, 100)))
    area = 51.0 if counts else 48.0
    has(near(picture), area, [(48 * 83.5 + 3 * 88) / 51 if counts else 83.5, 62.5])


def test_the_background_is_the_median_of_what_is_farthest_from_the_dots_colour():
    """Reds of 0 to 99: of a dot of 5 x 5 px the other 75 pixels, of one that fills the window the last fifth."""
    window = np.zeros((10, 10, 3), np.float32)
    window[..., 0] = np.arange(100).reshape(10, 10)
    window[..., 1:] = window[..., :1] * [2, 0]
    black = np.zeros(3)
    assert _background(window, black, 5.0).tolist() == [62.0, 124.0, 0.0]
    assert _background(window, black, 10.0).tolist() == [89.5, 179.0, 0.0]
    assert _background(np.full_like(window, 7.0), black, 5.0).tolist() == [7.0, 7.0, 7.0]

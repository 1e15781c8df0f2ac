"""Pictures of a few triangles, and new motions of a hanger, by hand."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from fit.errors import FitError
from fit.export.drawing import BACK_COLOUR, FRONT_COLOUR, Stage, _corner_normals
from fit.export.fabric import fabric_of
from fit.export.new_motion import check_motion, displaced, hung_swatch, new_motion
from fit.export.raster import Faces, drawn
from tests.fit.export.exported import a_fit
from tests.fit.export.test_animation import square

SKY, LIGHT = np.array([10.0, 20.0, 30.0]), np.array([0.0, 0.0, 1.0])
FRONT, BACK = np.array([201.2, 101.2, 53.2]), np.array([41.2, 81.2, 161.2])


def faces(*triangles, depth=1.0, normal=(0.0, 0.0, 1.0), front=FRONT, back=BACK, shaded=1.0):
    """Triangles at one depth [m], corners in drawn pixels, two to an output pixel along each side."""
    flat = np.array(triangles, float)
    count = len(flat)
    corners = np.concatenate([flat, np.full((count, 3, 1), depth)], 2)
    return Faces(corners, np.tile(normal, (count, 3, 1)), np.tile(front, (count, 1)), np.tile(back, (count, 1)),
                 np.full(count, shaded))  # fmt: skip


LOWER_LEFT = ((0, 0), (0, 8), (8, 8))  # anticlockwise to the eye, since down is positive
WHOLE = (LOWER_LEFT, ((0, 0), (8, 8), (8, 0)))


def picture(*parts, light=LIGHT, ambient=0.25):
    return drawn(Faces.together(*parts), (4, 4), SKY, light, ambient).astype(int)


def test_a_triangle_covers_the_pixels_whose_centres_it_holds_with_the_colour_of_its_side():
    """Below the diagonal of 4 x 4 pixels; pixels on it are of their four drawn ones three quarters covered."""
    shown = picture(faces(LOWER_LEFT))
    for row in range(4):
        for column in range(4):
            share = 1.0 if column < row else 0.75 if column == row else 0.0
            assert shown[row, column] == pytest.approx(share * FRONT + (1 - share) * SKY, abs=0.51)
    turned = picture(faces(LOWER_LEFT[::-1]))
    assert turned[3, 0] == pytest.approx(BACK, abs=0.51)


@pytest.mark.parametrize("corners", [((1, 0), (0, 7), (7, 4)), ((0, 4), (7, 8), (6, 0)), ((1, 8), (8, 7), (3, 1))])
def test_a_triangle_is_the_same_whichever_of_its_corners_comes_first(corners):
    """Each side of the picture is reached by another corner; a triangle beside it hides nothing."""
    other = ((20, 20), (20, 21), (21, 21))
    first = picture(faces(corners, other))
    assert (first != SKY.astype(int)).any()
    for turn in (1, 2):
        assert (picture(faces(corners[turn:] + corners[:turn], other)) == first).all()
    inside = [
        (x + 0.5, y + 0.5) for y in range(8) for x in range(8)
        if all(_side(corners[k], corners[(k + 1) % 3], (x + 0.5, y + 0.5)) <= 0 for k in range(3))
        or all(_side(corners[k], corners[(k + 1) % 3], (x + 0.5, y + 0.5)) >= 0 for k in range(3))
    ]  # fmt: skip
    covered = (first - SKY.astype(int))[..., 0].sum() / (picture(faces(*WHOLE)) - SKY.astype(int))[..., 0].sum()
    assert covered * 64 == pytest.approx(len(inside), abs=1.0)


def _side(one, other, place):
    """On which side of a line a place lies."""
    return (other[0] - one[0]) * (place[1] - one[1]) - (other[1] - one[1]) * (place[0] - one[0])


def test_shade_is_the_ambient_share_and_lamberts_rest_on_either_side_of_a_face():
    """A normal 60 degrees off the light: 0.25 + 0.75 / 2 of the colour; no shade where a face is flat."""
    leaning = (np.sqrt(0.75), 0.0, 0.5)
    for sign in (1, -1):
        shown = picture(faces(*WHOLE, normal=tuple(sign * n for n in leaning)))
        assert shown[2, 2] == pytest.approx(0.625 * FRONT, abs=0.51)
    assert picture(faces(*WHOLE, normal=(1.0, 0.0, 0.0)))[2, 2] == pytest.approx(0.25 * FRONT, abs=0.51)
    assert picture(faces(*WHOLE, normal=(1.0, 0.0, 0.0), shaded=0.0))[2, 2] == pytest.approx(FRONT, abs=0.51)
    assert picture(faces(*WHOLE, normal=(0.0, 0.0, 3.0)))[2, 2] == pytest.approx(FRONT, abs=0.51)  # of any length


def test_normals_are_interpolated_between_corners():
    """From along the light on the left to across it on the right: in the middle both have one share, 1 / sqrt(2)."""
    square = faces(*WHOLE)
    towards = square.corners[..., 0] / 8
    normals = np.stack([towards, 0 * towards, 1 - towards], -1)
    shown = picture(dataclasses.replace(square, normals=normals), ambient=0.0)[1]
    at = (np.array([[0.5, 1.5], [2.5, 3.5], [4.5, 5.5], [6.5, 7.5]])) / 8
    expected = ((1 - at) / np.hypot(at, 1 - at)).mean(1)
    assert shown[:, 0] == pytest.approx(201.2 * expected, abs=0.6)


def test_the_nearer_face_is_seen_whichever_comes_first_and_depth_is_linear():
    near, far = faces(*WHOLE, depth=1.0, front=FRONT), faces(*WHOLE, depth=2.0, front=BACK)
    for order in ((near, far), (far, near)):
        assert picture(*order)[1, 1] == pytest.approx(FRONT, abs=0.51)
    leaning = dataclasses.replace(far, corners=far.corners.copy())
    leaning.corners[..., 2] = 0.1 + 0.2 * leaning.corners[..., 0]  # nearer than 1 m left of 4.5 drawn pixels
    shown = picture(near, leaning)[1]
    assert shown[[0, 1]] == pytest.approx(np.tile(BACK, (2, 1)), abs=0.51)
    assert shown[3] == pytest.approx(FRONT, abs=0.51)


def test_faces_beyond_the_picture_are_cut_at_its_border():
    beyond = faces(((-20, -20), (-20, 60), (60, 60)), ((-20, -20), (60, 60), (60, -20)))
    assert (np.abs(picture(beyond) - FRONT) < 0.51).all()
    assert (picture(faces(((10, 10), (10, 18), (18, 18)))) == SKY).all()


def test_a_corner_keeps_its_triangles_own_normal_beyond_60_degrees_from_its_nodes():
    """A node of two triangles of one square and one of the next: (2 cos f + 1) / sqrt(5 + 4 cos f) is 1/2 at 85.7."""
    for fold, is_sharp in ((89.0, True), (82.0, False)):
        turn = np.radians(fold)
        places = np.array([[0, -1, 0], [1, -1, 0], [1, 0, 0], [0, 0, 0], [1, np.cos(turn), np.sin(turn)],
                           [0, np.cos(turn), np.sin(turn)]])  # fmt: skip
        triangles = np.array([[0, 1, 2], [0, 2, 3], [3, 2, 4], [3, 4, 5]])
        own, first = np.array([0.0, -np.sin(turn), np.cos(turn)]), np.array([0.0, 0.0, 1.0])
        mean = (2 * first + own) / np.linalg.norm(2 * first + own)
        normals = _corner_normals(places, triangles)
        assert normals[2, 1] == pytest.approx(own if is_sharp else mean)
        assert normals[0, 2] == pytest.approx(mean)


def test_a_bar_is_two_drawn_pixels_wide_and_ends_in_discs_of_four_pixels():
    bar = Stage._bar(np.array([[10.0, 20.0, 3.0], [50.0, 20.0, 3.0]]))
    quad, discs = bar.corners[:2, :, :2].reshape(-1, 2), bar.corners[2:, :, :2].reshape(2, -1, 2)
    assert (quad.min(0).tolist(), quad.max(0).tolist()) == ([10.0, 18.0], [50.0, 22.0])
    for disc, at in zip(discs, (10.0, 50.0), strict=True):
        assert np.linalg.norm(disc - [at, 20.0], axis=1).max() == pytest.approx(8.0)
    assert (bar.corners[..., 2] < 0.02).all()  # m: in front of everything
    assert not bar.shaded.any()


def test_the_floor_of_small_cloth_has_seven_lines_a_fifth_of_a_metre_apart_each_way():
    """About the multiple of 0.2 m next to the middle of the cloth, 0.15 of its height below it, 24 mm / 5 wide."""
    stage = Stage(square(0.0), (160, 120))
    floor = stage._floor(lambda places: places, np.zeros(3))
    places = floor.corners.reshape(2, -1, 3)  # lines along y, then along x
    for axis, lines in enumerate(places):
        middles = np.unique(np.round(lines[:, axis], 6))
        assert len(middles) == 14
        assert np.diff(middles)[::2] == pytest.approx(0.024 * 0.2)
        assert (middles[::2] + middles[1::2]) / 2 == pytest.approx(0.2 * np.arange(-3, 4))
        assert lines[:, 1 - axis].max() - lines[:, 1 - axis].min() == pytest.approx(1.2)
    assert stage._floor_at == pytest.approx(-0.2 - 0.15 * 0.2)
    assert floor.corners[..., 2] == pytest.approx(stage._floor_at + 200.0)
    shadow = stage._shadow(lambda places: places, np.array([[[0.1, 0.2, 0.3], [0, 0, 0], [0.3, 0, 0.1]]]))
    assert shadow.corners[0, 0] == pytest.approx([0.1, 0.2, stage._floor_at + 100.0])


def test_cloth_looks_blue_in_front_and_brown_behind():
    assert FRONT_COLOUR.tolist() == [74, 119, 176]
    assert BACK_COLOUR.tolist() == [206, 156, 96]


ENDS = np.array([[-0.12, -0.16, 0.01], [0.12, 0.16, -0.01]])  # along (0.6, 0.8), a little askew
ALONG, ACROSS = np.array([0.6, 0.8, 0.0]), np.array([-0.8, 0.6, 0.0])


def risen(share):
    return 10 * share**3 - 15 * share**4 + 6 * share**5


@pytest.mark.parametrize(
    ("way", "rate", "axis"),
    [("sideways", 0.9, 0.1 * ALONG), ("face-on", 0.8, 0.1 * ACROSS), ("up-and-down", 1.3, np.array([0, 0, 0.05]))],
)
def test_a_new_motion_is_its_wave_times_its_rise_and_fall(way, rate, axis):
    """Of 6 s: a quarter of the rise at 0.15 s, all of it at 2.3 s, half of the fall at 4.7 s, and rest after 5 s."""
    time = np.array([0.15, 2.3, 4.7, 5.2])
    size = np.array([risen(0.25), 1.0, 0.5, 0.0])
    moved = displaced(ENDS, way, time, 6.0).reshape(-1, 2, 3) - ENDS
    expected = (size * np.sin(2 * np.pi * rate * time))[:, None] * axis
    assert moved == pytest.approx(np.repeat(expected[:, None], 2, 1), abs=1e-12)


def test_a_twist_turns_the_ends_by_forty_degrees_about_the_vertical_through_their_middle():
    time = np.array([0.15, 2.3, 4.7, 5.2])
    turn = np.radians(40) * np.array([risen(0.25), 1.0, 0.5, 0.0]) * np.sin(2 * np.pi * 0.7 * time)
    ends = displaced(ENDS, "twist", time, 6.0).reshape(-1, 2, 3)
    along = np.stack([np.cos(turn), np.sin(turn)], 1) @ np.stack([ALONG, ACROSS])
    assert ends[:, 1] == pytest.approx(0.2 * along + [0, 0, -0.01])
    assert ends[:, 0] == pytest.approx(-0.2 * along + [0, 0, 0.01])


def test_a_mixed_motion_is_six_tenths_of_all_four():
    time = np.array([1.1, 2.3])
    turn = 0.6 * np.radians(40) * np.sin(2 * np.pi * 0.7 * time)
    wave = 0.6 * np.stack([np.sin(2 * np.pi * rate * time) for rate in (0.9, 0.8, 1.3)], 1)
    middle = wave @ np.stack([0.1 * ALONG, 0.1 * ACROSS, [0, 0, 0.05]])
    along = np.stack([np.cos(turn), np.sin(turn)], 1) @ np.stack([ALONG, ACROSS])
    ends = displaced(ENDS, "mixed", time, 6.0).reshape(-1, 2, 3)
    assert ends[:, 1] == pytest.approx(middle + 0.2 * along + [0, 0, -0.01])


def test_a_recording_of_a_new_motion_has_thirty_frames_a_second_and_no_points():
    before = hung_swatch(fabric_of(a_fit()))
    made = new_motion(before, "sideways", 2.0)
    assert made.time == pytest.approx(np.arange(61) / 30)
    assert made.held_seen == pytest.approx(made.held(made.time))
    assert made.held(np.array([0.7])) == pytest.approx(
        displaced(before.held(np.zeros(1)).reshape(2, 3), "sideways", np.array([0.7]), 2.0)
    )
    assert made.points.shape == (61, before.points.shape[1], 3)
    assert np.isnan(made.points).all()
    assert not made.valid.any()
    assert (made.edge_turn(np.zeros(3)) == np.zeros((3, 2))).all()
    assert made.windows is None


def test_a_swatch_without_a_take_hangs_from_corners_eight_percent_nearer_than_it_is_wide():
    still = hung_swatch(fabric_of(a_fit()))
    assert still.held(np.zeros(1)).reshape(2, 3) == pytest.approx(np.array([[-0.184, 0, 0], [0.184, 0, 0]]), abs=1e-9)
    assert np.ptp(np.array(still.garment.outline_m), axis=0) == pytest.approx([0.4, 0.4])
    assert len(still.time) == 30


@pytest.mark.parametrize(("seconds", "is_refused"), [(1.9, True), (2.0, False), (60.0, False), (60.1, True)])
def test_a_motion_lasts_two_seconds_to_a_minute(seconds, is_refused):
    if not is_refused:
        check_motion("mixed", seconds)
        return
    with pytest.raises(FitError, match="2 to 60 s"):
        check_motion("mixed", seconds)


def test_letters_are_a_forty_fifth_of_the_pictures_height_and_ten_pixels_at_least():
    """Three times their size stays free above the cloth, from 200 pixels of height on."""
    for high, letter, title in ((900, 20.0, 60), (300, 10.0, 30), (200, 10.0, 30), (199, 10.0, 0)):
        stage = Stage(square(0.0), (320, high))
        assert (stage._letter, stage._title) == (pytest.approx(letter), title)


def test_the_cloth_is_drawn_as_large_as_84_percent_of_the_smaller_side_allow():
    """Of its own extent and its floor; the camera is 3.2 times that far."""
    stage = Stage(square(0.0), (160, 120))
    corners = square(0.0).places[0].astype(float)
    low, high = corners.min(0), corners.max(0)
    low[2] = stage._floor_at
    assert stage._middle == pytest.approx(0.5 * (low + high))
    assert stage._distance == pytest.approx(3.2 * np.linalg.norm(high - low))
    shadow = corners * [1, 1, 0] + [0, 0, stage._floor_at]
    every = stage._project(np.concatenate([corners, shadow]), np.zeros(3), stage._scale, (0.0, 0.0))[:, :2]
    assert np.abs(every / [80, 60]).max() == pytest.approx(0.84)
    assert stage._light == pytest.approx(np.array([0.45, -0.75, 0.6]) / np.linalg.norm([0.45, -0.75, 0.6]))

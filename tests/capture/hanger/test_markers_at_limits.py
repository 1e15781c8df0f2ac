"""Markers exactly at their limits: borders of windows and pictures, sizes, distances and depths in whole numbers."""

from __future__ import annotations

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from capture.errors import UntrackableError
from capture.hanger.choice import hanger_tracker
from capture.hanger.fiducial_tracker import LONGEST_GUESS, ImageTrack, MarkerTracker
from capture.hanger.marker_detection import (
    APART_WITHIN,
    MarkerDetector,
    _pair,
    _parameters,
    diagonal_crossing,
    marker_dictionary,
    times_seen,
)
from capture.hanger.marker_plates import PlatePlacer
from capture.hanger.seen_otherwise import seen_otherwise
from capture.hanger.seen_sizes import wrong_size, wrong_unit
from tests.capture.hanger.test_marker_detection import HANGER, picture
from tests.capture.hanger.test_marker_tracks import BOTH, DICTIONARY, LEFT, RIG, RIGHT, covered, moved, scene, track_at
from tests.capture.hanger.test_placing_by_hand import SIZE, depth_of
from tests.capture.hanger.test_seen_sizes import stated
from tests.capture.stage import CAMERA
from tests.capture.test_sensor_check import drawn

DETECTOR = MarkerDetector("DICT_4X4_50", (0, 1))


def is_seen(image, centre, reach, side):
    return bool(np.isfinite(DETECTOR.in_window(image, 0, np.array(centre, float), reach, side)).all())


@pytest.mark.parametrize("axis", [0, 1])
def test_a_window_goes_on_to_the_pixel_after_its_reach(axis):
    """A marker of 16 px needs one pixel beside it; reach and centre end 2 px before the window does."""
    first = (80, 100)[axis]
    middle = np.array([87.5, 107.5])
    for end, is_found in ((first + 17, True), (first + 16, False)):
        centre = middle.copy()
        centre[axis] = end - 2 - 24.0 + 0.25
        assert is_seen(picture(16), centre, 24.0, 16.0) == is_found


@pytest.mark.parametrize("axis", [0, 1])
def test_a_window_begins_with_the_picture(axis):
    """The marker's border of one pixel is the picture's first row or column."""
    shown = picture(16)
    image = np.ascontiguousarray(shown[:, 79:] if axis == 0 else shown[99:])
    middle = np.array([8.5, 107.5]) if axis == 0 else np.array([87.5, 8.5])
    assert is_seen(image, middle, 24.0, 16.0)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_marker_is_found_in_a_window_of_twelve_pixels(axis):
    """One of 9 px, in a picture that is 12 px high or wide."""
    image = np.full((12, 40, 3), 200, np.uint8)
    marker = cv2.resize(cv2.aruco.generateImageMarker(DICTIONARY, 0, 60), (9, 9), interpolation=cv2.INTER_AREA)
    image[1:10, 20:29] = marker[..., None]
    middle = [24.0, 5.0]
    if axis:
        image, middle = np.ascontiguousarray(np.rot90(image)), [5.0, 40 - 25.0]
    assert is_seen(image, middle, 15.0, 9.0)


def test_a_window_below_the_picture_has_no_corners():
    assert not is_seen(picture(30), (95.0, 900.0), 45.0, 30.0)


@pytest.mark.parametrize(("side", "times"), [(13, 4), (16, 4), (60, 1), (140, 1)])
def test_a_window_is_enlarged_until_a_side_is_64_pixels_but_four_times_at_most_and_never_made_smaller(side, times):
    image = picture(side) if side < 100 else large(side)
    reach, centre = 1.2 * side, np.array([80.0, 100.0]) + side / 2
    window = np.s_[max(0, int(centre[1] - reach)) : int(centre[1] + reach) + 2,
                   max(0, int(centre[0] - reach)) : int(centre[0] + reach) + 2]  # fmt: skip
    start = np.array([window[1].start, window[0].start])
    DETECTOR._near.setDetectorParameters(_parameters(square=0.35 * side * times))
    grey = cv2.cvtColor(np.ascontiguousarray(image[window]), cv2.COLOR_RGB2GRAY)
    expected = DETECTOR._detect(DETECTOR._near, grey, times)[0] + start
    assert np.isfinite(expected).all()
    assert DETECTOR.in_window(image, 0, centre, reach, side).tolist() == expected.tolist()


def large(side):
    """One marker from the pixel of `picture` on, so many pixels wide."""
    image = np.full((400, 400, 3), 200, np.uint8)
    marker = cv2.resize(cv2.aruco.generateImageMarker(DICTIONARY, 0, 60), (side, side), interpolation=cv2.INTER_NEAREST)
    image[100 : 100 + side, 80 : 80 + side] = marker[..., None]
    return image


def test_the_square_of_a_threshold_is_the_odd_number_that_its_size_is_in():
    found = [_parameters(size).adaptiveThreshWinSizeMax for size in (0.5, 3.9, 4.0, 20.9, 21.9, 24.0)]
    assert found == [3, 3, 5, 21, 21, 25]


def test_a_marker_of_a_whole_picture_is_where_the_lines_of_its_outline_cross():
    """One of 60 px is turned by 8 degrees about its middle, which stays there to a thirtieth of a pixel."""
    turn = cv2.getRotationMatrix2D((110.0, 130.0), 8.0, 1.0)
    shown = cv2.warpAffine(picture(60), turn, (320, 240), borderValue=(200, 200, 200))
    middle = turn @ [109.5, 129.5, 1.0]
    found = MarkerDetector("DICT_4X4_50", (0, 1)).in_picture(shown)[0]
    assert diagonal_crossing(found) == pytest.approx(middle, abs=0.03)


def test_a_marker_is_refined_though_another_one_of_its_id_is_near():
    """Of that, which is one and a half sides away, less than a half stands within 1.2 sides."""
    image = np.full((240, 320, 3), 200, np.uint8)
    marker = cv2.resize(cv2.aruco.generateImageMarker(DICTIONARY, 0, 60), (24, 24), interpolation=cv2.INTER_AREA)
    for x in (80, 80 + 36):
        image[100:124, x : x + 24] = marker[..., None]
    coarse = np.array([[80.0, 100.0], [103.0, 100.0], [103.0, 123.0], [80.0, 123.0]])
    fine = DETECTOR.refined(image, 0, coarse)
    assert fine.tolist() != coarse.tolist()
    assert fine == pytest.approx(coarse, abs=1.0)


def test_a_name_that_is_no_dictionarys_is_refused_though_opencv_knows_it():
    with pytest.raises(UntrackableError, match="'CORNER_REFINE_CONTOUR' is not known"):
        marker_dictionary("CORNER_REFINE_CONTOUR")


def test_a_marker_of_13_pixels_counts_among_those_seen():
    """Enlarged by straight lines, and not by cubics, it is not read."""
    assert dict(times_seen(cv2.GaussianBlur(picture(13), (0, 0), 0.5), "DICT_4X4_50")) == {0: 1, 1: 1}


@pytest.mark.parametrize(
    ("second", "times"),
    [((0.0, 0.0), 1), ((0.0, 20.0), 1), ((0.0, 21.0), 2), ((-50.0, 50.0), 2), ((50.0, -50.0), 2), ((3.0, 3.0), 1)],
)
@pytest.mark.parametrize("is_swapped", [False, True])
def test_outlines_within_one_side_of_each_other_are_one_marker(second, times, is_swapped, monkeypatch):
    """OpenCV is asked for outlines of 20 px at (200, 100) and beside it; this version of it tells no nested ones."""

    square = 10.0 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    quads = [(square + at)[None].astype(np.float32) for at in ((200.0, 100.0), np.add((200.0, 100.0), second))]
    told = quads[::-1] if is_swapped else quads, np.array([[7], [7]]), []
    monkeypatch.setattr(cv2.aruco, "ArucoDetector", lambda dictionary: SimpleNamespace(detectMarkers=lambda grey: told))
    assert times_seen(np.zeros((4, 4, 3), np.uint8), "DICT_4X4_50") == {7: times}


@pytest.mark.parametrize(("distance", "is_pair"), [(85.0, False), (85.1, True), (115.0, False), (114.9, True)])
def test_a_pair_is_less_than_exactly_fifteen_per_cent_off(distance, is_pair):
    """Sides of 100 px, which are to be as far apart."""
    assert APART_WITHIN == 0.15
    square = 50.0 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    assert (_pair([square], [square + np.array([distance, 0.0])], 1.0) != [[], []]) == is_pair


def test_a_tracker_looks_for_small_markers_in_every_picture_unless_told_otherwise():
    assert not hanger_tracker(RIG)._detector._is_sparing
    assert not MarkerTracker(RIG)._detector._is_sparing


def test_a_track_has_a_velocity_after_exactly_the_longest_gap():
    before = ImageTrack(0.0, np.zeros(2), np.zeros(2), 24.0)
    assert LONGEST_GUESS == 0.3
    assert ImageTrack.after(before, 0.3, np.array([30.0, 0.0]), 24.0).velocity == pytest.approx([100.0, 0.0])
    assert ImageTrack.after(before, np.nextafter(0.3, 1.0), np.ones(2), 24.0).velocity.tolist() == [0.0, 0.0]


def test_a_marker_is_sought_near_its_track_at_any_time_of_a_recording():
    """As at the beginning, after a minute: beside the picture there is nothing."""
    tracker = MarkerTracker(RIG)
    tracker._tracks = [track_at(60.0), track_at(60.0, RIGHT, (90_000.0, 0.0))]
    corners = tracker._find_corners(scene(*BOTH)[0], 60.2)
    assert np.isfinite(corners[0]).all()
    assert np.isnan(corners[1]).all()


def test_the_plate_of_a_moving_marker_is_where_it_was_at_the_instant_of_the_depth():
    """Colour is 0.1 s late, in which it moves by 20 px: only there is it 1 m, and around that it is 1.03 m."""
    tracker, (picture_, depth) = MarkerTracker(RIG), scene(*moved(20), depth=1030)
    tracker.track(*scene(*BOTH), 1.0, 0.1)
    for x, y in (LEFT, RIGHT):
        depth[y - 2 : y + 26, x - 2 : x + 26] = 1000
    assert tracker.track(picture_, depth, 1.1, 0.1).positions[:, 2] == pytest.approx([1.0, 1.0], abs=1e-6)


def test_a_marker_that_is_followed_is_less_certain_than_one_that_is_read():
    """A quarter of a pixel at least, across one metre at 400 px."""
    tracker = MarkerTracker(RIG)
    tracker.track(*scene(*BOTH), 0.0)
    sight = tracker.track(*covered(*moved(2)), 1 / 30)
    assert sight.sd[0, 1] >= 0.25 / 400
    assert sight.sd[1, 1] < 0.1 / 400


def test_a_plate_at_the_first_rows_and_columns_of_a_picture_has_a_depth():
    """Three columns from the first one on are just enough."""
    for outline in ([[0.0, 100.0], [2.0, 100.0], [2.0, 130.0], [0.0, 130.0]],
                    [[100.0, 0.0], [130.0, 0.0], [130.0, 2.0], [100.0, 2.0]]):  # fmt: skip
        plate = PlatePlacer(CAMERA, SIZE).plate_depth(np.array(outline), np.mean(outline, axis=0), depth_of(1.6))
        assert plate is not None
        assert plate.depth == pytest.approx(1.6)


def test_a_depth_by_size_is_that_of_a_plane_and_unknown_of_corners_that_are_none():
    """Of corners half a pixel off, at 2 m, where a search without the plane's two solutions ends at 2.20 m."""
    off = np.array([[340.1, 174.4], [356.6, 173.4], [355.6, 190.1], [339.8, 190.6]])
    assert PlatePlacer(CAMERA, SIZE).pose_depth(off) == pytest.approx(2.0, rel=0.025)
    assert np.isnan(PlatePlacer(CAMERA, SIZE).pose_depth(np.full((4, 2), 100.0)))


@pytest.mark.parametrize("side", [14, 60])
def test_small_markers_are_seen_in_a_mirror_too(side):
    assert "mirror image" in seen_otherwise(np.ascontiguousarray(picture(side)[:, ::-1]), HANGER)


def test_sizes_of_hundreds_of_millimetres_are_said_exactly():
    said = wrong_size(stated().hanger, stated().sensor, (0.6, 0.9))
    assert "markers of 600 mm that are 900 mm apart" in said


def test_of_two_lengths_that_are_off_alike_the_distance_is_named():
    """Half too much and half too little."""
    assert wrong_size(stated().hanger, stated().sensor, (0.09, 0.1)).endswith("measure hanger.marker_distance_m again")


def test_depth_of_exactly_65000_is_the_end_of_its_bits():
    depth = np.full((240, 320), 65000, np.uint16)
    assert "the end of its 16 bits" in wrong_unit(drawn(0, 1), depth, stated())
    assert "the end of its 16 bits" not in wrong_unit(drawn(0, 1), depth - np.uint16(1), stated())


def test_two_metres_are_not_taken_for_three_quarters_of_one():
    """By their size the markers are 0.72 m away; depth of 2 in metres would be 2 m."""
    assert wrong_unit(drawn(0, 1), np.full((240, 320), 2, np.uint16), stated()) == ""


def test_the_distance_by_size_is_said_to_the_millimetre():
    """Thirty times the focal length: 21.6 m, to which a thousandth adds 22 mm."""
    told = stated(focal=30 * 288.0)
    corners = MarkerDetector("DICT_4X4_50", (0, 1)).in_picture(drawn(0, 1))
    pixels = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max()
    said = wrong_unit(drawn(0, 1), np.full((240, 320), 2160, np.uint16), told)
    assert f"by their size they are {60 * 30 * 288 / pixels:.0f} mm away" in said


def test_the_distance_between_markers_is_that_of_their_middles_wherever_they_are():
    """At (201, 31) and (281, 31): 80 px apart, with depth in centimetres."""
    shown = np.roll(drawn(0, 1), (-80, 150), axis=(0, 1))
    assert "depth is probably in centimetres" in wrong_unit(shown, np.full((240, 320), 72, np.uint16), stated())

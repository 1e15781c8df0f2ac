"""Small markers are detected in an enlarged image; a sparing detector enlarges every second image."""

from __future__ import annotations

import cv2
import msgspec
import numpy as np
import pytest

from capture.hanger.marker_detection import (
    MarkerDetector,
    _with_outermost_pixels,
    diagonal_crossing,
    quad_side,
)
from capture.hanger.seen_otherwise import seen_otherwise
from formats.rig import Hanger


def picture(side, ids=(0, 1)):
    """A grey picture with two markers, so many pixels wide."""
    image = np.full((240, 320, 3), 200, np.uint8)
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    for place, number in enumerate(ids):
        marker = cv2.aruco.generateImageMarker(dictionary, number, 60)
        small = cv2.resize(marker, (side, side), interpolation=cv2.INTER_AREA)
        image[100 : 100 + side, 80 + 100 * place : 80 + 100 * place + side] = small[..., None]
    return image


def seen(detector, side, pictures):
    return [bool(np.isfinite(detector.in_picture(picture(side))).all()) for _ in range(pictures)]


def test_a_sparing_detector_finds_markers_of_13_pixels_in_every_second_picture():
    assert seen(MarkerDetector("DICT_4X4_50", (0, 1)), 13, 3) == [True, True, True]
    assert seen(MarkerDetector("DICT_4X4_50", (0, 1), is_sparing=True), 13, 4) == [True, False, True, False]


def test_a_marker_found_in_the_picture_stays_where_a_smaller_one_is_looked_for_in_the_enlarged_one():
    """The picture is turned by 8 degrees, so that the enlarged one has other corners."""
    turn = cv2.getRotationMatrix2D((160.0, 120.0), 8.0, 1.0)
    mixed, large = picture(30), picture(30)
    mixed[90:140, 170:230] = picture(12)[90:140, 170:230]
    mixed, large = (cv2.warpAffine(one, turn, (320, 240), borderValue=(200, 200, 200)) for one in (mixed, large))
    detector = MarkerDetector("DICT_4X4_50", (0, 1))
    found, plain = detector.in_picture(mixed), detector.in_picture(large)
    assert np.isfinite(found).all()
    assert found[0].tolist() == plain[0].tolist()
    enlarged = detector._detect(detector._anywhere, cv2.cvtColor(mixed, cv2.COLOR_RGB2GRAY), 2)
    assert enlarged[0].tolist() != plain[0].tolist()
    assert found[1].tolist() == enlarged[1].tolist()


def test_a_sparing_detector_finds_markers_of_30_pixels_in_every_picture():
    assert seen(MarkerDetector("DICT_4X4_50", (0, 1), is_sparing=True), 30, 3) == [True, True, True]


@pytest.mark.parametrize("side", [16, 30, 60])
def test_a_marker_is_as_far_to_the_right_in_an_enlarged_window_as_in_its_picture(side):
    """Enlarged 4, 2 and 1 times. The middle of the columns 80 to 79 + side is at 79.5 + side / 2, rows likewise."""
    middle = np.array([79.5, 99.5]) + side / 2
    corners = MarkerDetector("DICT_4X4_50", (0, 1)).in_window(picture(side), 0, middle + 3.0, 1.5 * side, side)
    assert diagonal_crossing(corners) == pytest.approx(middle, abs=0.1)


def turned(side, angle, middle, finer=4):
    """A grey picture with marker 0 turned by an angle [degrees] about its middle [px], and its corners [px]."""
    marker = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50), 0, 60 * finer)
    turn = cv2.getRotationMatrix2D((0.0, 0.0), angle, side / 60)
    corners = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]) * 60 @ turn[:, :2].T + middle
    turn[:, 2] = (middle + 0.5) * finer - 0.5 - turn[:, :2] @ [30 * finer - 0.5, 30 * finer - 0.5]
    large = cv2.warpAffine(marker, turn, (160 * finer, 120 * finer), borderValue=200)
    grey = cv2.resize(large, (160, 120), interpolation=cv2.INTER_AREA)
    return np.repeat(grey[..., None], 3, axis=2), corners


@pytest.mark.parametrize("angle", [0, 8, 30, 45])
@pytest.mark.parametrize("side", [15, 22.5, 29, 34, 61])
def test_a_marker_has_its_whole_side_over_all_positions_between_pixels(side, angle):
    """Without the outermost half pixel it was short by 0.3 px enlarged 4 times, by 0.7 px twice, by 1 px once."""
    detector = MarkerDetector("DICT_4X4_50", (0, 1))
    sides, corners = [], []
    for part in range(5):
        middle = np.array([80.0, 60.0]) + np.array([part, (2 * part) % 5]) / 5
        image, true = turned(side, angle, middle)
        found = detector.in_window(image, 0, middle + 2.0, 1.5 * side, side)
        sides.append((quad_side(found), quad_side(detector.in_picture(image)[0])))
        corners.append(found - true)
    fine, coarse = np.mean(sides, axis=0)
    assert fine == pytest.approx(side, abs=0.2)
    assert coarse == pytest.approx(side, abs=0.5)  # the picture is not enlarged
    assert np.mean(corners, axis=0) == pytest.approx(np.zeros((4, 2)), abs=0.2)


def test_sides_move_outwards_by_half_a_pixel_along_a_row_or_a_column_however_corners_are_ordered():
    upright = np.array([[0.0, 0.0], [8.0, 0.0], [8.0, 6.0], [0.0, 6.0]])
    larger = [[-0.5, -0.5], [8.5, -0.5], [8.5, 6.5], [-0.5, 6.5]]
    assert _with_outermost_pixels(upright) == pytest.approx(np.array(larger))
    assert _with_outermost_pixels(upright[::-1]) == pytest.approx(np.array(larger[::-1]))
    diamond = np.array([[0.0, -4.0], [4.0, 0.0], [0.0, 4.0], [-4.0, 0.0]])  # |a| = |b|: half of 1 / sqrt(2)
    assert _with_outermost_pixels(diamond) == pytest.approx(diamond * 4.5 / 4.0)


def plain(number):
    """A grey picture with one marker of 60 px."""
    image = picture(60)
    hidden = 80 + 100 * (1 - number)
    image[90:170, hidden - 10 : hidden + 70] = 200
    return image


HANGER = Hanger(marker_size_m=0.06, marker_distance_m=0.3, held_m=((0.0, 0.1, 0.0), (0.3, 0.1, 0.0)), ids=(0, 1))


@pytest.mark.parametrize(
    ("shown", "sentence"),
    [(lambda image: image[:, ::-1], "mirror image"), (lambda image: 255 - image, "white on black")],
)
def test_markers_are_said_to_be_mirrored_or_inverted_only_where_both_are_seen(shown, sentence):
    assert sentence in seen_otherwise(np.ascontiguousarray(shown(picture(60))), HANGER)
    for number in (0, 1):
        assert seen_otherwise(np.ascontiguousarray(shown(plain(number))), HANGER) == ""


@pytest.mark.parametrize(
    ("rig", "sentence"),
    [
        ({"ids": (2, 3)}, "markers 0 and 1 are seen: set the rig's hanger.ids"),
        ({"dictionary": "DICT_5X5_100"}, "markers 0 and 1 of DICT_4X4_50 are seen: set the rig's hanger.dictionary"),
    ],
)
def test_markers_of_other_ids_or_another_dictionary_are_named_with_the_rigs_field(rig, sentence):
    assert seen_otherwise(picture(60), msgspec.structs.replace(HANGER, **rig)) == sentence


def test_three_markers_of_other_ids_are_named_in_order():
    image = np.concatenate([picture(60), picture(60, ids=(4, 7))], axis=0)
    said = seen_otherwise(image, msgspec.structs.replace(HANGER, ids=(2, 3)))
    assert said == "markers 0, 1, 4 and 7 are seen: set the rig's hanger.ids"


def test_a_window_without_its_marker_and_one_beside_the_picture_have_no_corners():
    detector = MarkerDetector("DICT_4X4_50", (0, 1))
    image = picture(30)
    for middle in ([40.0, 40.0], [-400.0, 40.0]):
        corners = detector.in_window(image, 0, np.array(middle), 30.0, 30.0)
        assert corners.shape == (4, 2)
        assert np.isnan(corners).all()

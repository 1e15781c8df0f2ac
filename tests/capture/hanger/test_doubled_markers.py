"""A marker id that appears twice, as with a printed sheet in view: the one near the other marker is chosen."""

from __future__ import annotations

import cv2
import msgspec
import numpy as np
import pytest

from capture.hanger.marker_detection import MarkerDetector
from capture.hanger.seen_otherwise import is_seen_twice, is_upside_down, seen_otherwise
from formats.rig import Hanger

SIDE = 24  # px


def picture(*placed):
    """A grey picture with markers, each (id, x, y) of its top left corner."""
    image = np.full((240, 640, 3), 200, np.uint8)
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    for number, x, y in placed:
        image[y : y + SIDE, x : x + SIDE] = cv2.aruco.generateImageMarker(dictionary, number, SIDE)[..., None]
    return image


def found(*placed, apart=5.0):
    corners = MarkerDetector("DICT_4X4_50", (0, 1), apart=apart).in_picture(picture(*placed))
    return corners.mean(1)


def test_the_one_that_is_five_sides_from_the_other_marker_is_the_hangers():
    """120 px apart at a side of 24 px; the other marker 0 is 350 px away."""
    middle = found((0, 100, 50), (1, 220, 50), (0, 570, 60))
    assert middle == pytest.approx(np.array([[111.5, 61.5], [231.5, 61.5]]), abs=1.0)


def test_of_two_that_fit_none_is_taken():
    assert np.isnan(found((0, 100, 50), (1, 220, 50), (0, 340, 50))).all()


def test_without_a_distance_a_marker_that_is_seen_twice_is_not_taken():
    middle = found((0, 100, 50), (1, 220, 50), (0, 570, 60), apart=None)
    assert np.isnan(middle[0]).all()
    assert np.isfinite(middle[1]).all()


HANGER = Hanger(marker_size_m=0.06, marker_distance_m=0.3, held_m=((-0.1, 0.1, 0.0), (0.1, 0.1, 0.0)), ids=(0, 1))


@pytest.mark.parametrize(
    ("placed", "said"),
    [
        (
            ((0, 100, 50), (0, 220, 50)),
            "marker 0 is seen twice, and marker 1 is not: print both markers of the rig",
        ),
        (
            ((1, 100, 50), (1, 220, 50)),
            "marker 1 is seen twice, and marker 0 is not: print both markers of the rig",
        ),
        (
            ((0, 100, 50), (1, 220, 50), (0, 340, 50)),
            "marker 0 is seen twice: leave only the hanger's own in view",
        ),
        (
            ((0, 100, 50), (1, 220, 50), (0, 100, 150), (1, 220, 150)),
            "markers 0 and 1 are seen twice: leave only the hanger's own in view",
        ),
        (((0, 100, 50), (1, 220, 50)), ""),
        (((0, 100, 50), (7, 220, 50), (7, 340, 50)), ""),
    ],
)
def test_a_marker_that_is_seen_twice_is_named_where_no_take_could_be_kept(placed, said):
    assert seen_otherwise(picture(*placed), HANGER) == said


DOTS = msgspec.structs.replace(HANGER, marker="dot")
OTHER = msgspec.structs.replace(HANGER, dictionary="DICT_6X6_250")


def test_a_marker_of_the_hangers_that_is_seen_twice_is_told():
    both, twice = picture((0, 100, 50), (1, 220, 50)), picture((0, 100, 50), (0, 220, 50))
    assert [is_seen_twice(colour, HANGER) for colour in (both, twice, None)] == [False, True, False]
    assert is_seen_twice(picture((0, 100, 50), (1, 220, 50), (7, 340, 50), (7, 460, 50)), HANGER) is False
    assert is_seen_twice(twice, DOTS) is False
    assert is_seen_twice(twice, OTHER) is False


def test_a_hanger_stands_on_its_head_where_both_its_markers_do():
    """Turned by a quarter, or one of the two alone, is another fault; the picture of dots tells nothing."""
    upright = picture((0, 100, 50), (1, 220, 50))
    turned = np.ascontiguousarray(upright[::-1, ::-1])
    one = upright.copy()
    one[50:74, 100:124] = upright[50:74, 100:124][::-1, ::-1]
    quarter = np.ascontiguousarray(np.rot90(upright))
    found = [is_upside_down(colour, HANGER) for colour in (upright, turned, one, quarter, None)]
    assert found == [False, True, False, False, False]
    assert is_upside_down(turned, DOTS) is False
    assert is_upside_down(turned, OTHER) is False
    assert is_upside_down(picture((0, 100, 50), (7, 220, 50))[::-1, ::-1], HANGER) is False


def test_a_picture_whose_rows_are_exchanged_is_no_mirror_that_can_be_switched_off():
    """Upside down it is its mirror image turned by half a circle, and read the other way round it is upright."""
    upright = picture((0, 100, 50), (1, 220, 50))
    by_rows, by_columns = np.ascontiguousarray(upright[::-1]), np.ascontiguousarray(upright[:, ::-1])
    mirror = "both are seen in the picture's mirror image: switch the sensor's mirror off"
    assert seen_otherwise(by_columns, HANGER) == mirror
    assert seen_otherwise(by_rows, HANGER) == (
        "both are seen with the picture's rows turned round: record the top row first, or turn the sensor over "
        "and switch off its mirror"
    )
    turned = "the file says that its pictures are mirrored, and both are read without that: set its xnMirror to 0"
    assert seen_otherwise(by_columns, HANGER, is_turned=True) == turned
    assert seen_otherwise(by_rows, HANGER, is_turned=True) == f"{turned} and turn the sensor over"


def test_nothing_is_told_of_dots_or_without_a_picture():
    assert seen_otherwise(None, HANGER) == ""
    assert seen_otherwise(picture((0, 100, 50), (0, 220, 50)), DOTS) == ""

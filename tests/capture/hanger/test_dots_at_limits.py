"""Dots exactly at their limits: whole numbers of colour, pixels and tints that hit each bound."""

from __future__ import annotations

import cv2
import msgspec
import numpy as np
import pytest

from capture.hanger.colour_dot_search import (
    LARGEST_COLOUR_DISTANCE,
    LEAST_CHROMA,
    _best_pair,
    _candidates,
    _tint,
)
from capture.hanger.colour_dots import FAINTEST, LEAST_COLOUR_SHARE, DotTracker, _background, dot_near
from capture.hanger.fiducial_tracker import ImageTrack
from tests.capture.hanger.test_dot_pairs import CAMERA, HANGER, candidate, chosen
from tests.capture.hanger.test_dot_tracks import GREY, LEFT, RED, RIG, RIGHT, disc, scene

DEPTH = np.full((480, 640), 1000, np.uint16)


def lab_of(colour):
    """a* and b* of a colour, as OpenCV rounds them."""
    pixel = cv2.cvtColor(np.array(colour, np.uint8).reshape(1, 1, 3), cv2.COLOR_RGB2LAB)[0, 0]
    return (pixel[1:].astype(int) - 128).tolist()


def found_in(*pixels, wall=GREY):
    """Number of candidates in a picture of one disc, whose left and right half may be of two colours."""
    picture = np.full((480, 640, 3), wall, np.uint8)
    inside = disc(*LEFT)
    picture[inside] = pixels[0]
    picture[inside & (np.arange(640) >= LEFT[0])] = pixels[-1]
    return len(_candidates(picture, DEPTH, HANGER, CAMERA))


@pytest.mark.parametrize(
    ("colour", "tint", "is_dot"),
    [
        ((163, 112, 126), [22, 0], False), ((167, 115, 130), [23, 0], True), ((168, 153, 115), [0, 22], False),
        ((168, 151, 112), [0, 23], True), ((94, 158, 146), [-23, 0], True), ((99, 128, 165), [0, -23], True),
    ],
)  # fmt: skip
def test_a_dots_chroma_is_more_than_22_along_either_axis(colour, tint, is_dot):
    assert lab_of(colour) == tint
    assert LEAST_CHROMA == 22.0
    assert found_in(colour) == is_dot


def test_a_dot_of_two_hues_within_a_sixth_of_the_circle_is_one_dot():
    """Hues of 4 and 56 degrees: half a disc of either is no dot, and 30 degrees on each side of 30 take in both."""
    low, high = (248, 90, 140), (200, 106, 45)
    assert [np.degrees(np.arctan2(b, a)) for a, b in map(lab_of, (low, high))] == pytest.approx([4.5, 56.0], abs=0.1)
    assert found_in(low, high) == 1


def test_a_grey_disc_on_a_coloured_wall_is_no_dot():
    assert found_in((130, 130, 130), wall=(200, 30, 30)) == 0
    assert found_in((200, 30, 30), wall=(130, 130, 130)) == 1


def test_a_colour_without_any_red_has_the_tint_of_that_colour():
    """A red of one would make it (73, -99)."""
    assert _tint(np.array([0.0, 3.0, 229.0])).tolist() == [72.0, -99.0]


def test_of_two_dots_one_above_the_other_the_better_one_counts_as_the_left_one():
    above, below = candidate(200.0, [0.0, 0.0, 1.0], 0.1), candidate(200.0, [0.0, 0.3, 1.0], 0.2)
    for pair in ([above, below], [below, above]):
        left, right = _best_pair(pair, 0.3, [None, None])
        assert left is pair[0].dot
        assert right is pair[1].dot


def test_a_dot_of_another_colour_ends_no_search_for_a_pair():
    """The second of three has another tint than red, the third has it."""
    red = np.array([255.0, 0.0, 0.0])
    three = [
        candidate(100.0, [0.0, 0.0, 1.0], 0.1, (80.0, 67.0)), candidate(150.0, [0.15, 0.0, 1.0], 0.2, (0.0, 60.0)),
        candidate(200.0, [0.3, 0.0, 1.0], 0.3, (80.0, 67.0)),
    ]  # fmt: skip
    assert chosen(three, [red, red]) == [100.0, 200.0]


def test_a_dot_has_its_colour_up_to_exactly_28():
    red = np.array([255.0, 0.0, 0.0])
    assert LARGEST_COLOUR_DISTANCE == 28.0
    for off, is_pair in ((28.0, True), (29.0, False)):
        pair = [candidate(100.0, [0, 0, 1], 0.1, (80.0 - off, 67.0)), candidate(200.0, [0.3, 0, 1], 0.1, (80.0, 67.0))]
        assert (chosen(pair, [red, red]) is not None) == is_pair


def test_a_pair_with_exactly_half_the_fault_of_the_next_is_chosen():
    """Exactly at the rig's distance: faults of 0.25 + 0.25 against 0.5 + 0.5."""
    best = [candidate(100.0, [0.0, 0.0, 0.0], 0.25), candidate(200.0, [0.3, 0.0, 0.0], 0.25)]
    for fault, columns in ((0.5, [100.0, 200.0]), (0.499, None)):
        other = [candidate(300.0, [0.0, 1.0, 0.0], 0.5), candidate(400.0, [0.3, 1.0, 0.0], fault)]
        assert chosen(best + other) == columns


def near(picture, centre=LEFT, reach=36.0, diameter=30.0, mark=RED):
    return dot_near(picture, np.array(centre, float), reach, diameter, np.array(mark, float))


@pytest.mark.parametrize(("green", "is_dot"), [(160, True), (161, False)])
def test_a_dot_40_apart_from_its_background_is_seen(green, is_dot):
    """Red is (200, 0, 0) of the one channel that differs."""
    assert FAINTEST == 40.0
    picture = np.full((480, 640, 3), (200, 200, 200), np.uint8)
    picture[disc(*LEFT)] = (200, green, 200)
    assert (near(picture, mark=(200, green, 200)) is not None) == is_dot


def test_a_pixel_of_exactly_a_quarter_of_a_dots_colour_is_beside_it():
    """Of 200 the pixels of a ring have 50 or 51: with them the piece and its rim are larger."""
    assert LEAST_COLOUR_SHARE == 0.25
    ring = disc(*LEFT, diameter=38.0) & ~disc(*LEFT)
    sizes = []
    for level in (50, 51):
        picture = np.full((480, 640, 3), 0, np.uint8)
        picture[ring] = (level, 0, 0)
        picture[disc(*LEFT)] = (200, 0, 0)
        sizes.append(near(picture, mark=(200, 0, 0)).diameter)
    # Outside of the rim of one pixel only a ring that belongs to the piece counts.
    assert sizes[1] - sizes[0] > 1.0


def test_a_colour_exactly_half_as_far_from_the_line_as_the_dot_is_another_one():
    """100 green beside 100 of 200 red; with 99 the ring belongs to the dot."""
    ring = disc(*LEFT, diameter=38.0) & ~disc(*LEFT)
    sizes = []
    for green in (100, 99):
        picture = np.full((480, 640, 3), 0, np.uint8)
        picture[ring] = (100, green, 0)
        picture[disc(*LEFT)] = (200, 0, 0)
        sizes.append(near(picture, mark=(200, 0, 0)).diameter)
    assert sizes[0] == pytest.approx(np.sqrt(4 * np.count_nonzero(disc(*LEFT)) / np.pi))
    assert sizes[1] > sizes[0] + 2.0


def test_what_is_less_than_the_background_takes_nothing_from_a_dot():
    """A dark ring about a bright dot on grey."""
    picture = np.full((480, 640, 3), 100, np.uint8)
    picture[disc(*LEFT, diameter=34.0)] = 60
    picture[disc(*LEFT)] = 200
    size = np.sqrt(4 * np.count_nonzero(disc(*LEFT)) / np.pi)
    assert near(picture, mark=(200, 200, 200)).diameter == pytest.approx(size)


@pytest.mark.parametrize(("pixels", "is_found"), [(20, True), (19, False)])
def test_a_piece_of_exactly_a_fifth_of_the_dots_box_is_found(pixels, is_found):
    """20 of 10 x 10 pixels."""
    picture = np.full((480, 640, 3), GREY, np.uint8)
    rows, columns = np.divmod(np.arange(pixels), 5)
    picture[200 + rows, 243 + columns] = RED
    assert (near(picture, reach=12.0, diameter=10.0) is not None) == is_found


def test_the_rim_of_a_dot_is_as_wide_above_as_below():
    """A blurred dot in the middle of a pixel stays there."""
    picture = np.full((480, 640, 3), 0, np.uint8)
    picture[disc(*LEFT)] = (200, 0, 0)
    blurred = cv2.GaussianBlur(picture, (0, 0), 4.0)
    assert near(blurred, mark=(200, 0, 0)).centre == pytest.approx(LEFT, abs=1e-4)


@pytest.mark.parametrize("centre", [(639.0, 200.0), (245.0, 479.0)])
def test_a_dot_that_the_picture_cuts_off_by_half_is_none(centre):
    """A window of 0.6 diameters and a pixel at the right or lower end."""
    picture = np.full((480, 640, 3), GREY, np.uint8)
    picture[disc(*centre)] = RED
    assert near(picture, centre=centre, reach=18.0) is None


def test_the_background_is_that_of_the_pixels_farthest_in_colour_even_where_all_of_them_are_alike():
    """Of a window of 4 x 4 nine pixels are a dot's; the others are all of one grey."""
    window = np.full((4, 4, 3), 200.0, np.float32)
    window[:3, :3] = (200.0, 0.0, 0.0)
    assert _background(window, np.array([200.0, 0.0, 0.0]), 3.5).tolist() == [200.0, 200.0, 200.0]


def carded(*places):
    """Dots on grey cards of 2.7 diameters before a wall; the card's grey is a mixture of the wall and a dot."""
    picture = np.full((480, 640, 3), (24, 216, 216), np.uint8)
    for x, y in places:
        picture[int(y) - 40 : int(y) + 41, int(x) - 40 : int(x) + 41] = 120
        picture[disc(x, y)] = (200, 40, 40)
    return picture


def test_a_found_or_picked_dot_is_measured_against_what_is_next_to_it():
    """Within one and a half diameters, or 1.2, is mostly the card; within more than two, mostly the wall."""
    picture = carded(LEFT, RIGHT)
    size = np.sqrt(4 * np.count_nonzero(disc(*LEFT)) / np.pi)
    assert near(picture, reach=66.0, mark=(200, 40, 40)).diameter > 1.5 * size
    for picks in (None, np.array([LEFT, RIGHT])):
        dots = DotTracker(RIG, picks)._dots(picture, DEPTH, 0.0)
        assert [dot.diameter for dot in dots] == pytest.approx([size, size], rel=1e-3)


def test_of_two_tracks_updated_together_the_one_that_expected_a_dot_nearer_gets_it():
    """The dot is 10 px left of where one expects it and 20 px right of where the other does; or 10 px from both."""
    tracker, (picture, _) = DotTracker(RIG), scene(LEFT)
    dot = near(picture)
    for expected, kept in (((10.0, -20.0), 0), ((-20.0, 10.0), 1), ((-10.0, 10.0), 0)):
        tracker._tracks = [ImageTrack(0.0, np.add(LEFT, [x, 0.0]), np.zeros(2), 30.0) for x in expected]
        dots = [dot, dot]
        tracker._drop_doubled(dots, 0.1)
        assert [one is not None for one in dots] == [k == kept for k in range(2)]


def test_whole_numbers_of_a_rigs_colours_are_its_colours():
    told = msgspec.structs.replace(RIG, hanger=msgspec.structs.replace(HANGER, dot_colours=((200, 0, 0), (200, 0, 0))))
    assert DotTracker(told).track(*scene(LEFT, RIGHT), 0.0).is_found

"""Which regions of a drawn picture are dots, and which two of them are the hanger's."""

from __future__ import annotations

import colorsys
import math

import msgspec
import numpy as np
import pytest

from capture.hanger.colour_dot_search import (
    Dot,
    _best_of_each_place,
    _best_pair,
    _Candidate,
    _candidates,
    _judge,
    _tint,
)
from formats.rig import Hanger, Sensor

CAMERA = Sensor(width=640, height=480, fx=500.0, fy=500.0, cx=319.5, cy=239.5)
HANGER = Hanger(marker="dot", marker_size_m=0.06, marker_distance_m=0.3, held_m=((-0.2, 0.09, 0.0), (0.2, 0.09, 0.0)))
NO_COLOURS = [None, None]


def candidate(column, place, fault, tint=(40.0, 30.0)):
    """A candidate in a column [px] of the picture, at a place [m], so far from an ideal dot."""
    dot = Dot(np.array([column, 100.0]), 10.0, np.array([200.0, 30.0, 30.0]))
    return _Candidate(dot, np.array(place, float), np.array(tint), fault)


def chosen(candidates, colours=NO_COLOURS):
    """The columns of the left and of the right dot."""
    found = _best_pair(candidates, 0.3, colours)
    return None if found is None else [dot.centre[0] for dot in found]


@pytest.mark.parametrize(("share", "is_pair"), [(1.079, True), (0.921, True), (1.081, False), (0.919, False)])
def test_two_dots_as_far_apart_as_the_rig_says_within_eight_per_cent_are_a_pair(share, is_pair):
    """Two, three and six sevenths of the distance along x, y and z."""
    apart = 0.3 * share * np.array([2.0, 3.0, 6.0]) / 7
    pair = [candidate(400.0, apart, 0.1), candidate(200.0, [0.0, 0.0, 0.0], 0.1)]
    assert chosen(pair) == ([200.0, 400.0] if is_pair else None)
    assert chosen(pair[::-1]) == chosen(pair)


@pytest.mark.parametrize(("fault", "is_chosen"), [(0.81, True), (0.79, False)])
def test_a_pair_is_chosen_that_has_half_the_fault_of_the_next(fault, is_chosen):
    """0.1 and 0.2 of the dots, and 0.5 for 4 % of the distance: 0.8. The other pair, a metre away, has twice that."""
    best = [candidate(100.0, [0.0, 0.0, 0.0], 0.1), candidate(200.0, [0.96 * 0.3, 0.0, 0.0], 0.2)]
    next_best = [candidate(300.0, [0.0, 1.0, 0.0], fault), candidate(400.0, [0.3, 1.0, 0.0], 0.8)]
    for order in (best + next_best, next_best + best):
        assert chosen(order) == ([100.0, 200.0] if is_chosen else None)
    assert chosen(best) == [100.0, 200.0]
    assert chosen(best[:1]) is None


@pytest.mark.parametrize(("off", "is_pair"), [(27.9, True), (28.1, False)])
@pytest.mark.parametrize("row", [0, 1])
def test_a_dot_of_a_known_colour_has_it_within_28_of_lab(off, row, is_pair):
    """Red has (80, 67). The other dot's colour may be any."""
    tints = [(80.0, 67.0), (80.0, 67.0)]
    tints[row] = (80.0 - 0.6 * off, 67.0 - 0.8 * off)
    pair = [candidate(100.0, [0.0, 0.0, 1.0], 0.1, tints[0]), candidate(200.0, [0.3, 0.0, 1.0], 0.1, tints[1])]
    red = np.array([255.0, 0.0, 0.0])
    colours = [red if k == row else None for k in range(2)]
    assert (chosen(pair, colours) is not None) == is_pair
    assert (chosen(pair, [red, red]) is not None) == is_pair
    assert chosen(pair, colours[::-1]) is not None


def test_the_tint_of_greys_is_none_and_of_red_that_of_cie():
    """L*a*b* of pure red is (53, 80, 67). Shares of a colour are rounded, and none is above 255."""
    assert _tint(np.array([90.0, 90.0, 90.0])).tolist() == [0.0, 0.0]
    assert _tint(np.array([254.6, -3.0, 0.4])).tolist() == [80.0, 67.0]
    assert _tint(np.array([300.0, 0.0, 0.0])).tolist() == [80.0, 67.0]


def test_of_two_candidates_nearer_than_half_a_diameter_the_better_one_stays():
    for apart, count in ((5.0, 1), (5.1, 2)):
        for faults in ((0.1, 0.2), (0.2, 0.1)):
            two = [candidate(100.0 + apart * k, [0.0, 0.0, 1.0], faults[k]) for k in range(2)]
            kept = _best_of_each_place(two)
            assert len(kept) == count
            assert kept[0].fault == 0.1


def pictured(*shapes, size=(120, 160), behind=128):
    """A grey picture with regions, each a mask of the whole picture and its colour, all of it a metre away."""
    picture = np.full((*size, 3), behind, np.uint8)
    for mask, colour in shapes:
        picture[mask] = colour
    return picture, np.full(size, 1000, np.uint16)


def ellipse(x, y, width, height, size=(120, 160)):
    """The mask of an ellipse with its middle at (x, y), as wide and as high as its bounding box."""
    rows, columns = np.indices(size)
    return ((columns - x) / (0.5 * width)) ** 2 + ((rows - y) / (0.5 * height)) ** 2 <= 1.0


def found_in(picture, depth, diameter=30.0):
    """The candidates for dots so wide a metre away [px]."""
    hanger = msgspec.structs.replace(HANGER, marker_size_m=diameter / 500.0)
    return _candidates(picture, depth, hanger, CAMERA)


@pytest.mark.parametrize("hue", range(0, 360, 10))
def test_a_dot_of_any_hue_is_one_candidate_with_its_own_colour_and_place(hue):
    """Its middle is 269.5 px left of and 189.5 px above the principal point, a metre away."""
    colour = np.rint(255 * np.array(colorsys.hsv_to_rgb(hue / 360, 0.8, 0.8)))
    (only,) = found_in(*pictured((ellipse(50, 50, 30, 30), colour)))
    assert only.dot.centre == pytest.approx([50.0, 50.0])
    assert only.dot.colour.tolist() == colour.tolist()
    assert only.place == pytest.approx([-269.5 / 500, -189.5 / 500, 1.0])


@pytest.mark.parametrize(("amount", "is_dot"), [(24, False), (28, True)])
def test_a_dot_has_more_chroma_than_22(amount, is_dot):
    """Reds that are redder than their grey by so much have the chroma 20.6 and 23.8."""
    colour = (128 + 1.5 * amount, 128 - 0.5 * amount, 128 - 0.5 * amount)
    assert 0.0 < (np.linalg.norm(_tint(np.array(colour))) - 22.0) * (1 if is_dot else -1) < 2.0
    assert bool(found_in(*pictured((ellipse(50, 50, 30, 30), colour)))) == is_dot


@pytest.mark.parametrize(
    ("width", "height", "is_dot"), [(17, 10, True), (18, 10, False), (10, 17, True), (10, 18, False)]
)
def test_a_dot_is_at_most_1_7_times_as_long_as_wide(width, height, is_dot):
    middle = (60 + 0.5 * (width - 1), 60 + 0.5 * (height - 1))
    shape = ellipse(*middle, width, height)
    assert [int(np.ptp(one)) + 1 for one in np.nonzero(shape)] == [height, width]
    assert bool(found_in(*pictured((shape, (200, 30, 30))), diameter=math.sqrt(width * height))) == is_dot


@pytest.mark.parametrize(("count", "is_dot"), [(16, True), (15, False)])
def test_a_dot_has_sixteen_pixels(count, is_dot):
    """Of a box of 5 x 5: three fifths of it or more, so that its fill is a dot's."""
    mask = np.zeros((120, 160), bool)
    mask[50:55, 50:55] = [[0, 0, 1, 0, 0], [0, 1, 1, 1, 0], [1, 1, 1, 1, 1], [0, 1, 1, 1, 0], [0, 1, 1, 1, 1]]
    mask[54, 54] = count == 16
    assert np.count_nonzero(mask) == count
    assert bool(found_in(*pictured((mask, (200, 30, 30))), diameter=5.0)) == is_dot


def judged(inside, known=None):
    """The candidate for a region whose dot is as large as the region; depth is known in its first pixels."""
    depth = np.zeros(inside.shape, np.uint16)
    rows, columns = np.nonzero(inside)
    depth[rows[:known], columns[:known]] = 1000
    hanger = msgspec.structs.replace(HANGER, marker_size_m=math.sqrt(4 * len(rows) / math.pi) / 500.0)
    return _judge(inside, np.full((*inside.shape, 3), 200, np.uint8), depth, np.zeros(2), hanger, CAMERA)


@pytest.mark.parametrize(("count", "is_dot"), [(59, False), (60, True), (98, True), (99, False)])
def test_a_dot_fills_three_fifths_to_49_fiftieths_of_its_box(count, is_dot):
    assert (judged(np.arange(100).reshape(10, 10) < count) is not None) == is_dot


@pytest.mark.parametrize(("known", "is_dot"), [(24, True), (23, False)])
def test_a_dot_has_depth_in_three_tenths_of_its_pixels(known, is_dot):
    """Of 80 pixels 24 are three tenths."""
    assert (judged(np.arange(100).reshape(10, 10) < 80, known) is not None) == is_dot

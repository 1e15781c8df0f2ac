"""Which coloured regions are dots, by area and shape in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest

from capture.hanger.colour_dot_search import _judge, find_pair
from formats.rig import Hanger, Sensor

CAMERA = Sensor(width=640, height=480, fx=500.0, fy=500.0, cx=319.5, cy=239.5)
HANGER = Hanger(marker="dot", marker_size_m=0.06, marker_distance_m=0.3, held_m=((-0.2, 0.09, 0.0), (0.2, 0.09, 0.0)))


def region(size):
    """A disc of a diameter [px], and its box."""
    along = np.arange(size) - 0.5 * (size - 1)
    return along[:, None] ** 2 + along**2 <= 0.25 * size**2


def judged(inside, z=1.0, middle=(319.5, 239.5), depth=None):
    colour = np.full((*inside.shape, 3), 200, np.uint8)
    depth = np.full(inside.shape, round(1000 * z), np.uint16) if depth is None else depth
    return _judge(inside, colour, depth, np.array(middle), HANGER, CAMERA)


def test_a_disc_of_a_dots_diameter_has_its_area_its_fill_and_its_position():
    """60 mm at 1 m are 30 px. The fault is what its pixels differ by from pi / 4 of its box, in area and in fill."""
    found = judged(region(30), middle=(369.5, 219.5))
    share = np.count_nonzero(region(30)) / 900
    assert found.dot.diameter == pytest.approx(30.0)
    assert found.fault == pytest.approx(abs(math.log(share / (math.pi / 4))) + abs(share - math.pi / 4))
    assert found.fault < 0.03
    assert found.place == pytest.approx([0.1, -0.04, 1.0])


@pytest.mark.parametrize(("z", "is_dot"), [(1.0, True), (0.75, True), (0.73, False), (1.25, True), (1.27, False)])
def test_a_disc_of_another_area_is_no_dot(z, is_dot):
    """Its area, as a share of a dot's at its depth, is z^2: from 0.55 = 0.742^2 to 1.6 = 1.265^2."""
    assert (judged(region(30), z) is not None) == is_dot


def test_a_full_box_is_no_dot_and_neither_is_one_without_depth_in_three_tenths_of_it():
    assert judged(np.ones((28, 28), bool)) is None
    depth = np.zeros((30, 30), np.uint16)
    inside = region(30)
    rows, columns = np.nonzero(inside)
    for share, is_dot in ((0.31, True), (0.29, False)):
        some = depth.copy()
        count = int(share * len(rows))
        some[rows[:count], columns[:count]] = 1000
        assert (judged(inside, depth=some) is not None) == is_dot


@pytest.mark.parametrize(("colours", "is_found"), [((200, 30, 30), True), ((30, 30, 200), False)])
def test_a_pair_of_the_wanted_colours_is_found_though_one_of_another_comes_first(colours, is_found):
    """Two red dots 0.3 m apart below two green ones 0.5 m apart, all 1 m away: 30 px of diameter, 150 and 250 px."""
    picture = np.full((480, 640, 3), 128, np.uint8)
    depth = np.full((480, 640), 1000, np.uint16)
    rows, columns = np.indices(depth.shape)
    for x, y, colour in ((195, 100, (30, 160, 30)), (445, 100, (30, 160, 30)), (245, 300, (200, 30, 30)),
                         (395, 300, (200, 30, 30))):  # fmt: skip
        picture[np.hypot(columns - x, rows - y) <= 15] = colour
    wanted = [np.array(colours, float)] * 2
    found = find_pair(picture, depth, HANGER, CAMERA, wanted)
    assert (found is not None) is is_found
    if found is not None:
        assert [dot.centre.round().tolist() for dot in found] == [[245, 300], [395, 300]]

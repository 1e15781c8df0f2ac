"""The visible share of a point's neighbourhood, computed by hand: facing, rotated, edge-on, folded, in the shadow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from firmware_host.synthetic.scene import CAMERA
from firmware_host.synthetic.surroundings import Panel
from firmware_host.synthetic.visibility import NEIGHBOURHOOD, _as_noise_shows
from tests.capture.garment.garment_scenes import hung
from tests.firmware_host.rooms import plain

CENTRE = 4


def turned(degrees):
    """A swatch at 1.6 m, turned about the upright line through its middle."""
    world = hung("swatch", 1.6)
    angle, middle = np.radians(degrees), world.points[0, CENTRE]
    turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    return replace(
        world, nodes=(world.nodes - middle) @ turn.T + middle, points=(world.points - middle) @ turn.T + middle
    )


def sight(world):
    return world.sight(0, world.renderer())


@pytest.mark.parametrize(("degrees", "share", "within"), [(0, 1.0, 0.02), (60, 0.5, 0.03), (70, 0.342, 0.1)])
def test_the_share_of_cloth_in_the_open_is_the_cosine_of_its_turn(degrees, share, within):
    """The middle's disc of 20 mm has 163 pixels at 1.6 m. At 70 degrees it is 4.9 pixels wide: a column more or less.

    Columns at its sides are short, so that one of them is a tenth of the disc.
    """
    seen = sight(turned(degrees))
    assert seen.share[CENTRE] == pytest.approx(share, rel=within)
    facing = np.pi * NEIGHBOURHOOD**2 * CAMERA.fx * CAMERA.fy / 1.6**2
    assert seen.pixels[CENTRE] == pytest.approx(share * facing, rel=within)
    assert seen.visible[CENTRE]


@pytest.mark.parametrize("degrees", [-85, 85])
def test_cloth_that_is_turned_edge_on_is_neither_visible_nor_hidden(degrees):
    """The middle's disc is 40 mm cos 85 degrees wide, 1.25 pixels: the centre of one column at least is in it."""
    seen = sight(turned(degrees))
    assert seen.pixels[CENTRE] > 0
    assert not seen.visible[CENTRE]
    assert not seen.hidden[CENTRE]


@pytest.mark.parametrize("degrees", [-88, 88])
def test_cloth_between_the_rays_of_two_pixels_is_hidden(degrees):
    """At 88 degrees the disc is half a pixel wide. The middle is at column 319.5, between two pixels' centres."""
    assert sight(turned(degrees)).hidden[CENTRE]


def test_a_corner_folded_behind_the_cloth_is_hidden_and_the_others_are_clearly_visible():
    corner = np.array([0.2, -0.42])
    seen = sight(hung("swatch", 1.6, fold=(corner - [0.14, 0.0], corner + np.array([0.0, 0.14]))))
    assert seen.hidden.tolist() == [False, False, True, False, False]
    assert seen.visible.tolist() == [True, True, False, True, True]


def test_cloth_in_the_projectors_shadow_is_not_visible_though_the_camera_sees_it():
    """A panel 0.35 m before the cloth, to the right of a corner: its shadow is 43.2 px m (1/1.25 - 1/1.6) = 7.6 px."""
    world = hung("skirt", 1.6)
    x, y, _ = world.points[0, 3] * (1.25 / 1.6)
    beside = Panel(x + 0.008, x + 0.3, y - 0.1, y + 0.1, 1.25, 150.0)
    world = replace(world, in_front=((beside,),) * 2, surroundings=plain(1.6))
    seen = sight(world)
    assert seen.in_view[3]
    assert not seen.visible[3]


def test_a_strip_one_pixel_wide_is_lost_in_the_noise_and_one_of_two_pixels_is_not():
    strip = np.zeros((30, 30), bool)
    strip[5:25, 10] = True
    assert _as_noise_shows(strip).max() == pytest.approx(0.4987, abs=1e-3)
    strip[5:25, 11] = True
    assert _as_noise_shows(strip).max() == pytest.approx(0.727, abs=1e-3)

"""The area that peeks out around a corner, pixel by pixel."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from capture.garment.peeking import peeking_area
from formats.rig import Sensor

CAMERA = Sensor(width=640, height=480, fx=500.0, fy=500.0, cx=320.0, cy=240.0)
HELD = np.array([[-0.2, -0.3, 1.5], [0.2, -0.3, 1.5]])  # at row 140 of the picture
CORNER = np.array([320.0, 300.0])
PIXEL = (1.5 / 500.0) ** 2  # m^2 at the garment's 1.5 m
TOP, LEFT = 200, 200  # of the silhouette's window; the corner is its row 100 and column 120


def scene(depth=1550, rows=slice(80, 90), columns=slice(120, 130)):
    """Return a garment at 1.5 m around the corner, and a patch of ten by ten pixels of another surface."""
    raw, garment = np.zeros((240, 260), np.uint16), np.zeros((240, 260))  # mm and m
    raw[96:105, 116:125], garment[96:105, 116:125] = 1500, 1.5
    raw[rows, columns] = depth
    return SimpleNamespace(raw=raw, depth=garment, window=SimpleNamespace(left=LEFT, top=TOP))


def peeking(silhouette, *, missing=0.1, ways=(1.0, 1.0), held=HELD):
    """The area in pixels of the garment's distance."""
    return peeking_area(silhouette, CORNER, missing, held, np.array(ways), CAMERA) / PIXEL


def test_a_patch_beside_the_corner_is_as_large_as_its_pixels():
    """Those of its corners have three neighbours in it; one that shows nothing is none of it."""
    assert peeking(scene()) == pytest.approx(100.0)
    holed = scene()
    holed.raw[85, 125] = 0
    assert peeking(holed) == pytest.approx(99.0)
    held = scene()
    held.depth[85, 125] = 1.55  # a pixel of the silhouette itself
    assert peeking(held) == pytest.approx(99.0)


def test_a_line_of_single_pixels_is_noise_of_the_rim():
    assert peeking(scene(rows=slice(80, 81))) == 0.0
    assert peeking(scene(rows=slice(80, 82))) == pytest.approx(20.0)


@pytest.mark.parametrize(("depth", "counts"), [(1304, False), (1305, True), (1306, True), (1694, True), (1696, False)])
def test_the_hidden_corner_is_sought_within_one_and_a_half_times_the_missing_cloth_in_depth(depth, counts):
    """100 mm and 30 more, by 1.5: 195 mm before and behind 1.5 m."""
    assert (peeking(scene(depth)) > 0.0) == counts


@pytest.mark.parametrize(("row", "counts"), [(59, True), (55, False)])
def test_the_hidden_corner_is_sought_within_the_missing_cloth_in_the_picture(row, counts):
    """0.13 m are 43 pixels at 1.5 m: two rows that end so far above the corner."""
    found = peeking(scene(rows=slice(row, row + 2), columns=slice(115, 126)))
    assert (found > 15.0) == counts


def test_a_corner_more_than_a_quarter_of_a_metre_away_is_not_sought():
    """0.25 and 0.03 m are 93 pixels, of which 90 are used."""
    far = scene(rows=slice(11, 16), columns=slice(115, 126))
    assert peeking(far, missing=0.25) == pytest.approx(55.0, abs=12.0)
    assert peeking(scene(rows=slice(4, 9), columns=slice(115, 126)), missing=9.0) == 0.0
    assert peeking(far, missing=0.2) == 0.0  # 77 pixels


def test_cloth_is_no_farther_from_the_held_ends_than_on_the_flat_garment():
    """The patch is 0.42 to 0.45 m below the ends and 0.17 to 0.23 m aside: 0.45 to 0.51 m away from either."""
    assert peeking(scene(), ways=(0.49, 0.49)) == pytest.approx(100.0)  # 1.03 times that and 20 mm
    assert peeking(scene(), ways=(0.40, 0.49)) == 0.0
    assert peeking(scene(), ways=(0.49, 0.38)) == 0.0


def test_pixels_less_than_forty_millimetres_below_the_held_edge_are_the_hangers():
    """13 pixels at 1.5 m: of an edge at row 266 of the picture all of the patch, rows 280 to 289, and not at 280."""
    for y, counts in ((0.078, 100.0), (0.12, 0.0)):
        lower = HELD + np.array([0.0, 0.3 + y, 0.0])
        assert peeking(scene(), held=lower) == pytest.approx(counts)


@pytest.mark.parametrize(("right", "counts"), [(0.3, 100.0), (0.6, 0.0)])
def test_a_held_edge_that_slopes_is_where_its_line_is(right, counts):
    """From row 140 to 340 or 440 over 133 columns: above the patch, or through it."""
    assert peeking(scene(), held=np.array([[-0.2, -0.3, 1.5], [0.2, right, 1.5]])) == pytest.approx(counts)


def test_a_pixel_of_unequal_focal_lengths_has_the_area_of_both():
    """1.5 m / 500 px across, and 1.5 m / 400 px down."""
    camera = Sensor(width=640, height=480, fx=500.0, fy=400.0, cx=320.0, cy=240.0)
    area = peeking_area(scene(), CORNER, 0.1, HELD, np.ones(2), camera)
    assert area == pytest.approx(100 * (1.5 / 500) * (1.5 / 400))


def test_the_missing_cloth_is_sought_in_a_disc():
    """38 rows above and 30 columns aside are 48 pixels away, and 0.13 m are 43."""
    assert peeking(scene(rows=slice(60, 64), columns=slice(149, 153))) == 0.0


def test_a_point_out_of_the_window_shows_nothing():
    assert peeking_area(scene(), np.array([90.0, 90.0]), 0.1, HELD, np.ones(2), CAMERA) == 0.0


def test_the_corner_is_as_far_away_as_the_cloth_around_it_and_as_the_held_edge_where_it_has_no_depth():
    near = scene(depth=1250)
    near.depth[96:105, 116:125] = 1.2
    assert peeking(near) == pytest.approx(100.0 * (1.2 / 1.5) ** 2)
    bare = scene()
    bare.depth[:] = 0.0
    bare.raw[96:105, 116:125] = 0
    assert peeking(bare) == pytest.approx(100.0)


@pytest.mark.parametrize(("apart", "counts"), [(0.0, True), (0.0018, False)])
def test_a_held_edge_that_is_upright_in_the_picture_has_no_slope(apart, counts):
    """At 0.6 columns from end to end it falls 33 rows a column, and the patch's right columns lie above its line."""
    held = np.array([[-0.5 * apart, -0.3, 1.5], [0.5 * apart, -0.24, 1.5]])
    assert (peeking(scene(), held=held) == pytest.approx(100.0)) == counts

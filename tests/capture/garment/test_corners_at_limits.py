"""Corners, flat garments and distances at their limits: short sides, exact bounds, and outlines beside the origin."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from capture.depth.surface import LATERAL_SD
from capture.errors import UntrackableError
from capture.garment import corners as module
from capture.garment.corners import (
    FARTHEST_REFINEMENT,
    FLATTEST_CROSSING,
    HARRIS_SD,
    HELD_LINE_SD,
    SHORTEST_ARM,
    STRONG_CORNER,
    PanelCorners,
    ShirtCorners,
    _line_through,
    _refined,
    _side_line,
    _strong_corners,
)
from capture.garment.flat_garment import GRID_STEP, _laid_flat
from capture.garment.geodesic import _spacing
from capture.garment.occlusion import folded_away, is_behind_something
from tests.capture.garment.flat_cloth import LEFT, LEFT_TOP, TOP, WHOLE, line_sd, rectangle, silhouette
from tests.capture.garment.test_corners import SIDES, row_of, window_held
from tests.capture.garment.test_flat_garment import OUTLINE, of, skirt


@pytest.mark.parametrize(
    ("mask", "first", "last"), [(WHOLE, (20, 20), (179, 139)), (np.ones((60, 60)), (0, 0), (59, 59))]
)
def test_the_pixels_of_an_outline_within_five_of_its_corners_are_strong_wherever_the_picture_ends(mask, first, last):
    cloth = silhouette(mask)
    near = np.minimum(cloth.outline - first, np.subtract(last, cloth.outline))
    assert _strong_corners(cloth).tolist() == np.flatnonzero((near <= 5).all(1)).tolist()


def test_strong_corners_are_those_of_harris_and_stephens():
    """Determinant less 0.04 of the squared trace of the gradients' products, summed over 5 x 5, at half the size."""
    rows, columns = np.indices(WHOLE.shape)
    turned = np.abs(0.9 * (columns - 100) + 0.4 * (rows - 80)) + np.abs(0.5 * (rows - 80) - 0.2 * (columns - 100))
    cloth = silhouette(turned < 55)
    half = np.pad(cv2.resize(cloth.mask, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA).astype(float), 9)
    x, y = (cv2.Sobel(half, cv2.CV_64F, *axis, ksize=3) for axis in ((1, 0), (0, 1)))
    xx, xy, yy = (cv2.boxFilter(product, -1, (5, 5), normalize=False) for product in (x * x, x * y, y * y))
    response = xx * yy - xy**2 - 0.04 * (xx + yy) ** 2
    u, v = (cloth.outline.astype(int) // 2 + 9).T
    strength = response[v, u]
    assert _strong_corners(cloth).tolist() == np.flatnonzero(strength > STRONG_CORNER * strength.max()).tolist()


def test_two_held_ends_within_a_pixel_give_a_line_with_a_unit_normal():
    line = _line_through(np.array([[1.0, 2.0], [1.3, 2.4]]))
    assert line[:2] == pytest.approx([-0.8, 0.6])


def test_a_held_edge_that_runs_by_a_lower_corner_does_not_hold_it():
    """From the first corner by the third: 159 px along and 119 px down."""
    found = PanelCorners().find(silhouette(WHOLE), window_held([20, 20], [20 + 79.5, 20 + 59.5]), SIDES)
    assert found.pixels[2] == pytest.approx(LEFT_TOP + np.array([179.5, 139.5]), abs=0.2)
    assert found.sd.dtype == float


@pytest.mark.parametrize(("above", "is_refined"), [(10.0, True), (10.001, False)])
def test_a_held_edge_exactly_ten_pixels_from_a_corner_refines_it(above, is_refined):
    assert FARTHEST_REFINEMENT == 10.0
    found = PanelCorners().find(silhouette(WHOLE), window_held([20, 20 - above], [179, 20 - above]), SIDES)
    assert (found.sd[0, 1] == HELD_LINE_SD) == is_refined


def ring(width, height):
    """The outline of a rectangle, clockwise from its upper left pixel."""
    u, v = np.arange(width), np.arange(height)
    return np.concatenate([
        np.stack([u[:-1], 0 * u[:-1]], 1), np.stack([0 * v[:-1] + width - 1, v[:-1]], 1),
        np.stack([u[:0:-1], 0 * u[:-1] + height - 1], 1), np.stack([0 * v[:-1], v[:0:-1]], 1),
    ]).astype(float)  # fmt: skip


def test_a_side_to_the_opposite_pixel_of_an_outline_goes_forwards():
    """As far either way: along the upper side."""
    outline = ring(160, 120)
    line, _ = _side_line(outline, 0, len(outline) // 2, outline.mean(0), 45.0, None)
    assert line == pytest.approx([0.0, -1.0, -0.5], abs=1e-9)


@pytest.mark.parametrize(("mask", "turned"), [(rectangle(20, 20, 59, 139, (160, 200)), False),
                                              (rectangle(120, 20, 179, 39, (160, 200)), True)])  # fmt: skip
def test_sides_of_a_narrow_or_a_flat_garment_lie_outside_of_it(mask, turned):
    """Wherever it hangs in its window, half a pixel outwards of its outermost pixels."""
    found = PanelCorners().find(silhouette(mask), window_held([20, 20], [59, 20]) if not turned else
                                window_held([120, 20], [179, 20]), np.full((4, 2), 40.0))  # fmt: skip
    lower = [[179.5, 39.5], [119.5, 39.5]] if turned else [[59.5, 139.5], [19.5, 139.5]]
    assert found.pixels[2:] == pytest.approx(LEFT_TOP + np.array(lower), abs=1e-6)


@pytest.mark.parametrize("above", [0.5, 0.0])
def test_a_side_near_the_middle_of_its_outline_keeps_its_outward_side(above):
    """The middle lies half a pixel above the row, or on it: outwards is down."""
    outline = np.stack([np.arange(200.0), np.zeros(200)], 1)
    line, _ = _side_line(outline, 0, 80, np.array([24.0, -above]), 45.5, None)
    assert line == pytest.approx([0.0, 1.0, -0.5], abs=1e-9)


def test_a_pixel_exactly_two_and_a_half_scatters_from_a_side_does_not_count():
    """The middle one of 43, 2 px off the line through all of them, where the least scatter is 0.8 px."""
    heights = np.zeros(46)
    heights[24], heights[[14, 34]] = 2.0, -1.0
    assert 2.5 * LATERAL_SD == 2.0
    _, sd = row_of(heights)
    assert sd == pytest.approx(line_sd(np.delete(np.arange(3, 46), 21), np.delete(heights[3:], 21)))


def test_lines_that_cross_exactly_ten_pixels_away_or_at_the_flattest_angle_refine():
    """Six right and eight down; a sine of 0.34."""
    assert FLATTEST_CROSSING == 0.34
    upright, level = np.array([1.0, 0.0, -6.0]), np.array([0.0, 1.0, -8.0])
    assert _refined(np.zeros(2), [(upright, 0.2), (level, 0.3)])[0].tolist() == [6.0, 8.0]
    flat = np.array([math.sqrt(1 - 0.34**2), 0.34, 0.0])
    for line, is_refined in ((flat, True), (np.array([flat[0], np.nextafter(0.34, 0.0), 0.0]), False)):
        _, sd = _refined(np.zeros(2), [(np.array([1.0, 0.0, 0.0]), 0.2), (line, 0.3)])
        assert (sd[0] != HARRIS_SD) == is_refined


@pytest.mark.parametrize("corner", [0, 2])
def test_a_line_is_no_longer_than_three_fifths_of_the_side_in_view(corner):
    """Of 49 px from corner to corner 29.4, though the flat garment's are longer: 27 pixels from 3 px on."""
    outline = ring(50, 50)
    for neighbour in (1, 3):
        line = _side_line(outline, 49 * corner, 49 * neighbour, outline.mean(0), 45.0, None)
        assert line[1] == pytest.approx(line_sd(np.arange(3, 30)))


@pytest.mark.parametrize(("longest", "is_line"), [(10.0, True), (9.9, False)])
def test_eight_pixels_are_a_line(longest, is_line):
    """From 3 to 10 px."""
    assert SHORTEST_ARM == 8
    outline = ring(160, 120)
    assert (_side_line(outline, 0, 159, outline.mean(0), longest, None) is not None) == is_line


@pytest.mark.parametrize("seed", range(6))
def test_a_side_has_the_scatter_of_all_its_pixels(seed):
    """43 pixels, symmetric about the middle one; none lies beyond 2.5 scatters, so that all of them count twice."""
    away = np.abs(np.arange(46) - 24)
    heights = np.random.default_rng(seed).uniform(-3.0, 3.0, 25)[away]
    heights[:3] = 0.0
    _, sd = row_of(heights)
    chosen = heights[3:46]
    off = np.sort(np.abs(chosen - chosen.mean()))
    scatter = 1.5 * off[len(off) // 2]
    assert off[-1] < 2.5 * scatter
    assert scatter > 1.5
    assert sd == pytest.approx(line_sd(np.arange(3, 46), chosen), rel=1e-3)


@pytest.mark.parametrize(("finder", "fewest"), [(PanelCorners(), 4), (ShirtCorners(), 2)])
def test_as_many_strong_corners_as_are_chosen_from_them_are_enough(finder, fewest, monkeypatch):
    """Of a garment that is narrower below: the shirt's upper corners are its outermost points anyway."""
    rows, columns = np.indices(WHOLE.shape)
    cloth = silhouette((rows >= 20) & (rows < 140) & (np.abs(columns - 100) <= 80 - (rows - 20) // 4))
    corners = [int(np.hypot(*(cloth.outline - at).T).argmin()) for at in ((151, 139), (49, 139), (20, 20), (180, 20))]
    for count, is_found in ((fewest, True), (fewest - 1, False)):
        monkeypatch.setattr(module, "_strong_corners", lambda _, count=count: np.array(corners[:count]))
        found = finder.find(cloth, window_held([20, 20], [179, 20]), SIDES)
        assert np.isfinite(found.pixels[2:]).all() == is_found


def test_typical_spacing_is_the_middle_of_all_in_any_order():
    """Of 0.01 to 30 in steps of 0.01 less one."""
    surface = np.zeros((1, 3000, 3))
    for seed in range(9):
        some = np.random.default_rng(seed).permutation(np.arange(1, 3000) / 100)
        surface[0, 1:, 0] = np.cumsum(some)
        assert _spacing(surface) == pytest.approx(15.0)


ASIDE = OUTLINE + np.array([1.0, -0.7])


def test_a_garments_reach_is_the_same_wherever_its_outline_lies():
    assert of(skirt(outline=ASIDE, points=ASIDE)).reach == pytest.approx(of(skirt()).reach)


@pytest.mark.parametrize(("off", "is_refused"), [((0.0, 0.0), False), ((0.0, 0.03), True), ((0.03, 0.0), True)])
def test_a_centre_is_judged_alike_wherever_the_outline_lies(off, is_refused):
    centre = tuple((np.array([1.0, -1.0]) + off).tolist())
    garment = skirt(outline=ASIDE, points=ASIDE, centre=centre)
    if is_refused:
        with pytest.raises(UntrackableError, match="'centre' is"):
            of(garment)
    else:
        of(garment)


def test_a_centre_is_said_to_be_as_many_millimetres_aside_as_it_is():
    """On a blanket of 3 m square, from its middle to a metre beside a corner."""
    square = np.array([[-1.5, 0.0], [1.5, 0.0], [1.5, -3.0], [-1.5, -3.0]])
    with pytest.raises(UntrackableError) as refused:
        of(skirt(outline=square, points=square, centre=(-1.0, -0.5)))
    said = str(refused.value)
    x, y = (float(part) for part in said.split("at_m = [")[1].split("]")[0].split(","))
    off = int(said.split("'centre' is ")[1].split(" mm")[0])
    assert off > 1300
    assert off == pytest.approx(1e3 * math.hypot(x + 1.0, y + 0.5), abs=0.9)


def test_an_outline_with_an_edge_exactly_on_a_row_of_the_grid_is_laid_without_a_warning():
    """A step of the outline lies half a grid step below its top."""
    row = float(np.arange(0.0 - 0.5 * GRID_STEP, -0.5, -GRID_STEP)[4])
    outline = np.array([[-0.2, 0.0], [0.2, 0.0], [0.2, row], [0.3, row], [0.3, -0.5], [-0.3, -0.5]])
    grid = _laid_flat(outline)
    assert np.isfinite(grid[:, 12]).all()


def test_a_way_that_leads_nowhere_counts_as_a_metre_too_long():
    """Two corners have no way to a third. With a metre each the other one, 1.9 m too far, is blamed before it."""
    excess = np.array(
        [[0.0, 0.9, np.inf, 0.0], [0.9, 0.0, np.inf, 0.17], [np.inf, np.inf, 0.0, 0.0], [0.0, 0.17, 0.0, 0.0]]
    )
    flat = np.ones((4, 4))
    _, wrong = folded_away(np.where(excess > 0.0, 1.108 + excess, 1.0), flat, np.zeros(4, bool))
    assert wrong.tolist() == [True, True, False, False]


@pytest.mark.parametrize(("raw", "is_behind"), [(1499, True), (1500, False)])
def test_a_thing_exactly_at_the_jump_is_not_nearer(raw, is_behind):
    cloth = silhouette(rectangle(20, 20, 99, 139), raw=np.full(WHOLE.shape, raw, np.uint16))
    assert is_behind_something(cloth, np.array([LEFT + 99.0, TOP + 80.0]), 1.6, 0.1) == is_behind


def test_a_point_exactly_a_centimetre_from_a_corner_is_none():
    """From a corner at the origin."""
    outline = OUTLINE - OUTLINE[0]
    points = outline.copy()
    points[0] = (0.01, 0.0)
    with pytest.raises(UntrackableError, match="the point 'a' is neither"):
        of(skirt(outline=outline, points=points))
    points[0] = (float(np.nextafter(0.01, 0.0)), 0.0)
    assert of(skirt(outline=outline, points=points)).roles == [0, 1, 2, 3]

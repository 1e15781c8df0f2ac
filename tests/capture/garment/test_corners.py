"""Corners of outlines with known pixels."""

from __future__ import annotations

import math

import numpy as np
import pytest

from capture.garment.corners import (
    HARRIS_SD,
    HELD_LINE_SD,
    PanelCorners,
    ShirtCorners,
    _across,
    _extreme,
    _line_through,
    _on_held_edge,
    _refined,
    _sd_at_corner,
    _side_line,
)
from tests.capture.garment.flat_cloth import LEFT, LEFT_TOP, RECTANGLE, TOP, WHOLE, line_sd, rectangle, silhouette
from tests.capture.stage import covered_centres

SIDES = np.full((4, 2), 120.0)


def window_held(left, right):
    return np.array([left, right], float) + LEFT_TOP


def test_corners_of_a_rectangle_lie_at_the_rims_of_its_outermost_pixels():
    """Half a pixel outside their centres; the top side is where the held edge says."""
    found = PanelCorners().find(silhouette(WHOLE), window_held([20, 18], [179, 18]), SIDES)
    expected = LEFT_TOP + np.array([[19.5, 18], [179.5, 18], [179.5, 139.5], [19.5, 139.5]])
    assert found.pixels == pytest.approx(expected, abs=1e-6)
    side = line_sd(np.arange(3, 46))  # up to 45 px from 3 px on
    # 43 pixels rounded to whole ones, of which 3.5 are as one: 3.5 / 12 (1 / 43 + 24^2 / 6622), and 0.3 px of curl.
    assert side == pytest.approx(math.sqrt(3.5 / 12 * (1 / 43 + 24**2 / 6622) + 0.09))
    assert found.sd == pytest.approx(np.array([[side, HELD_LINE_SD]] * 2 + [[side, side]] * 2), rel=1e-6)


def test_a_shorter_side_gives_a_shorter_line():
    """0.6 of 50 px are 30: 28 pixels from 3 px on."""
    found = PanelCorners().find(silhouette(WHOLE), window_held([20, 20], [179, 20]), np.full((4, 2), 50.0))
    assert found.sd[2] == pytest.approx([line_sd(np.arange(3, 31))] * 2, rel=1e-6)
    # Each side has its own: before the corner the one to the right, after it the one below.
    sides = np.tile([50.0, 30.0], (4, 1))
    sd = PanelCorners().find(silhouette(WHOLE), window_held([20, 20], [179, 20]), sides).sd[2]
    assert sd == pytest.approx([line_sd(np.arange(3, end)) for end in (31, 19)], rel=1e-6)


def test_sides_too_short_for_a_line_leave_the_corner_as_it_was_found_and_a_held_one_on_the_held_edge():
    found = PanelCorners().find(silhouette(WHOLE), window_held([20, 20], [179, 20]), np.full((4, 2), 10.0))
    assert found.sd.tolist() == [[HARRIS_SD, HELD_LINE_SD]] * 2 + [[HARRIS_SD] * 2] * 2
    assert found.pixels == pytest.approx(LEFT_TOP + RECTANGLE, abs=2)
    assert found.pixels[:2, 1] == pytest.approx(TOP + 20)


def test_a_corner_on_a_slanted_held_edge_is_as_uncertain_along_it_as_a_harris_corner():
    """Slope 3 / 4: of 2.5 px along and 0.3 across it. The pixel lies 5 px below the edge, and moves by that."""
    line = np.array([-0.6, 0.8, 0.0])
    pixel, sd = _on_held_edge(np.array([8.0, 6.0]) + 5.0 * line[:2], line, 0.3)
    assert pixel == pytest.approx([8.0, 6.0])
    assert sd == pytest.approx([math.hypot(0.8 * 2.5, 0.6 * 0.3), math.hypot(0.6 * 2.5, 0.8 * 0.3)])


def test_a_held_edge_far_from_the_corners_leaves_them_as_they_were_found():
    """A crossing more than 10 px away is none, above the corner or below it."""
    for above, refined in ((9, True), (11, False), (-9, True), (-11, False)):
        found = PanelCorners().find(silhouette(WHOLE), window_held([20, 20 - above], [179, 20 - above]), SIDES)
        assert (found.sd[0, 1] == HELD_LINE_SD) == refined
        assert (found.sd[0, 0] == HARRIS_SD) != refined


def test_a_corner_beside_a_longer_held_edge_is_refined_and_stays_where_it_was_found_without_a_line():
    """The held edge goes on for 15 px to either side, beyond what may replace a corner; then for 6 px."""
    found = PanelCorners().find(silhouette(WHOLE), window_held([5, 18], [194, 18]), SIDES)
    assert found.pixels[:2] == pytest.approx(LEFT_TOP + np.array([[19.5, 18], [179.5, 18]]), abs=1e-6)
    short = PanelCorners().find(silhouette(WHOLE), window_held([14, 18], [185, 18]), np.full((4, 2), 10.0))
    assert short.sd.tolist() == [[HARRIS_SD, HELD_LINE_SD]] * 2 + [[HARRIS_SD] * 2] * 2
    assert short.pixels == pytest.approx(LEFT_TOP + RECTANGLE, abs=2)
    assert short.pixels[:2, 1] == pytest.approx(TOP + 18)


def test_pixels_within_three_of_the_held_edge_are_no_side_above_it_or_below():
    """The held edge is 9 px below the cloth's top: of 43 pixels of the side, the five from 2 above to 2 below."""
    found = PanelCorners().find(silhouette(WHOLE), window_held([20, 29], [179, 29]), SIDES)
    side = np.delete(np.arange(3, 46), np.arange(4, 9))
    assert found.sd[0] == pytest.approx([line_sd(side), HELD_LINE_SD], rel=1e-6)


def test_a_triangle_has_no_four_corners():
    """Its lower right corner is the upper right one too."""
    rows, columns = np.indices(WHOLE.shape)
    half = WHOLE * ((columns - 20) * 119 <= (rows - 20) * 159).astype(WHOLE.dtype)
    found = PanelCorners().find(silhouette(half), window_held([20, 20], [179, 20]), SIDES)
    assert np.isnan([found.pixels, found.sd]).all()


def row_of(heights):
    """Return the line and its deviation of a row of pixels, x from 0 to 45, whose garment lies at smaller y."""
    outline = np.stack([np.arange(200.0), np.concatenate([heights, np.zeros(200 - len(heights))])], 1)
    return _side_line(outline, 0, 80, np.array([24.0, -20.0]), 45.5, None)


def test_a_side_without_its_outliers_counts_those_pixels_that_remain():
    """Of x from 3 to 45 px four lie 10 px off and go first. The one 2.5 px off moves the line, and counts no more."""
    heights = np.zeros(46)
    heights[[14, 19, 29, 34]], heights[24] = 10.0, 2.5
    line, sd = row_of(heights)
    assert line == pytest.approx([0.0, 1.0, -2.5 / 39 - 0.5], abs=1e-9)
    assert sd == pytest.approx(line_sd(np.delete(np.arange(3, 46), [11, 16, 21, 26, 31])))


def test_a_ragged_side_is_as_uncertain_as_its_pixels_scatter():
    """22 pixels 1 px off and 21 by turns -1 px: 1 px rms about the line."""
    heights = np.where(np.arange(46) % 2, 1.0, -1.0)
    line, sd = row_of(heights)
    assert line == pytest.approx([0.0, 1.0, -1 / 43 - 0.5], abs=1e-9)
    assert sd == pytest.approx(line_sd(np.arange(3, 46), heights[3:]))
    assert sd == pytest.approx(math.sqrt(3.5 * (1 / 43 + 24**2 / 6622) + 0.09), rel=1e-3)


def test_a_bent_side_is_as_uncertain_as_a_share_of_its_bend():
    """A parabola of 43 px, 2 px deep, and with 0.2 px; either way along the outline."""
    along = np.arange(46)
    for depth in (2.0, 0.2):
        heights = depth * ((along - 24) / 21) ** 2
        assert row_of(heights)[1] == pytest.approx(line_sd(along[3:], heights[3:]))
    straight = line_sd(along[3:])
    bent = 2.0 * ((24 / 21) ** 2 - 1.0 / 3.0)  # px at the corner, of the parabola less its mean
    assert math.sqrt(0.3) * bent < row_of(2.0 * ((along - 24) / 21) ** 2)[1] < math.sqrt(0.5) * bent
    assert row_of(0.2 * ((along - 24) / 21) ** 2)[1] == pytest.approx(straight)  # no more than noise makes


def test_pixels_at_two_positions_alone_bend_no_parabola():
    """3.5 / 12 (1 / 4 + 1.5^2), and 0.3 px of curl; at one position nothing is known."""
    along = np.array([1.0, 2.0, 2.0, 1.0])
    assert _sd_at_corner(along, np.zeros(4), 0.0) == pytest.approx(math.sqrt(3.5 / 12 * (1 / 4 + 1.5**2) + 0.09))
    assert _sd_at_corner(np.ones(4), np.zeros(4), 0.0) > 1e3


def test_a_bars_end_beside_a_held_corner_does_not_move_it():
    """The bar shows for 25 px to either side, and for 3 px below the held edge; the held edge is known to 0.1 px."""
    mask = WHOLE | rectangle(5, 20, 194, 22)
    held = window_held([19.5, 20], [179.5, 20])
    found = PanelCorners().find(silhouette(mask), held, SIDES, 0.1)
    assert found.pixels[:2] == pytest.approx(held, abs=0.1)
    assert found.sd[:2, 1] == pytest.approx(0.1)


def test_corners_of_a_turned_rectangle_are_found_to_a_third_of_a_pixel():
    """Turned by 12 degrees about its middle, drawn pixel by pixel where their centres lie inside."""
    rows, columns = np.indices((200, 220)).astype(float)
    c, s = math.cos(math.radians(12)), math.sin(math.radians(12))
    x, y = c * (columns - 110) + s * (rows - 100), -s * (columns - 110) + c * (rows - 100)
    mask = (np.abs(x) <= 70) & (np.abs(y) <= 50)
    true = np.array(
        [[c * a - s * b + 110, s * a + c * b + 100] for a, b in ((-70, -50), (70, -50), (70, 50), (-70, 50))]
    )
    found = PanelCorners().find(silhouette(mask), true[:2] + LEFT_TOP, SIDES)
    assert np.abs(found.pixels - LEFT_TOP - true).max() < 0.35
    normals = np.hypot([c, s], [s, c])
    assert found.sd[2] == pytest.approx(normals * line_sd(np.arange(3, 46)), rel=0.05)


def test_a_line_of_pixels_has_no_four_corners():
    line = rectangle(20, 20, 20, 139)
    for finder in (PanelCorners(), ShirtCorners()):
        found = finder.find(silhouette(line), window_held([20, 20], [22, 20]), SIDES)
        assert found.pixels.shape == found.sd.shape == (4, 2)
        assert np.isnan([found.pixels, found.sd]).all()


def test_a_shirts_upper_corners_are_its_outermost_points():
    """A T of 160 px whose sleeves end slanted, 20 px lower outside than a panel's corner would be."""
    mask = rectangle(60, 20, 139, 139)
    for k in range(40):
        mask[20 + k // 2 : 60 + k // 2, 60 - k] = 1
        mask[20 + k // 2 : 60 + k // 2, 139 + k] = 1
    shirt = ShirtCorners()
    assert shirt.tips == (0, 1)
    assert PanelCorners().tips == ()
    found = shirt.find(silhouette(mask), window_held([60, 20], [139, 20]), SIDES)
    assert found.pixels[:2, 0] == pytest.approx([LEFT + 21, LEFT + 178], abs=2.5)
    assert found.pixels[2:] == pytest.approx(LEFT_TOP + np.array([[139.5, 139.5], [59.5, 139.5]]), abs=0.1)


def test_corners_of_a_flat_outline_by_the_same_rule():
    """In metres and y up: a hexagon with sleeves at (-3, 1) and (3, 1.1)."""
    outline = np.array([[-2.0, 2.0], [2.0, 2.0], [3.0, 1.1], [2.0, -2.0], [-2.0, -2.1], [-3.0, 1.0]])
    assert PanelCorners().flat_corners(outline).tolist() == [[-2, 2], [3, 1.1], [2, -2], [-2, -2.1]]
    assert ShirtCorners().flat_corners(outline).tolist() == [[-3, 1], [3, 1.1], [2, -2], [-2, -2.1]]
    square = np.array([[-1.0, 1.0], [1.1, 1.0], [1.0, -1.0], [-1.0, -1.1]])
    assert PanelCorners().flat_corners(square).tolist() == square.tolist()


def test_a_line_through_two_points_has_a_unit_normal():
    """From (1, 2) by (3, 4): the normal (-4, 3) / 5, and a distance of the origin of 0.4."""
    assert _line_through(np.array([[1.0, 2.0], [4.0, 6.0]])) == pytest.approx([-0.8, 0.6, -0.4])
    assert np.isfinite(_line_through(np.ones((2, 2)))).all()


def test_two_lines_cross_within_the_deviations_of_both():
    """x = 10 within 0.2 px and (x + y) / sqrt 2 within 0.3 px: y = s - x, within hypot(0.2, 0.3 sqrt 2)."""
    upright, slanted = np.array([1.0, 0.0, -10.0]), np.array([1.0, 1.0, -30.0]) / math.sqrt(2)
    for lines in ([(upright, 0.2), (slanted, 0.3)], [(slanted, 0.3), (-upright, 0.2)]):
        crossing, sd = _refined(np.array([12.0, 17.0]), lines)
        assert crossing == pytest.approx([10.0, 20.0])
        assert sd == pytest.approx([0.2, math.hypot(0.2, 0.3 * math.sqrt(2))])


@pytest.mark.parametrize(("away", "is_refined"), [(9.9, True), (10.1, False)])
@pytest.mark.parametrize(("sine", "crosses"), [(0.345, True), (-0.345, True), (0.335, False), (-0.335, False)])
def test_lines_that_cross_far_away_or_at_less_than_twenty_degrees_refine_nothing(sine, crosses, away, is_refined):
    start = np.array([50.0, 60.0])
    middle = start + away * np.array([0.6, -0.8])
    normals = np.array([[0.6, 0.8], [0.6, 0.8]])
    cosine = math.sqrt(1 - sine**2)
    normals[1] = [0.6 * cosine - 0.8 * sine, 0.8 * cosine + 0.6 * sine]
    lines = [(np.array([*normal, -(normal @ middle)]), 0.3) for normal in normals]
    corner, sd = _refined(start, lines)
    if crosses and is_refined:
        assert corner == pytest.approx(middle)
    else:
        assert corner.tolist() == start.tolist()
        assert sd.tolist() == [HARRIS_SD] * 2
    for missing in ([None, lines[1]], [lines[0], None]):
        corner, sd = _refined(start, missing)
        assert corner.tolist() == start.tolist()
        assert sd.tolist() == [HARRIS_SD] * 2


def test_a_point_eight_pixels_farther_out_than_the_harris_corners_replaces_them():
    value = np.array([3.0, 10.0, 7.0, 18.0, 5.0])
    strong = np.array([0, 1, 4])
    assert _extreme(value, strong) == 1
    value[3] = 18.1
    assert _extreme(value, strong) == 3


def test_a_side_is_followed_through_the_outlines_first_pixel_either_way():
    """A rectangle's outline that begins in the middle of its lower side."""
    u, v = np.arange(20, 180), np.arange(20, 140)
    ring = np.concatenate([
        np.stack([u[:-1], np.full(159, 20)], 1), np.stack([np.full(119, 179), v[:-1]], 1),
        np.stack([u[:0:-1], np.full(159, 139)], 1), np.stack([np.full(119, 20), v[:0:-1]], 1),
    ]).astype(float)  # fmt: skip
    middle = ring.mean(0)
    for outline in (ring, ring[::-1]):
        for begin in range(0, len(ring), 7):
            turned = np.roll(outline, begin, axis=0)
            at = [int(np.linalg.norm(turned - corner, axis=1).argmin()) for corner in ((179, 139), (20, 139))]
            for start, end in (at, at[::-1]):
                line, sd = _side_line(turned, start, end, middle, 45.0, None)
                assert line == pytest.approx([0.0, 1.0, -139.5], abs=1e-9)
                assert sd == pytest.approx(line_sd(np.arange(3, 46)))


@pytest.mark.parametrize("degrees", [3, 10, 20, 30, 37])
def test_a_side_at_any_slope_lies_where_the_cloth_ends(degrees):
    """A pixel belongs to the cloth that its centre shows; half a pixel across a side is 0.1 off at 37 degrees."""
    turn, random, off = np.radians(degrees), np.random.default_rng(0), []
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    for _ in range(30):
        square = 100 + random.uniform(-1, 1, 2) + 40 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) @ rotation.T
        outline = silhouette(covered_centres(square, (200, 200))).outline
        starts = [int(np.linalg.norm(outline - corner, axis=1).argmin()) for corner in square]
        for i, j in ((0, 1), (1, 2), (2, 3), (3, 0)):
            line, _ = _side_line(outline, starts[i], starts[j], outline.mean(0), 45.0, None)
            off.append(float(_across(line, 0.75 * square[i] + 0.25 * square[j])))
    assert np.mean(off) == pytest.approx(0.0, abs=0.015)

"""Contour and grid of silhouettes with known pixels."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from capture.garment.surface_scan import _along, _in_metres, _patch, _side, _smooth_depth, _smoothed, scan_surface
from tests.capture.garment.flat_cloth import LEFT, LEFT_TOP, RECTANGLE, SQUARE, TOP, WHOLE, silhouette

CORNERS = RECTANGLE + LEFT_TOP


def test_points_along_a_path_are_at_equal_steps_of_its_length():
    """Three right and four down are seven long: seven eighths in three and a half."""
    way = np.array([[1.0, 2.0], [4.0, 2.0], [4.0, 6.0]])
    assert _along(way, 8) == pytest.approx(np.array([[1, 2], [2, 2], [3, 2], [4, 2], [4, 3], [4, 4], [4, 5], [4, 6]]))
    assert _along(way, 3) == pytest.approx(np.array([[1, 2], [4, 2.5], [4, 6]]))


def circle(turn):
    angle = turn * np.linspace(0, 2 * np.pi, 50, endpoint=False)
    return 20 * np.stack([np.cos(angle), np.sin(angle)], axis=1)


@pytest.mark.parametrize("turn", [1, -1])
def test_an_outline_goes_clockwise_as_seen_and_is_the_mean_of_seven(turn):
    """Averaged over seven of fifty directions a circle shrinks by their mean cosine."""
    found = _smoothed(circle(turn))
    angle = np.unwrap(np.arctan2(found[:, 1], found[:, 0]))
    assert np.diff(angle) == pytest.approx(np.full(49, 2 * np.pi / 50))
    share = np.mean(np.cos(2 * np.pi / 50 * np.arange(-3, 4)))
    assert np.hypot(*found.T) == pytest.approx(20 * share)


def test_a_side_leaves_out_twelve_pixels_beside_its_corners():
    way = np.stack([np.arange(41.0), np.zeros(41)], axis=1)
    start, end = np.array([0.0, 1.0]), np.array([40.0, 1.0])
    side = _side(way, start, end)
    assert side[[0, -1]] == pytest.approx(np.array([start, end]))
    assert side[1:-1, 0].tolist() == list(range(12, 29))  # at 12 px hypot(12, 1) is beyond twelve


def test_the_grid_between_four_sides_is_coons_patch():
    """A bulge of the top side fades downwards; the other sides are straight."""
    s = np.linspace(0, 1, 101)[:-1, None]
    corners = np.array([[0, 0], [100, 0], [100, 80], [0, 80]], float)
    sides = [(1 - s) * corners[n] + s * corners[(n + 1) % 4] for n in range(4)]
    sides[0][:, 1] -= 10 * np.sin(np.pi * s[:, 0])
    patch = _patch(np.concatenate(sides), corners, 5)
    assert patch.shape == (5, 5, 2)
    t = np.linspace(0, 1, 5)
    assert patch[:, 2, 0] == pytest.approx(np.full(5, 50.0), abs=0.3)
    assert patch[:, 2, 1] == pytest.approx(-10 * (1 - t) + 80 * t, abs=0.3)
    assert patch[2, :, 0] == pytest.approx(25 * np.arange(5), abs=0.3)
    assert patch[:, [0, 4], 1] == pytest.approx(np.tile(80 * t[:, None], 2), abs=1e-6)
    assert patch[[0, 4]][:, [0, 4]] == pytest.approx(np.array([[[0, 0], [100, 0]], [[0, 80], [100, 80]]]))
    assert np.isnan(_patch(np.concatenate(sides), corners[[0, 2, 1, 3]], 5)).all()
    assert np.isnan(_patch(np.concatenate(sides)[::-1], corners, 3)).all()


def test_depth_is_the_mean_of_what_is_two_pixels_inside_the_rim():
    """Depth rises along u; eleven pixels about a position have its own for a mean, less those beyond the inner ones."""
    columns = np.indices(WHOLE.shape)[1]
    cloth = silhouette(WHOLE, 1.6 + 0.001 * columns)
    depth = _smooth_depth(cloth)
    assert depth[80, 100] == pytest.approx(1.7, abs=1e-6)
    # At column 20, the rim's, columns 22 to 25 are averaged; at 19 and 18, beside the garment, to 24 and to 23.
    assert depth[80, [20, 19, 18]] == pytest.approx([1.6 + 0.0235, 1.6 + 0.023, 1.6 + 0.0225], abs=1e-6)
    assert depth[80, 17] == 0.0
    # In a corner 4 x 4 of 121 pixels are inner ones, and 2 x 2 two pixels diagonally beside it: more than 0.015.
    assert depth[20, 20] == pytest.approx(1.6235, abs=1e-6)
    assert depth[18, 18] == pytest.approx(1.6225, abs=1e-6)
    missing = silhouette(WHOLE, np.where(columns % 2 == 0, 0.0, 1.6))
    assert _smooth_depth(missing)[80, 100] == pytest.approx(1.6, abs=1e-6)
    few = np.zeros(WHOLE.shape)
    few[79, 98] = 1.6
    assert not _smooth_depth(silhouette(WHOLE, few)).any()  # one of 121
    few[80, 98] = 1.6
    assert _smooth_depth(silhouette(WHOLE, few))[80, 98] == pytest.approx(1.6, abs=1e-6)


def test_a_position_is_converted_to_metres_by_the_pixel_that_holds_it():
    depth = np.full((20, 30), 2.0, np.float32)
    depth[5, 7] = 1.0
    depth[6, 7] = 0.0
    places = np.array([[[7.4, 5.4], [7.6, 5.4]], [[7.0, 6.0], [np.nan, np.nan]], [[29.4, 19.4], [29.6, 3.0]],
                       [[3.0, 19.6], [-0.6, 3.0]], [[-0.4, -0.4], [3.0, -0.6]]])  # fmt: skip
    found = _in_metres(places, depth, np.array([200.0, 150.0]), SQUARE)
    z = found[..., 2]
    assert z[0] == pytest.approx([1.0, 2.0])
    assert found[0, 1] == pytest.approx([2.0 * (207.6 - 319.5) / 500, 2.0 * (155.4 - 239.5) / 500, 2.0])
    assert np.isnan(z).tolist() == [[False, False], [True, True], [False, True], [True, True], [False, True]]


def test_a_scan_begins_at_the_top_left_corner_and_goes_clockwise():
    scan = scan_surface(silhouette(WHOLE), CORNERS, SQUARE, 2.5, grid=3, contour=60)
    assert scan.time == 2.5
    assert (scan.grid.shape, scan.contour.shape) == ((3, 3, 3), (60, 3))
    pixel = scan.contour[:, :2] * 500 / 1.6 + 319.5 - [0, 80]
    assert pixel[0] == pytest.approx(CORNERS[0], abs=2)
    at = [int(np.linalg.norm(pixel - corner, axis=1).argmin()) for corner in CORNERS]
    # Sides of 159 and 119 px of a way of 556 in sixty places.
    assert at == pytest.approx([0, 17.2, 30, 47.2], abs=1)
    steps = np.linalg.norm(np.diff(pixel, axis=0), axis=1)
    assert steps == pytest.approx(np.full(59, 556 / 60), rel=0.2)
    middle = np.array([LEFT + 99.5, TOP + 79.5])
    assert scan.grid[1, 1, :2] * 500 / 1.6 + [319.5, 239.5] == pytest.approx(middle, abs=0.2)
    assert scan.grid[0, 2, :2] * 500 / 1.6 + [319.5, 239.5] == pytest.approx(CORNERS[1], abs=1e-3)


def test_a_scan_without_a_corner_has_a_contour_that_begins_at_the_windows():
    """The first corner is missing: the position nearest to the window's own corner stands for it."""
    corners = CORNERS.copy()
    corners[0] = np.nan
    scan = scan_surface(silhouette(WHOLE), corners, SQUARE, 0.0, grid=3, contour=40)
    assert np.isnan(scan.grid).all()
    assert scan.contour[0, :2] * 500 / 1.6 + [319.5, 239.5] == pytest.approx(CORNERS[0], abs=2)


def test_a_position_across_and_down_has_each_axis_its_own_focal_length():
    """80.5 px right and 100 px down at 2 m: 161 / 500 and 200 / 550 m."""
    camera = msgspec.structs.replace(SQUARE, fx=500.0, fy=550.0)
    found = _in_metres(np.array([[3.0, 4.5]]), np.full((9, 9), 2.0, np.float32), np.array([397.0, 335.0]), camera)
    assert found[0] == pytest.approx([2 * 80.5 / 500, 2 * 100 / 550, 2.0])


def test_cloth_that_fills_its_window_has_its_rim_at_the_windows():
    """Depth rises along u. The two outermost columns and rows count for nothing, and there is nothing outside."""
    shape = (40, 60)
    depth = _smooth_depth(silhouette(np.ones(shape), 1.6 + 0.001 * np.indices(shape)[1]))
    assert depth[20, [0, 1, 4]] == pytest.approx([1.6035, 1.604, 1.6055], abs=1e-6)  # columns 2 to 5, to 6 and to 9
    assert depth[20, [59, 58]] == pytest.approx([1.6555, 1.655], abs=1e-6)
    down = _smooth_depth(silhouette(np.ones(shape), 1.6 + 0.001 * np.indices(shape)[0]))
    assert down[[0, 1, 4], 30] == pytest.approx([1.6035, 1.604, 1.6055], abs=1e-6)
    assert down[[39, 38], 30] == pytest.approx([1.6355, 1.635], abs=1e-6)

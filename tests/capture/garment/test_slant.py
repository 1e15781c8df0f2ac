"""The slant of flat cloth at its edge, computed by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from capture.garment.slant import FITTED_AROUND, UPRIGHT, rim_slant
from tests.capture.garment.flat_cloth import LEFT, PIXEL, SQUARE, TOP, WHOLE, rectangle, silhouette


@pytest.mark.parametrize(("outwards", "along"), [(0.5, 0.0), (-0.5, 0.0), (0.3, 0.4), (0.3, -0.4)])
def test_the_slant_at_a_straight_rim_is_exact(outwards, along):
    """n . X = d with n = (-a, -b, 1) has the slope dz/dx = a where it is level with the ray."""
    pixel = np.array([LEFT + 119.0, TOP + 89.0])
    rows, columns = np.indices(WHOLE.shape)
    slope = np.array([outwards, along]) * 1.6 / SQUARE.fx
    inverse = (1 - (slope[0] * (columns - 119) + slope[1] * (rows - 89)) / 1.6) / 1.6
    slant = rim_slant(silhouette(rectangle(20, 20, 119, 139), 1 / inverse), pixel, 1.6, SQUARE)
    assert slant == pytest.approx((math.atan(outwards), abs(math.atan(along))), abs=1e-4)


@pytest.mark.parametrize(("sideways", "downwards"), [(0.5, 0.1), (0.1, 0.5), (0.3, -0.3)])
def test_at_a_slanting_rim_outwards_and_along_are_square_to_each_other(sideways, downwards):
    """Cloth above a diagonal: outwards is (1, 1) / sqrt(2), so the slopes are their sum and difference over sqrt(2)."""
    pixel = np.array([LEFT + 80.0, TOP + 80.0])
    rows, columns = np.indices(WHOLE.shape)
    slope = np.array([sideways, downwards]) * 1.6 / SQUARE.fx
    inverse = (1 - (slope[0] * (columns - 80) + slope[1] * (rows - 80)) / 1.6) / 1.6
    slant = rim_slant(silhouette(rows + columns <= 160, 1 / inverse), pixel, 1.6, SQUARE)
    outwards, along = (sideways + downwards) / math.sqrt(2), (sideways - downwards) / math.sqrt(2)
    assert slant == pytest.approx((math.atan(outwards), abs(math.atan(along))), abs=1e-4)


def test_cloth_farther_than_fifty_millimetres_does_not_determine_the_slant():
    """Of 15.6 px; beyond, it bends by half a metre a metre."""
    rows, columns = np.indices(WHOLE.shape)
    far = FITTED_AROUND * SQUARE.fx / 1.6
    away = np.hypot(columns - 119, rows - 89)
    depth = np.where(away <= far, 1.6, 1.6 + 0.5 * PIXEL * (away - far))
    pixel = np.array([LEFT + 119.0, TOP + 89.0])
    slant = rim_slant(silhouette(rectangle(20, 20, 119, 139), depth), pixel, 1.6, SQUARE)
    assert slant == pytest.approx(UPRIGHT, abs=1e-5)


def test_half_the_distance_doubles_the_pixels_that_determine_the_slant():
    depth = np.full(WHOLE.shape, 0.8)
    _, columns = np.indices(WHOLE.shape)
    depth += 0.4 * 0.8 / SQUARE.fx * (columns - 119)
    pixel = np.array([LEFT + 119.0, TOP + 89.0])
    slant = rim_slant(silhouette(rectangle(20, 20, 119, 139), depth), pixel, 0.8, SQUARE)
    assert slant.outwards == pytest.approx(math.atan(0.4), abs=0.02)


def test_cloth_at_the_windows_own_corner_determines_the_slant_of_its_rim():
    """Cloth inwards of the first column recedes by a tenth; that column is 15 mm nearer, and counts."""
    _, columns = np.indices(WHOLE.shape)
    depth = 1.6 + np.where(columns == 0, -0.015, 0.1 * PIXEL * columns)
    mask = rectangle(0, 0, 80, 80)
    pixel = np.array([LEFT + 0.0, TOP + 40.0])
    found = rim_slant(silhouette(mask, depth), pixel, 1.6, SQUARE)
    without = rim_slant(silhouette(mask, np.where(columns == 0, 0.0, depth)), pixel, 1.6, SQUARE)
    assert without.outwards == pytest.approx(-math.atan(0.1), abs=0.01)
    assert found.outwards < without.outwards - 0.05


@pytest.mark.parametrize("farthest", [(0, 20), (0, -20), (20, 0), (-20, 0)])
def test_cloth_just_fifty_millimetres_away_determines_the_slant(farthest):
    """50 mm are 20 px at 1.25 m. Of level cloth the farthest pixel alone is 4 mm nearer: it recedes the other way."""
    depth = np.full(WHOLE.shape, 1.25)
    right, down = farthest
    depth[80 + down, 100 + right] -= 0.004
    pixel = np.array([LEFT + 100.0, TOP + 80.0])
    near = rectangle(100 + min(right, 0), 80 + min(down, 0), 100 + max(right, 0), 80 + max(down, 0))
    mask = near | rectangle(96, 76, 104, 84)
    slant = rim_slant(silhouette(mask, depth), pixel, 1.25, SQUARE)
    assert slant.outwards > 1e-4
    mask[80 + down, 100 + right] = 0
    assert rim_slant(silhouette(mask, depth), pixel, 1.25, SQUARE) == pytest.approx(UPRIGHT, abs=1e-6)

"""3D positions of pixels of flat cloth, computed by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from capture.depth.surface import CorrelationMeter, fit_surface
from capture.garment.placing import PATCH_RADIUS, PATCH_SPREAD, Placer, project
from formats.rig import Sensor
from tests.capture.garment.flat_cloth import LEFT, TOP, WHOLE, silhouette

CAMERA = Sensor(width=640, height=480, fx=575.8, fy=500.0, cx=319.5, cy=239.5)


def placer(cloth):
    return Placer(cloth, CAMERA, CorrelationMeter(4.0))


def plane(normal, distance, shape=WHOLE.shape):
    """Depth [m] of the plane normal . X = distance in the window."""
    rows, columns = np.indices(shape)
    rays = np.stack([(columns + LEFT - CAMERA.cx) / CAMERA.fx, (rows + TOP - CAMERA.cy) / CAMERA.fy, np.ones(shape)])
    return distance / np.einsum("i,ihw", np.array(normal), rays)


def test_positions_are_projected_with_their_own_focal_lengths():
    """x/z = 0.1, y/z = -0.2: 319.5 + 57.58 and 239.5 - 100."""
    places = np.array([[0.2, -0.4, 2.0], [0.0, 0.0, 1.0]])
    assert project(places, CAMERA) == pytest.approx(np.array([[377.08, 139.5], [319.5, 239.5]]))


def test_a_pixel_on_slanted_cloth_is_placed_where_its_ray_meets_the_plane():
    normal, distance = np.array([0.3, -0.2, 0.933]), 1.5
    pixel = np.array([LEFT + 90.25, TOP + 70.75])
    cloth = silhouette(WHOLE, plane(normal, distance))
    place, sd = placer(cloth).place(pixel, np.array([0.5, 2.0]))
    ray = np.array([(pixel[0] - CAMERA.cx) / CAMERA.fx, (pixel[1] - CAMERA.cy) / CAMERA.fy, 1.0])
    assert place == pytest.approx(ray * distance / (normal @ ray), abs=1e-5)
    # dz/du = -z n_x / (fx n . ray), likewise along v.
    z = place[2]
    slope = -z / (normal @ ray) * normal[:2] / [CAMERA.fx, CAMERA.fy]
    rows, columns = np.indices(WHOLE.shape)
    near = (np.abs(columns - 90) <= PATCH_RADIUS) & (np.abs(rows - 70) <= PATCH_RADIUS)
    fitted = fit_surface(
        columns[near] - 90.25, rows[near] - 70.75, cloth.depth[near].astype(float),
        focal_length=CAMERA.fx, spread=PATCH_SPREAD, correlated_pixels=4.0,
    )  # fmt: skip
    along = math.hypot(fitted.sd, 0.5 * slope[0], 2.0 * slope[1])
    across = z * np.array([0.5 / CAMERA.fx, 2.0 / CAMERA.fy])
    assert sd == pytest.approx([math.hypot(across[0], ray[0] * along), math.hypot(across[1], ray[1] * along), along])


@pytest.mark.parametrize(("u", "v"), [(22, 70), (177, 70), (90, 22), (90, 137), (20, 20), (179, 139)])
def test_the_two_outermost_pixels_of_the_cloth_do_not_determine_its_depth(u, v):
    """They are 50 mm farther, mixed with what is behind; what is farther in than the patch says nothing, either."""
    depth = np.full(WHOLE.shape, 1.65)
    depth[22:138, 22:178] = 1.6
    far = (np.abs(np.arange(160)[:, None] - v) > PATCH_RADIUS) | (np.abs(np.arange(200)[None] - u) > PATCH_RADIUS)
    depth[far] = 1.63
    place, _ = placer(silhouette(WHOLE, depth)).place(np.array([LEFT + u, TOP + v], float), np.ones(2))
    assert place[2] == pytest.approx(1.6, abs=1e-5)


@pytest.mark.parametrize("mixed", [1.65, 1.603])
def test_cloth_that_fills_the_window_has_its_rim_at_the_windows(mixed):
    mask = np.ones((60, 60), np.uint8)
    depth = np.full(mask.shape, mixed)
    depth[2:-2, 2:-2] = 1.6
    for u, v in ((0, 0), (59, 59), (0, 30), (30, 59)):
        place, _ = placer(silhouette(mask, depth)).place(np.array([LEFT + u, TOP + v], float), np.ones(2))
        assert place[2] == pytest.approx(1.6, abs=1e-5)


def test_a_pixel_without_cloth_around_it_has_no_position():
    cloth = silhouette(WHOLE)
    for pixel in ([np.nan, np.nan], [LEFT - 40, TOP + 70], [LEFT + 90, TOP + 300], [LEFT + 2, TOP + 2]):
        place, sd = placer(cloth).place(np.array(pixel, float), np.ones(2))
        assert np.isnan([*place, *sd]).all()
    cloth.depth[:] = 0.0
    assert np.isnan(placer(cloth).place(np.array([LEFT + 90.0, TOP + 70]), np.ones(2))[0]).all()


@pytest.mark.parametrize("pixel", [(np.nan, np.nan), (LEFT - 40.0, TOP - 40.0)])
def test_a_pixel_that_was_not_found_or_lies_outside_has_no_position(pixel):
    place, sd = placer(silhouette(WHOLE)).place(np.array(pixel), np.array([0.5, 0.5]))
    assert place.shape == sd.shape == (3,)
    assert np.isnan([place, sd]).all()

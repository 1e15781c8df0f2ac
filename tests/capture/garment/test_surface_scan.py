"""Grid and contour of a hanging skirt agree with the flat garment."""

from __future__ import annotations

import numpy as np
import pytest

from capture.garment.tracker import garment_tracker
from firmware_host.synthetic.garments import GARMENTS
from firmware_host.synthetic.scene import BOTTOM_WIDTH, PANEL_LENGTH, RIG, TOP_WIDTH
from tests.capture.garment.garment_scenes import hung


def scanned(kind, fold=None, grid=9, contour=200, seed=3):
    world = hung(kind, 1.6, fold=fold, seed=seed)
    tracker = garment_tracker(world.garment, RIG)
    tracker.track(world.frame(0, world.renderer())[0], world.hanger.held[0], 0.0)
    return world, tracker.scan(0.0, grid=grid, contour=contour)


@pytest.mark.parametrize("seed", range(8))
def test_the_grid_of_a_flat_skirt_is_its_bilinear_grid(seed):
    """Two pixels of ragged edge are 5.6 mm at 1.6 m; depth is averaged to under 2 mm."""
    world, scan = scanned("skirt", seed=seed)
    a, b, c, d = world.points[0, :4]
    s, t = np.linspace(0, 1, 9)[None, :, None], np.linspace(0, 1, 9)[:, None, None]
    wanted = (1 - t) * ((1 - s) * a + s * b) + t * ((1 - s) * d + s * c)
    apart = np.linalg.norm(scan.grid - wanted, axis=-1)
    assert np.isfinite(apart).all()
    assert np.median(apart) < 5.0e-3
    assert apart.max() < 12.0e-3


def test_the_contour_is_as_long_as_the_hem_and_sides_and_goes_clockwise_from_the_top_left():
    world, scan = scanned("skirt")
    found = scan.contour[np.isfinite(scan.contour).all(1)]
    assert len(found) > 0.95 * len(scan.contour)
    closed = np.vstack([found, found[:1]])
    length = np.linalg.norm(np.diff(closed[:, :2], axis=0), axis=1).sum()
    wanted = TOP_WIDTH + BOTTOM_WIDTH + 2 * np.hypot(PANEL_LENGTH, 0.5 * (BOTTOM_WIDTH - TOP_WIDTH))
    assert length == pytest.approx(wanted, rel=0.03)
    # The bar reaches 20 mm beyond the held edge's end.
    assert np.linalg.norm(found[0] - world.points[0, 0]) < 0.025
    at = [np.linalg.norm(found - corner, axis=1).argmin() for corner in world.points[0, 1:4]]
    assert 0 < at[0] < at[1] < at[2]


def test_a_garment_with_a_hidden_corner_has_a_contour_but_no_grid():
    corner = np.array(GARMENTS["skirt"]().points[2].at_m)
    _, scan = scanned("skirt", fold=(corner - [0.14, 0.0], corner + np.array([0.0, 0.14])))
    assert np.isnan(scan.grid).all()
    assert np.isfinite(scan.contour).all(1).mean() > 0.95


def test_a_shirts_grid_has_no_points_beside_the_cloth():
    world, scan = scanned("t-shirt", grid=15)
    seen = np.isfinite(scan.grid).all(-1)
    assert seen.mean() > 0.8
    # All of it hangs in one plane, give or take the noise of the averaged depth.
    assert np.abs(scan.grid[seen][:, 2] - world.points[0, 0, 2]).max() < 0.02


def test_nothing_is_scanned_before_a_garment_was_found():
    tracker = garment_tracker(GARMENTS["swatch"](), RIG)
    assert tracker.scan(0.0, grid=5, contour=10) is None
    tracker.track(np.zeros((480, 640), np.uint16), hung("swatch", 1.6).hanger.held[0], 0.0)
    assert tracker.scan(0.0, grid=5, contour=10) is None

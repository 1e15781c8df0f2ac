"""Markers and cloth are seen in the same coordinates: a marker's centre is found where the synthetic camera drew it."""

from __future__ import annotations

import numpy as np
import pytest

from capture.hanger.marker_detection import MarkerDetector, diagonal_crossing
from firmware_host.synthetic.pattern import lay
from firmware_host.synthetic.render import Renderer
from firmware_host.synthetic.scene import CAMERA, HANGER, demo_garment, place

POSES = 40  # at random parts of a pixel; two markers each
ERROR = 0.06  # px, of one centre without noise, measured over 120 of them


def test_the_mean_error_of_markers_centres_is_far_below_half_a_pixel() -> None:
    """Three standard errors of the mean: 3 * 0.06 / sqrt(80) = 0.02 px."""
    renderer, rng = Renderer(lay(demo_garment(), 5, 5)), np.random.default_rng(0)
    behind = renderer.cloth(np.full((5, 5, 3), -1.0))
    detector, off = MarkerDetector(HANGER.dictionary, HANGER.ids), []
    for _ in range(POSES):
        hanger = place(rng.uniform(-0.05, 0.05, (1, 3)), np.zeros(1), rng.uniform(-0.05, 0.05, 1))
        view = renderer.with_hanger(behind, hanger.origin[0], hanger.rotation[0])
        colour = np.rint(view.colour).astype(np.uint8)
        for k, coarse in enumerate(detector.in_picture(colour)):
            x, y, z = hanger.markers[0, k]
            true = np.array([CAMERA.fx * x / z + CAMERA.cx, CAMERA.fy * y / z + CAMERA.cy])
            off.append(diagonal_crossing(detector.refined(colour, k, coarse)) - true)
    assert len(off) == 2 * POSES
    np.testing.assert_allclose(np.mean(off, axis=0), 0.0, atol=3 * ERROR / np.sqrt(2 * POSES))
    assert np.std(off, axis=0) == pytest.approx(ERROR, rel=0.25)

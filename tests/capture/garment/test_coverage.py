"""The distance of a corner beyond the visible cloth, for folds of known depth."""

from __future__ import annotations

import numpy as np
import pytest

from capture.garment.coverage import SeenWays, beyond_the_seen
from capture.garment.tracker import garment_tracker
from firmware_host.synthetic.garments import GARMENTS
from firmware_host.synthetic.scene import RIG
from tests.capture.garment.garment_scenes import hung


def beyond(world):
    """Return each corner's distance beyond the visible cloth [m], (4,), in a world's only frame."""
    depth, _ = world.frame(0, world.renderer())
    tracker = garment_tracker(world.garment, RIG)
    held = world.hanger.held[0]
    silhouette = tracker._silhouette(depth, held, 0.0)
    surface, cell = tracker._surface(silhouette)
    nowhere = np.full((4, *surface.shape[:2]), np.inf, np.float32)
    ways = SeenWays(surface, cell, held, nowhere, np.zeros(4, bool))
    return beyond_the_seen(silhouette, ways, tracker.flat.from_ends, tracker.flat.distances, RIG.sensor).by_ends


@pytest.mark.parametrize("kind", GARMENTS)
@pytest.mark.parametrize("distance", [1.2, 2.5])
def test_corners_in_view_are_within_two_centimetres_of_the_seen_cloth(kind, distance):
    assert beyond(hung(kind, distance)).max() < 0.02


@pytest.mark.parametrize("cut", [0.10, 0.14, 0.18])
def test_a_folded_corner_is_beyond_it_by_the_depth_of_the_fold(cut):
    """A fold that cuts `cut` off both sides of a right angle lies cut / sqrt(2) from the corner.

    Of ways from the two held ends the nearest place on the fold leaves no more than that, and no less than half of it.
    """
    corner = np.array(GARMENTS["swatch"]().points[2].at_m)
    folded = beyond(hung("swatch", 1.6, fold=(corner - [cut, 0.0], corner + np.array([0.0, cut]))))
    assert 0.5 * cut / np.sqrt(2) < folded[2] < cut / np.sqrt(2) + 0.02
    assert np.delete(folded, 2).max() < 0.02

"""What the tracker tells of one frame, and of a frame in which nothing was found; a belief from frame to frame."""

from __future__ import annotations

import numpy as np
import pytest

from capture.garment.folding import BEYOND, LEAST_BEYOND, MOST, MOST_BEYOND, PEEKING, PLACED, Belief, traces
from capture.garment.sight import frame_quality, nothing_found
from capture.garment.slant import Slant
from capture.garment.tracker import garment_tracker
from firmware_host.synthetic.scene import RIG
from tests.capture.garment.garment_scenes import hung


def test_a_frame_tells_the_outline_in_the_image_the_quality_and_the_scan_of_its_time():
    world = hung("swatch", 1.6)
    depth, _ = world.frame(0, world.renderer())
    depth[280:290, 300:310] = 0  # a hole of 100 of the silhouette's pixels
    held = world.hanger.held[0]
    tracker = garment_tracker(world.garment, RIG)
    sight = tracker.track(depth, held, 0.4)
    assert sight.sd.dtype == sight.points.dtype == float
    silhouette = tracker._silhouette(depth, held, 0.4)
    filled = np.count_nonzero(silhouette.depth) / np.count_nonzero(silhouette.mask)
    assert 0.9 < filled < 1.0
    assert sight.quality == pytest.approx(frame_quality(sight.valid, sight.sd, filled))
    assert 0.3 < sight.quality <= filled
    begin = np.array([silhouette.window.left, silhouette.window.top])
    assert (sight.outline == silhouette.outline + begin).all()
    seen = depth[sight.outline[:, 1].astype(int), sight.outline[:, 0].astype(int)]
    assert np.median(seen) == pytest.approx(1600, abs=10)  # mm, on the cloth
    assert tracker._last == (0.4, silhouette.window)
    assert tracker.scan(0.4, grid=5, contour=8).time == 0.4
    assert np.isnan(tracker.traces).all()
    assert tracker.traces.dtype == float


def test_nothing_found_is_a_sight_of_all_points_none_of_them_seen_or_hidden():
    sight = nothing_found(3)
    assert (sight.points.shape, sight.sd.shape, sight.pixels.shape, sight.outline.shape) == (
        (3, 3),
        (3, 3),
        (3, 2),
        (0, 2),
    )
    for of_points in (sight.points, sight.sd, sight.pixels):
        assert of_points.dtype == float
        assert np.isnan(of_points).all()
    for flags in (sight.valid, sight.hidden):
        assert (flags.dtype, flags.tolist()) == (bool, [False] * 3)


def test_a_frame_without_points_has_no_quality():
    assert frame_quality(np.zeros(0, bool), np.zeros((0, 3)), 1.0) == 0.0


@pytest.mark.parametrize(("beyond", "counted"), [(0.0001, LEAST_BEYOND), (0.07, 0.07), (2.0, MOST_BEYOND)])
def test_the_features_of_a_corner_are_the_logarithms_of_missing_and_visible_cloth(beyond, counted):
    """Areas of twice and once the unit: ln 3 and ln 2; those of a sleeve's tip once more."""
    away = np.log(counted / BEYOND)
    found = traces(beyond, 2.0 * PEEKING, PEEKING, Slant(0.2, 0.1), is_tip=True)
    assert found == pytest.approx([away, np.log(3.0), np.log(2.0), 0.2, 0.1, 1.0, away, 0.2])
    assert traces(beyond, 0.0, 0.0, Slant(0.2, 0.1), is_tip=False)[5:].tolist() == [0.0, 0.0, 0.0]


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_belief_is_bounded_and_fades_with_the_time_since_its_frame(sign):
    belief = Belief()
    found = np.full((4, 8), np.nan)
    found[0] = sign * np.array([1.0, -1.0, -1.0, 1.0, -1.0, 1.0, 1.0, 1.0]) * 10.0
    belief.update(found, 7.0)
    assert belief.before(7.0) == pytest.approx([sign * MOST, PLACED, PLACED, PLACED])
    p = 1.0 / (1.0 + np.exp(-np.array([sign * MOST, PLACED])))
    faded = 1.0 / 3.0 + (p - 1.0 / 3.0) * np.exp(-4.9 * 0.1)
    assert belief.before(7.1)[:2] == pytest.approx(np.log(faded / (1.0 - faded)))

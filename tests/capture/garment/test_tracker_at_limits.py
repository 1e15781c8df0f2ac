"""The silhouette tracker at its limits: before its first frame, at the picture's top, near the camera and in time."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from capture.depth.surface import CorrelationMeter
from capture.garment import tracker as module
from capture.garment.folding import THRESHOLD, TRACES
from capture.garment.occlusion import COVERED
from capture.garment.silhouette import Window
from capture.garment.tracker import BY_WAYS, LONGEST_TRUST, SilhouetteTracker, garment_tracker
from firmware_host.synthetic.garments import GARMENTS
from firmware_host.synthetic.scene import RIG
from tests.capture.garment.flat_cloth import SQUARE, WHOLE, silhouette
from tests.capture.garment.garment_scenes import hung
from tests.capture.garment.test_by_ways import THIRD, step
from tests.capture.garment.test_tracker_by_hand import FLAT, NONE, PIXELS, PLACES, FixedBelief

__all__ = ["step"]


@pytest.fixture
def tracker():
    made = SilhouetteTracker(GARMENTS["swatch"](), RIG, CorrelationMeter())
    made.sensor = SQUARE
    made.flat = SimpleNamespace(distances=FLAT.copy(), reach=0.5, area=0.12, from_ends=FLAT[:2], roles=[0, 1, 2, 3, 4])
    return made


def test_before_the_first_frame_no_corner_has_left_a_trace(tracker):
    assert tracker.traces.shape == (4, len(TRACES))
    assert tracker.traces.dtype == float
    assert np.isnan(tracker.traces).all()


def test_a_garment_without_a_way_between_its_corners_has_no_centre(tracker):
    pixel, sd = tracker._centre(silhouette(WHOLE), np.full((4, 20, 20), np.inf, np.float32), 8)
    assert pixel.shape == (2,)
    assert np.isnan([*pixel, sd]).all()


def test_each_corner_is_covered_by_its_own_longest_way(tracker, monkeypatch):
    """Of 0.4 to 0.8 m a fortieth is missing, or a little more."""
    tracker.flat.distances[:] = np.array([0.4, 0.5, 0.6, 0.8])[:, None] * (1 - np.eye(4))
    monkeypatch.setattr(tracker, "_ends_at_a_nearer_thing", lambda *given: True)
    most = COVERED * np.array([0.4, 0.5, 0.6, 0.8])
    places = np.zeros((4, 3))
    for by_all, is_covered in ((most, False), (np.nextafter(most, 1.0), True)):
        found = tracker._covered(None, SimpleNamespace(by_all=by_all, places=places))
        assert found.tolist() == [is_covered] * 4


def test_a_belief_knows_the_time_of_its_last_frame():
    world = hung("swatch", 1.6)
    depth, _ = world.frame(0, world.renderer())
    tracker = garment_tracker(world.garment, RIG)
    for time in (0.4, 0.5):
        tracker.track(depth, world.hanger.held[0], time)
        assert tracker._belief._time == time


def test_a_garment_is_sought_near_its_last_place_alone_where_it_is_found_there(monkeypatch):
    world, asked = hung("swatch", 1.6), []
    depth, _ = world.frame(0, world.renderer())
    held, tracker, cut_out = world.hanger.held[0], garment_tracker(world.garment, RIG), module.cut_out
    monkeypatch.setattr(
        module, "cut_out", lambda depth, window, *a, **k: asked.append(window) or cut_out(depth, window, *a, **k)
    )
    for time in (0.0, 1 / 30):
        assert tracker.track(depth, held, time).valid.all()
    first, second = asked
    assert first == tracker._window(depth.shape, held, float(held[:, 2].mean()))
    assert second.right - second.left < 0.8 * (first.right - first.left)


def test_a_window_begins_with_the_picture_where_the_held_edge_is_at_its_top(tracker):
    held = np.array([[-0.2, -239.5 * 1.6 / 500, 1.6], [0.2, -239.5 * 1.6 / 500, 1.6]])
    assert tracker._window((480, 640), held, 1.6).top == 0


def test_a_surface_nearer_than_a_metre_is_one(tracker):
    surface, cell = tracker._surface(silhouette(np.ones((160, 200)), 0.8))
    assert cell in (17, 18)  # 0.028 x 500 / 0.8 is 17.5
    assert surface[..., 2] == pytest.approx(np.full(surface.shape[:2], 0.8))


@pytest.mark.parametrize(("pixels", "is_known"), [(90, False), (91, True)])
def test_a_node_has_cloth_in_more_than_exactly_two_fifths_of_its_pixels(tracker, pixels, is_known):
    """Of 15 x 15 pixels: at 14 / 15 m, 28 mm are 15 px of 500."""
    mask = np.ones((30, 30), np.uint8)
    mask[np.divmod(np.arange(225)[pixels:], 15)] = 0
    surface, cell = tracker._surface(silhouette(mask, 14 / 15))
    assert cell == 15
    assert np.isfinite(surface[0, 0, 2]) == is_known
    assert np.isfinite(surface[1, 1, 2])


def test_a_belief_of_exactly_the_threshold_hides_no_corner(tracker, monkeypatch):
    monkeypatch.setattr(tracker, "_ends_at_a_nearer_thing", lambda *given: False)
    tracker._belief = FixedBelief(THRESHOLD, np.nextafter(THRESHOLD, 1.0), 0.0, 0.0)
    assert tracker._hidden(None, (480, 640), PIXELS, PLACES, FLAT, NONE, 0.0).tolist() == [False, True, False, False]


def test_the_last_window_is_trusted_for_exactly_its_time(tracker):
    whole = Window(0, 0, 640, 480)
    tracker._last = (0.0, Window(200, 100, 400, 300))
    assert LONGEST_TRUST == 0.2
    assert tracker._recent_window(whole, 1.6, 0.2) is not None
    assert tracker._recent_window(whole, 1.6, float(np.nextafter(0.2, 1.0))) is None


def test_a_corner_exactly_three_centimetres_from_the_held_edges_end_is_not_held(tracker):
    held = np.tile([0.0, 0.0, 1.6], (2, 1))
    tracker.held_corners = [0, 1, None, None]
    places = np.tile([0.0, 0.0, 1.6], (4, 1))
    places[:2, 0] = 0.03, np.nextafter(0.03, 0.0)
    assert tracker._match_held(places, np.full((4, 3), 0.003), held, 0.0).tolist() == [False, True, False, False]


@pytest.mark.parametrize(("beyond", "is_placed"), [(BY_WAYS, False), (np.nextafter(BY_WAYS, 0.0), True)])
def test_a_corner_exactly_at_the_farthest_from_the_seen_cloth_is_not_placed_there(step, beyond, is_placed):
    assert step(0).valid.all()
    assert step(1, dropped=THIRD, beyond=beyond).valid.all() == is_placed

"""A corner that is no corner of the outline, and lies at the nearest point of the visible cloth."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from capture.depth.surface import CorrelationMeter
from capture.garment import tracker as module
from capture.garment.folding import TRACES
from capture.garment.tracker import SilhouetteTracker
from firmware_host.synthetic.garments import GARMENTS
from firmware_host.synthetic.scene import RIG
from tests.capture.garment.flat_cloth import SQUARE
from tests.capture.garment.test_tracker_by_hand import FLAT, HELD, NONE, PLACES

NEAREST = PLACES[:4] + np.array([0.0, -0.01, 0.016])  # of the visible cloth, 1.616 m away
THIRD = np.arange(4) == 2


@pytest.fixture
def step(monkeypatch):
    """Track a frame: which corners contradict the flat garment, how far one is beyond the cloth, which are hidden."""
    tracker = SilhouetteTracker(GARMENTS["swatch"](), RIG, CorrelationMeter())
    tracker.sensor = SQUARE
    tracker.flat = SimpleNamespace(
        distances=FLAT, reach=0.5, area=0.12, from_ends=FLAT[:2], roles=[0, 1, 2, 3, 4], sides=FLAT[0]
    )
    tracker.held_corners = [0, 1, None, None]
    seen = SimpleNamespace(pixels=np.full((4, 2), 300.0), sd=np.full((4, 2), 0.4))
    depth = np.zeros((480, 640), np.uint16)
    depth[242:340, 260:380] = 1600
    monkeypatch.setattr(tracker, "_ways_between", lambda surface, places: (None, FLAT))
    monkeypatch.setattr(tracker, "_centre", lambda *given: (np.array([319.5, 280.0]), 0.5))
    monkeypatch.setattr(tracker, "_traces", lambda *given: np.zeros(len(TRACES)))
    monkeypatch.setattr(tracker, "_covered", lambda *given: NONE)
    monkeypatch.setattr(module, "SeenWays", lambda *given: None)

    def go(frame, *, dropped=NONE, beyond=0.0, hidden=NONE, tips=()):
        tracker.finder = SimpleNamespace(find=lambda *given: seen, tips=tips)
        turn = iter(PLACES)
        far = SimpleNamespace(by_all=np.full(4, beyond), places=NEAREST)
        placer = SimpleNamespace(place=lambda pixel, sd: (next(turn).copy(), np.full(3, 0.002)))
        monkeypatch.setattr(module, "Placer", lambda *given: placer)
        monkeypatch.setattr(module, "folded_away", lambda *given: (dropped, NONE))
        monkeypatch.setattr(module, "beyond_the_seen", lambda *given: far)
        monkeypatch.setattr(tracker, "_hidden", lambda *given: hidden)
        return tracker.track(depth, HELD, frame / 30)

    return go


@pytest.mark.parametrize("tips", [(), (2,)])
def test_a_corner_at_the_nearest_cloth_is_as_uncertain_as_it_is_far_away(step, tips):
    """Along each axis 0.0055 of 1.616 m, 8.9 mm; along x 19 mm too, but for the tip of a sleeve."""
    assert step(0, tips=tips).valid.all()
    found = step(1, dropped=THIRD, beyond=0.019, tips=tips)
    assert found.valid.all()
    assert found.points[[0, 1, 3]] == pytest.approx(PLACES[[0, 1, 3]])
    assert found.points[2] == pytest.approx([0.2, 0.29, 1.616])
    beside = 0.0 if tips else 0.019
    assert found.sd[2] == pytest.approx([math.hypot(0.0055 * 1.616, beside), 0.0055 * 1.616, 0.0055 * 1.616])
    assert found.pixels[2] == pytest.approx([319.5 + 0.2 * 500 / 1.616, 239.5 + 0.29 * 500 / 1.616])


def test_a_held_corner_is_not_placed_by_its_distances(step):
    """The markers show the held edge; distances put such corners up to 32 mm from it."""
    assert step(0).valid.all()
    found = step(1, dropped=np.arange(4) == 1, beyond=0.001)
    assert found.valid.tolist() == [True, False, True, True, False]


@pytest.mark.parametrize(("beyond", "is_hidden"), [(0.021, False), (0.019, True)])
def test_a_contradicted_corner_farther_than_two_centimetres_or_a_hidden_one_is_missing(step, beyond, is_hidden):
    assert step(0).valid.all()
    found = step(1, dropped=THIRD, beyond=beyond, hidden=THIRD & is_hidden)
    assert found.valid.tolist() == [True, True, False, True, False]  # nor has the centre a place
    assert np.isnan(found.points[2]).all()
    assert found.hidden.tolist() == [False, False, is_hidden, False, False]


def test_a_corner_at_the_nearest_cloth_counts_where_its_motion_was_followed_before(step):
    """After a frame without it, it does not count again; the corners of the outline and the centre do."""
    assert step(0).valid.all()
    assert step(1).valid.all()
    assert not step(2, dropped=THIRD, beyond=0.021).valid[2]
    assert step(3, dropped=THIRD, beyond=0.019).valid.tolist() == [True, True, False, True, True]
    assert step(4).valid.all()

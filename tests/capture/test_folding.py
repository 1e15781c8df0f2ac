"""Which corners in doubt are told as hidden: other layers beside a fold, and what they and missing cloth say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.hidden_corners import Examples, depth_frames, examples, fit, left_out, rates
from benchmarks.tracking_scenes import Scene
from capture.folding import COEFFICIENTS, CONSTANT, THRESHOLD, TRACES, probability, traces
from capture.garment_tracker import garment_tracker
from capture.other_layers import Layers, other_layers
from firmware_host.synthetic.garments import GARMENTS
from firmware_host.synthetic.scene import RIG
from tests.capture.garment_scenes import hung

NOTHING = Layers(0.0, 0.0)
CORNER = np.array(GARMENTS["swatch"]().points[2].at_m)


def seen(change=lambda depth: None, cut=0.14):
    """Layers beside a swatch's folded corner at 1.6 m, its pixel, and what its tracker says of it."""
    world = hung("swatch", 1.6, fold=(CORNER - [cut, 0.0], CORNER + np.array([0.0, cut])))
    depth, _ = world.frame(0, world.renderer())
    change(depth)
    tracker = garment_tracker(world.garment, RIG)
    held = world.hanger.held[0]
    sight = tracker.track(depth, held, 0.0)
    silhouette = tracker._silhouette(depth, held, 0.01)
    middle = np.array([319.5, 239.5]) + 575.8 / 1.6 * (CORNER * [1, -1] + [-0.5 * cut, -0.18 - 0.5 * cut])
    return other_layers(silhouette, middle, cut / np.sqrt(2), held, tracker.flat.from_ends[:, 2], RIG.sensor), sight


def test_a_fold_with_nothing_beside_it_shows_no_other_layer_and_is_told_as_hidden():
    layers, sight = seen()
    assert layers.peeking < 3e-5
    assert layers.before < 0.01
    assert sight.hidden.tolist() == [False, False, True, False, False]


def test_cloth_that_peeks_out_behind_a_fold_is_measured_by_its_area_and_makes_hidden_doubtful():
    """20 x 20 pixels 0.12 m farther away, just outside the fold: 400 px (1.6 m / 575.8)^2 = 3.1e-3 m^2."""

    def peek(depth):
        depth[305:325, 370:390] = 1720

    layers, sight = seen(peek)
    assert layers.peeking == pytest.approx(400 * (1.6 / 575.8) ** 2, rel=0.2)
    assert not sight.hidden[2]


def test_the_bar_and_the_plates_above_the_held_edge_are_no_layer():
    world = hung("swatch", 1.6)
    depth, _ = world.frame(0, world.renderer())
    tracker = garment_tracker(world.garment, RIG)
    held = world.hanger.held[0]
    silhouette = tracker._silhouette(depth, held, 0.0)
    top = 575.8 * held[1, :2] / held[1, 2] + [319.5, 239.5]
    assert other_layers(silhouette, top, 0.2, held, tracker.flat.from_ends[:, 1], RIG.sensor).peeking < 1e-4


def test_a_layer_before_the_garment_counts_where_its_nearer_side_is_outside():
    """A flap 40 pixels high from the right side inwards, 60 mm nearer: its inner edge is 40 px, 0.11 m long."""
    world = hung("swatch", 1.6)
    depth, _ = world.frame(0, world.renderer())
    right = int(319.5 + 575.8 * 0.2 / 1.6)
    tracker = garment_tracker(world.garment, RIG)
    held = world.hanger.held[0]

    def before(first, last):
        folded = depth.copy()
        folded[250:290, first:last] = 1540
        silhouette = tracker._silhouette(folded, held, 0.0)
        at = np.array([right, 270.0])
        return other_layers(silhouette, at, 0.2, held, tracker.flat.from_ends[:, 2], RIG.sensor).before

    flap, inside = before(right - 20, right), before(right - 45, right - 25)
    # Two pixels deep behind the step, and the flap's upper and lower rims beside the outline add some.
    assert flap > 1.5 * 40 * 1.6 / 575.8
    assert inside < 0.9 * flap


def test_missing_cloth_speaks_for_a_fold_and_other_layers_speak_against_it():
    deep = traces(0.1, 0.1, NOTHING, NOTHING, is_missing=False)
    assert deep[0] == pytest.approx(np.log(0.1 / 0.035))
    assert probability(deep) > 0.9
    assert probability(traces(0.01, 0.01, NOTHING, NOTHING, is_missing=False)) < 0.1
    peeking = Layers(5e-4, 0.0)
    assert probability(traces(0.1, 0.1, peeking, peeking, is_missing=False)) < probability(deep) - 0.3
    assert probability(np.zeros(len(TRACES))) == pytest.approx(1 / (1 + np.exp(-CONSTANT)))
    assert not probability(np.full(len(TRACES), np.nan)) > THRESHOLD


def test_examples_are_the_corners_in_doubt_with_what_is_true_of_them():
    world = hung("swatch", 1.6, fold=(CORNER - [0.14, 0.0], CORNER + np.array([0.0, 0.14])))
    scene = Scene("swatch", "hard", 1.6, "plain", False, 3)
    one = examples(scene, depth_frames(scene, replace(world, time=np.array([1.0, 1.0 + 1 / 30]))))
    assert one.traces.shape == (2, len(TRACES))
    assert one.hidden.tolist() == [True, True]
    assert not one.visible.any()
    assert one.unasked == 0
    assert one.pixels.tolist() == [0, 0]
    assert one.corner.tolist() == [2, 2]
    assert (probability(one.traces) > THRESHOLD).all()


def test_the_fit_finds_the_weights_that_made_the_examples():
    """20 000 examples of the shipped weights: their standard errors are below 0.06 for traces of unit spread."""
    rng = np.random.default_rng(5)
    drawn = rng.standard_normal((20_000, len(TRACES)))
    hidden = rng.random(20_000) < probability(drawn)
    constant, weights = fit(drawn, hidden.astype(float))
    assert constant == pytest.approx(CONSTANT, abs=0.15)
    np.testing.assert_allclose(weights, COEFFICIENTS, atol=0.15)


def test_a_cloth_is_judged_by_the_others_and_what_was_never_in_doubt_is_missed():
    rng = np.random.default_rng(6)

    def cloth(name, sign):
        drawn = rng.standard_normal((400, 1))
        none = np.zeros(400, int)
        return Examples(name, drawn, sign * drawn[:, 0] > 0, sign * drawn[:, 0] <= 0, 100, none, none)

    alike = [cloth(name, 1) for name in "abc"]
    precision, recall = rates(alike, left_out(alike), 0.5)
    assert precision > 0.97
    hidden = sum(e.hidden.sum() for e in alike)
    assert recall == pytest.approx(hidden / (hidden + 300), abs=0.03)
    # One that is the other way round is judged wrongly: its own examples do not count.
    odd = [*alike, cloth("d", -1)]
    of_odd = left_out(odd)[-400:]
    assert ((of_odd > 0.5) == odd[-1].hidden).mean() < 0.05

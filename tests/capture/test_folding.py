"""Which corners in doubt are told as hidden: other layers beside a fold, and what they and missing cloth say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.hidden_corners import Examples, depth_frames, examples, fit, fit_to, left_out, rates
from benchmarks.tracking_scenes import Scene
from capture.folding import FITTED, FORGETTING, PLACED, REST, THRESHOLD, TRACES, Belief, Weights, traces
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


def probability(*corners):
    """How probable it is at first sight that corners with these traces are hidden."""
    return Belief(len(corners)).update(np.array(corners), 0.0)


def test_missing_cloth_speaks_for_a_fold_and_other_layers_speak_against_it():
    deep = traces(0.1, 0.1, NOTHING, NOTHING, is_missing=False, is_tip=False)
    assert deep[0] == pytest.approx(np.log(0.1 / 0.035))
    assert probability(deep) > 0.9
    assert probability(traces(0.01, 0.01, NOTHING, NOTHING, is_missing=False, is_tip=False)) < 0.1
    peeking = Layers(5e-4, 0.0)
    assert probability(traces(0.1, 0.1, peeking, peeking, is_missing=False, is_tip=False)) < probability(deep) - 0.3
    first = FITTED.constant + FITTED.before * np.log(REST / (1 - REST))
    assert probability(np.zeros(len(TRACES))) == pytest.approx(1 / (1 + np.exp(-first)))
    assert not probability(np.full(len(TRACES), np.nan)) > THRESHOLD


def test_less_missing_cloth_hides_the_tip_of_a_sleeve_than_the_corner_of_a_hem():
    hem, tip = (traces(0.05, 0.05, NOTHING, NOTHING, is_missing=False, is_tip=t) for t in (False, True))
    assert tip[7:] == pytest.approx([1.0, np.log(0.05 / 0.035), np.log(0.05 / 0.035)])
    assert probability(tip) > probability(hem)


def test_what_was_before_counts_and_is_forgotten():
    """By hand: p' = R + (p - R) exp(-f dt), half of the way to R after ln 2 / f."""
    unclear = np.zeros((2, len(TRACES)))
    belief = Belief(2)
    first = belief.update(np.vstack([np.full(len(TRACES), np.nan), unclear[1]]), 0.0)
    assert np.isnan(first[0])
    placed = 1 / (1 + np.exp(-PLACED))
    later = belief.before(np.log(2) / FORGETTING)
    assert 1 / (1 + np.exp(-later)) == pytest.approx([(placed + REST) / 2, (first[1] + REST) / 2])
    in_place, in_doubt = belief.update(unclear, 1 / 30)
    assert in_place < in_doubt
    assert belief.before(60.0) == pytest.approx(np.full(2, np.log(REST / (1 - REST))))


def test_examples_are_the_corners_in_doubt_with_what_is_true_of_them():
    world = hung("swatch", 1.6, fold=(CORNER - [0.14, 0.0], CORNER + np.array([0.0, 0.14])))
    scene = Scene("swatch", "hard", 1.6, "plain", False, 3)
    one = examples(scene, depth_frames(scene, replace(world, time=np.array([1.0, 1.0 + 1 / 30]))))
    assert one.traces.shape == (2, 4, len(TRACES))
    assert one.asked.tolist() == one.hidden.tolist() == one.learnt.tolist() == [[False, False, True, False]] * 2
    assert one.visible[:, [0, 1, 3]].all()
    assert one.pixels[:, 2].tolist() == [0, 0]
    assert (one.followed(FITTED)[1][:, 2] > THRESHOLD).all()


def random_cloth(name, rng, is_hidden):
    """Four corners in 400 frames, all in doubt, hidden by a function of their traces, (400, 4, traces)."""
    drawn = rng.standard_normal((400, 4, len(TRACES)))
    hidden = is_hidden(drawn)
    return Examples(name, np.arange(400) / 30, drawn, hidden, ~hidden, np.zeros((400, 4), int))


def test_the_fit_finds_the_weights_that_made_the_examples():
    """16 000 examples of the shipped weights: their standard errors are below 0.06 for traces of unit spread."""
    rng = np.random.default_rng(5)

    def is_hidden(drawn):
        """Drawn with what the shipped weights say of it, one after the other."""
        belief = Belief()
        probable = np.array([belief.update(found, k / 30) for k, found in enumerate(drawn)])
        return rng.random(probable.shape) < probable

    weights = fit_to([random_cloth(str(k), rng, is_hidden) for k in range(10)])
    assert weights.constant == pytest.approx(FITTED.constant, abs=0.15)
    np.testing.assert_allclose(weights.coefficients, FITTED.coefficients, atol=0.2)
    assert weights.before == pytest.approx(FITTED.before, abs=0.1)


def test_one_trace_that_decides_alone_gets_its_weight():
    """One in three is hidden whatever is seen: the constant is ln(1/2), the coefficient 0, within three errors."""
    rng = np.random.default_rng(7)
    constant, weights = fit(rng.standard_normal((9000, 1)), (rng.random(9000) < 1 / 3).astype(float))
    assert constant == pytest.approx(np.log(0.5), abs=0.07)
    assert weights[0] == pytest.approx(0.0, abs=0.07)


def test_a_cloth_is_judged_by_the_others_and_what_was_never_in_doubt_is_missed():
    rng = np.random.default_rng(6)
    alike = [random_cloth(name, rng, lambda drawn: drawn[..., 0] > 0) for name in "abc"]
    for cloth in alike:
        cloth.traces[:100][cloth.hidden[:100]] = np.nan
    precision, recall = rates(alike, left_out(alike), 0.5)
    assert precision > 0.97
    assert recall == pytest.approx(0.75, abs=0.03)
    # One that is the other way round is judged wrongly: its own examples do not count.
    odd = [*alike, random_cloth("d", rng, lambda drawn: drawn[..., 0] < 0)]
    assert ((left_out(odd)[-1] > 0.5) == odd[-1].hidden).mean() < 0.1


def test_weights_without_memory_forget_at_once():
    belief = Belief(1, Weights(0.0, np.zeros(len(TRACES)), 0.0))
    assert belief.update(np.zeros((1, len(TRACES))), 0.0) == belief.update(np.zeros((1, len(TRACES))), 0.1) == 0.5

"""Doubtful corners reported as hidden, from the area that peeks out, the edge's slant and the missing cloth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.hidden_corners import Examples, depth_frames, examples, fit, fit_to, left_out, rates
from benchmarks.tracking_scenes import Scene
from capture.garment.folding import (
    FITTED,
    FOLDED_AT_REST,
    FORGETTING,
    PLACED,
    THRESHOLD,
    TRACES,
    Belief,
    Weights,
    traces,
)
from capture.garment.peeking import peeking_area
from capture.garment.slant import FITTED_AROUND, UPRIGHT, Slant, rim_slant
from capture.garment.tracker import garment_tracker
from firmware_host.synthetic.garments import GARMENTS
from firmware_host.synthetic.scene import RIG
from tests.capture.garment.garment_scenes import hung

CORNER = np.array(GARMENTS["swatch"]().points[2].at_m)


def seen(change=lambda depth: None, cut=0.14):
    """Return the area that peeks out beside a swatch's folded corner at 1.6 m, its pixel, and the tracker's result."""
    world = hung("swatch", 1.6, fold=(CORNER - [cut, 0.0], CORNER + np.array([0.0, cut])))
    depth, _ = world.frame(0, world.renderer())
    change(depth)
    tracker = garment_tracker(world.garment, RIG)
    held = world.hanger.held[0]
    sight = tracker.track(depth, held, 0.0)
    silhouette = tracker._silhouette(depth, held, 0.01)
    middle = np.array([319.5, 239.5]) + 575.8 / 1.6 * (CORNER * [1, -1] + [-0.5 * cut, -0.18 - 0.5 * cut])
    return peeking_area(silhouette, middle, cut / np.sqrt(2), held, tracker.flat.from_ends[:, 2], RIG.sensor), sight


def test_a_fold_with_nothing_beside_it_shows_no_other_layer_and_counts_as_hidden():
    peeking, sight = seen()
    assert peeking < 3e-5
    assert sight.hidden.tolist() == [False, False, True, False, False]


def test_cloth_that_is_visible_behind_a_fold_is_measured_by_its_area_and_makes_hidden_doubtful():
    """20 x 20 pixels 0.12 m farther away, just outside the fold: 400 px (1.6 m / 575.8)^2 = 3.1e-3 m^2."""

    def peek(depth):
        depth[305:325, 370:390] = 1720

    peeking, sight = seen(peek)
    assert peeking == pytest.approx(400 * (1.6 / 575.8) ** 2, rel=0.2)
    assert not sight.hidden[2]


@pytest.mark.parametrize(("before", "hides"), [(0.1, False), (0.4, True)])
def test_a_surface_nearer_than_a_fold_hides_a_corner_only_where_missing_cloth_cannot_reach(before, hides):
    """Beside the outline's corner, where 0.1 m of cloth is missing: that, folded forwards, may be 0.1 m nearer."""

    def put(depth):
        patch = depth[325:345, 345:365]
        patch[(patch == 0) | (patch > 1700)] = round(1e3 * (1.6 - before))

    _, sight = seen(put)
    assert sight.hidden[2] == hides


def test_the_bar_and_the_plates_above_the_held_edge_are_no_layer():
    world = hung("swatch", 1.6)
    depth, _ = world.frame(0, world.renderer())
    tracker = garment_tracker(world.garment, RIG)
    held = world.hanger.held[0]
    silhouette = tracker._silhouette(depth, held, 0.0)
    top = 575.8 * held[1, :2] / held[1, 2] + [319.5, 239.5]
    assert peeking_area(silhouette, top, 0.2, held, tracker.flat.from_ends[:, 1], RIG.sensor) < 1e-4


def slanted(away, along):
    """Slant of a swatch's right rim, away from its corners, where its last 25 pixels, 69 mm, are bent.

    away, along [m/m]: how fast they go away from the sensor, outwards and downwards.
    """
    world = hung("swatch", 1.6)
    depth, _ = world.frame(0, world.renderer())
    right, row, pixel = int(319.5 + 575.8 * 0.2 / 1.6), 270, 1.6 / 575.8
    rows, columns = np.mgrid[row - 25 : row + 26, right - 25 : right + 1]
    bent = 1600 + 1e3 * pixel * (away * (columns - right) + along * (rows - row))
    depth[rows, columns] = np.where(depth[rows, columns] > 0, bent, 0)
    tracker = garment_tracker(world.garment, RIG)
    silhouette = tracker._silhouette(depth, world.hanger.held[0], 0.0)
    return rim_slant(silhouette, np.array([right, row], float), 1.6, RIG.sensor)


@pytest.mark.parametrize(("away", "along"), [(0.0, 0.0), (0.5, 0.0), (-0.5, 0.0), (0.4, 0.4), (0.4, -0.4)])
def test_the_slant_at_the_rim_is_the_angle_outwards_with_its_sign_and_along_the_rim_without(away, along):
    """The half disc's middle lies inwards, so outwards is to the right, within the 4 degrees of a ragged rim."""
    assert slanted(away, along) == pytest.approx((np.arctan(away), np.arctan(abs(along))), abs=np.radians(4.0))


def test_a_rim_whose_depth_is_missing_counts_as_level():
    world = hung("swatch", 1.6)
    depth, _ = world.frame(0, world.renderer())
    tracker = garment_tracker(world.garment, RIG)
    silhouette = tracker._silhouette(depth, world.hanger.held[0], 0.0)
    nowhere = np.array([silhouette.window.left - 2 * FITTED_AROUND * 575.8 / 1.6, 270.0])
    assert rim_slant(silhouette, nowhere, 1.6, RIG.sensor) == UPRIGHT
    silhouette.depth[:] = 0.0
    assert rim_slant(silhouette, np.array([319.0, 270.0]), 1.6, RIG.sensor) == UPRIGHT


def probability(*corners):
    """Return the probability in a first frame that corners with these features are hidden."""
    return Belief(len(corners)).update(np.array(corners), 0.0)


def test_missing_cloth_and_a_receding_rim_speak_for_a_fold_and_other_layers_speak_against_it():
    away = Slant(0.8, 0.3)
    deep = traces(0.1, 0.0, 0.0, away, is_tip=False)
    assert deep[0] == pytest.approx(np.log(0.1 / 0.035))
    assert probability(deep) > 0.9
    assert probability(traces(0.01, 0.0, 0.0, away, is_tip=False)) < 0.2
    assert probability(traces(0.1, 5e-4, 5e-4, away, is_tip=False)) < probability(deep) - 0.3
    assert probability(traces(0.1, 0.0, 0.0, Slant(-0.8, 0.3), is_tip=False)) < probability(deep) - 0.3
    assert probability(traces(0.1, 0.0, 0.0, Slant(0.8, 1.2), is_tip=False)) < probability(deep) - 0.02
    first = FITTED.constant + FITTED.before * np.log(FOLDED_AT_REST / (1 - FOLDED_AT_REST))
    assert probability(np.zeros(len(TRACES))) == pytest.approx(1 / (1 + np.exp(-first)))
    assert not probability(np.full(len(TRACES), np.nan)) > THRESHOLD


def test_less_missing_cloth_hides_the_tip_of_a_sleeve_than_the_corner_of_a_hem():
    hem, tip = (traces(0.05, 0.0, 0.0, Slant(0.5, 0.0), is_tip=t) for t in (False, True))
    assert tip[5:] == pytest.approx([1.0, np.log(0.05 / 0.035), 0.5])
    assert probability(tip) > probability(hem)


def test_log_odds_of_earlier_frames_count_and_decay():
    """By hand: p' = R + (p - R) exp(-f dt), half of the way to R after ln 2 / f."""
    unclear = np.zeros((2, len(TRACES)))
    belief = Belief(2)
    first = belief.update(np.vstack([np.full(len(TRACES), np.nan), unclear[1]]), 0.0)
    assert np.isnan(first[0])
    placed = 1 / (1 + np.exp(-PLACED))
    later = belief.before(np.log(2) / FORGETTING)
    assert 1 / (1 + np.exp(-later)) == pytest.approx([(placed + FOLDED_AT_REST) / 2, (first[1] + FOLDED_AT_REST) / 2])
    in_place, in_doubt = belief.update(unclear, 1 / 30)
    assert in_place < in_doubt
    assert belief.before(60.0) == pytest.approx(np.full(2, np.log(FOLDED_AT_REST / (1 - FOLDED_AT_REST))))


def test_examples_are_the_corners_in_doubt_with_what_is_true_of_them():
    world = hung("swatch", 1.6, fold=(CORNER - [0.14, 0.0], CORNER + np.array([0.0, 0.14])))
    scene = Scene("swatch", "hard", 1.6, "plain", False, 3)
    one = examples(scene, depth_frames(scene, replace(world, time=np.array([1.0, 1.0 + 1 / 30]))))
    assert one.traces.shape == (2, 4, len(TRACES))
    assert one.asked.tolist() == one.hidden.tolist() == one.learnt.tolist() == [[False, False, True, False]] * 2
    assert one.visible[:, [0, 1, 3]].all()
    assert one.pixels[:, 2].tolist() == [0, 0]
    assert one.reported.tolist() == one.hidden.tolist()
    assert (one.followed(FITTED)[1][:, 2] > THRESHOLD).all()


def random_cloth(name, rng, is_hidden, frames=400):
    """Four corners in so many frames, all in doubt, hidden by a function of their traces, (frames, 4, traces)."""
    drawn = rng.standard_normal((frames, 4, len(TRACES)))
    hidden = is_hidden(drawn)
    return Examples(name, np.arange(frames) / 30, drawn, hidden, ~hidden, np.zeros((frames, 4), int), hidden)


@pytest.mark.slow
def test_the_fit_finds_the_weights_that_made_the_examples():
    """16 000 examples of the shipped weights: their standard errors are below 0.06 for traces of unit spread."""
    rng = np.random.default_rng(5)

    def is_hidden(drawn):
        """Draw each state from the probability by the shipped weights, frame by frame."""
        belief = Belief()
        probable = np.array([belief.update(found, k / 30) for k, found in enumerate(drawn)])
        return rng.random(probable.shape) < probable

    weights = fit_to([random_cloth(str(k), rng, is_hidden) for k in range(10)])
    assert weights.constant == pytest.approx(FITTED.constant, abs=0.15)
    np.testing.assert_allclose(weights.coefficients, FITTED.coefficients, atol=0.2)
    assert weights.before == pytest.approx(FITTED.before, abs=0.1)


def test_one_feature_that_decides_alone_gets_its_weight():
    """One in three is hidden whatever is seen: the constant is ln(1/2), the coefficient 0, within three errors."""
    rng = np.random.default_rng(7)
    constant, weights = fit(rng.standard_normal((9000, 1)), (rng.random(9000) < 1 / 3).astype(float))
    assert constant == pytest.approx(np.log(0.5), abs=0.07)
    assert weights[0] == pytest.approx(0.0, abs=0.07)


def test_a_cloth_is_judged_by_the_others_and_what_was_never_in_doubt_is_missed():
    rng = np.random.default_rng(6)
    alike = [random_cloth(name, rng, lambda drawn: drawn[..., 0] > 0, 200) for name in "abc"]
    for cloth in alike:
        cloth.traces[:50][cloth.hidden[:50]] = np.nan
    precision, recall = rates(alike, left_out(alike), 0.5)
    assert precision > 0.97
    assert recall == pytest.approx(0.75, abs=0.03)
    # A cloth with the opposite relation is judged wrongly, since its own examples are left out.
    odd = [*alike, random_cloth("d", rng, lambda drawn: drawn[..., 0] < 0, 200)]
    assert ((left_out(odd)[-1] > 0.5) == odd[-1].hidden).mean() < 0.1


def test_weights_without_memory_forget_at_once():
    belief = Belief(1, Weights(0.0, np.zeros(len(TRACES)), 0.0))
    assert belief.update(np.zeros((1, len(TRACES))), 0.0) == belief.update(np.zeros((1, len(TRACES))), 0.1) == 0.5


@pytest.mark.parametrize(
    ("feature", "weight"), [(0, 2.61), (1, -0.95), (2, -1.04), (3, 2.68), (4, -2.04), (5, 2.77), (6, 3.51), (7, 1.74)]
)
def test_a_unit_of_each_feature_adds_its_weight_to_the_log_odds(feature, weight):
    """As `benchmarks/hidden_corners.py` prints the weights for the development sets."""
    unit = np.zeros(len(TRACES))
    unit[feature] = 1.0
    none, one = (np.log(p / (1 - p)) for p in probability(np.zeros(len(TRACES)), unit))
    assert none == pytest.approx(0.16 + 0.60 * np.log(1 / 2))  # one in three before anything is seen
    assert one - none == pytest.approx(weight)

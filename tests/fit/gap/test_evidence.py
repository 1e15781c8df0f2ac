"""The figures of a verdict, each from chosen errors and sizes."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from fit.effects import LIBRARY
from fit.gap.closure import BlockErrors, Resampling, gain_p_value
from fit.gap.evidence import (
    Evidence,
    are_worth_adding,
    best_of,
    is_at_bound,
    is_beyond,
    per_millimetre,
    share_in_median_block,
    size_within,
    wrong_by_mesh,
)
from fit.gap.fitting import Pinned
from fit.gap.passing import passing_effects
from fit.gap.verdict import decide
from tests.fit.gap.verdict_scene import EFFECTS, KINDS, evidence_of, hypothesis, signature

OBSERVER = SimpleNamespace(**EFFECTS)
ONE = Resampling(np.zeros((40, 12), int), 1.0)  # every draw is the first half-second


def level(one, mm):
    """The same hypothesis with the same error in every half-second."""
    errors = BlockErrors(np.full(12, 10.0 * mm**2), np.full(12, 10.0), np.zeros(3))
    return dataclasses.replace(one, errors=errors)


def flat_evidence(singles, *, base=12.0, **changed):
    """Evidence whose errors [mm] are those of every half-second, and that mesh and solver know exactly."""
    found = evidence_of(singles)
    given = {
        "base": level(found.base, base), "singles": {k: level(h, singles[k]) for k, h in found.singles.items()},
        "numerics_mm": 0.0, "resampling": ONE,
    }  # fmt: skip
    return dataclasses.replace(found, **(given | changed))


@pytest.mark.parametrize(
    ("gain", "left", "usual", "least", "is_worth_it"),
    [
        (10.0, 30.0, 0.0, 0.03, True),  # a tenth of the gap of 100, and a third of what is left
        (9.9, 20.0, 0.0, 0.03, False),
        (10.0, 30.1, 0.0, 0.03, False),
        (3.0, 5.0, 0.0, 0.03, True),  # three fifths of what is left, and three hundredths of the gap
        (2.9, 4.0, 0.0, 0.03, False),
        (3.0, 5.1, 0.0, 0.03, False),
        (1.0, 1.5, 0.0, 0.01, True),  # beside one exact law a hundredth
        (0.9, 1.5, 0.0, 0.01, False),
        (3.0, 90.0, 0.6, 0.03, True),  # three fifths in the median half-second
        (3.0, 90.0, 0.59, 0.03, False),
        (2.9, 90.0, 0.9, 0.03, False),
    ],
)
def test_a_further_effect_is_worth_adding_by_its_share_of_the_gap_and_of_what_is_left(
    gain, left, usual, least, is_worth_it
):
    found = are_worth_adding(np.array([100.0]), np.array([left]), np.array([gain]), usual, least)
    assert found.tolist() == [is_worth_it]


def test_the_median_half_second_says_what_is_usually_closed():
    """Of 18, 18 and 1000 mm^2, 9 of them noise: 9 of 9, 3 of 9, nothing; a tenth of the noise counts at least."""
    before = BlockErrors(np.array([36.0, 18.0, 1009.0]), np.array([2.0, 1.0, 1.0]), np.zeros(3))
    after = BlockErrors(np.array([18.0, 15.0, 1009.0]), np.array([2.0, 1.0, 1.0]), np.zeros(3))
    assert share_in_median_block(before, after, 3.0) == pytest.approx(1 / 3)
    quiet = BlockErrors(np.full(3, 9.1), np.ones(3), np.zeros(3))
    closed = BlockErrors(np.full(3, 9.0), np.ones(3), np.zeros(3))
    assert share_in_median_block(quiet, closed, 3.0) == pytest.approx(0.1 / 0.9)


def test_a_size_per_millimetre_is_that_of_the_mean_square_of_its_components():
    """3 and 4 mm of a typical 0.001: sqrt(12.5) mm."""
    observer = SimpleNamespace(in_mm=lambda row: float(row[0]))
    screened = signature(projected=np.array([[3.0, 0.0], [4.0, 0.0]]), typical=0.001)
    assert per_millimetre(observer, screened) == pytest.approx(0.001 / np.sqrt(12.5))
    assert wrong_by_mesh(2.0, 0.003) == pytest.approx(1.645 * 2.0 * 0.003 / 3.0)


def test_mesh_and_solver_widen_an_interval_unless_the_held_edge_decided():
    """Half of 3 and 4 are 5; of an effect that moves the edge, and was decided there, 3."""
    half = 3e-3 / 1.645 / KINDS["hem"].typical
    one = hypothesis(("hem",), 6.0, deviation=half)
    size = KINDS["hem"].typical
    found, (low, high) = size_within(OBSERVER, one.fitted, "hem", 4e-3)
    assert (found, high - found, found - low) == pytest.approx((size, 5e-3, 5e-3))
    pinned = Pinned(one.fitted.amplitudes, np.full(len(one.fitted.amplitudes), np.inf), 1.0)
    for name, wide in (("hem", True), ("clip_slack", False)):
        typical = KINDS[name].typical
        known = hypothesis((name,), 6.0, deviation=3e-3 / 1.645 / typical)
        known = dataclasses.replace(known, fitted=dataclasses.replace(known.fitted, pinned=pinned))
        _, (low, high) = size_within(OBSERVER, known.fitted, name, 4e-3)
        assert (high - low) / 2 == pytest.approx(5e-3 if wide else 3e-3)
    shorter = hypothesis(("clip_slack",), 6.0, sizes=-1.0, deviation=0.4)
    assert is_beyond(OBSERVER, shorter, "clip_slack", 0.0)
    assert not is_beyond(OBSERVER, hypothesis(("clip_slack",), 6.0, sizes=-0.6, deviation=0.4), "clip_slack", 0.0)
    near = hypothesis(("hem",), 6.0, deviation=0.4)  # 0.66 typical sizes to either side
    assert is_beyond(OBSERVER, near, "hem", 0.7 * size)
    assert not is_beyond(OBSERVER, near, "hem", 0.8 * size)  # sqrt(0.66^2 + 0.8^2) > 1


def test_an_effects_interval_holds_for_every_sound_law_of_it():
    """1.645 times its spread, beside noise, mesh and solver."""
    name = next(e.name for e in LIBRARY if e.law_spread > 0 and len(e.components) == 1)
    kind = KINDS[name]
    found = evidence_of({name: 6.0})
    wrong = wrong_by_mesh(found.numerics_mm, per_millimetre(found.observer, found.screened[name]))
    noise = np.hypot(1.645 * 0.05 * kind.typical, wrong)
    for any_law, law in ((False, 0.0), (True, 1.645 * kind.law_spread * kind.typical)):
        size, (low, high) = found.amplitude(name, any_law=any_law)
        assert size == pytest.approx(kind.typical)
        assert (size - low, high - size) == pytest.approx((np.hypot(noise, law),) * 2)


@pytest.mark.parametrize(("share", "is_there"), [(0.989, False), (0.991, True), (-0.991, True), (-0.989, False)])
def test_an_amplitude_within_a_hundredth_of_its_range_of_either_end_is_at_its_bound(share, is_there):
    slack = KINDS["clip_slack"]
    middle, half = (slack.high + slack.low) / 2, (slack.high - slack.low) / 2
    near = 2 * (abs(share) - 1) + 1  # a hundredth of the whole range is two of its half
    at = middle + np.sign(share) * near * half
    one = hypothesis(("clip_slack",), 6.0, sizes=at / slack.typical)
    assert is_at_bound(OBSERVER, one) == is_there
    assert not is_at_bound(OBSERVER, hypothesis(("hem",), 6.0, sizes=0.0))  # nothing is the end of one-sided ranges


def test_effects_that_leave_least_come_first_and_those_at_a_bound_last():
    hem = KINDS["hem"]
    singles = {
        "hem": hypothesis(("hem",), 4.0, sizes=hem.high / hem.typical), "air_drag": hypothesis(("air_drag",), 7.0),
        "clip_slack": hypothesis(("clip_slack",), 6.0),
    }  # fmt: skip
    assert [h.effects[0] for h in best_of(OBSERVER, singles)] == ["clip_slack", "air_drag", "hem"]


def test_the_p_value_of_an_effect_is_that_of_the_family():
    """Of two that were refitted and judged elsewhere; of all three screened where nothing was held out."""
    evidence = evidence_of({"hem": 11.0, "air_drag": 11.6}, joint=[(("hem", "draught"), 10.0)])
    # The first hypothesis wobbles as the base model does, which is sure of the least gain; the second does not.
    alone = gain_p_value(evidence.base.errors, evidence.singles["air_drag"].errors, 5.0)
    assert 1e-4 < alone < 0.1
    assert evidence.p_value("air_drag") == pytest.approx(2 * alone, abs=0)
    fitted_to = dataclasses.replace(evidence, is_held_out=False)
    assert fitted_to.p_value("air_drag") == pytest.approx(3 * alone, abs=0)
    worse = evidence_of({"hem": 11.0, "air_drag": 12.5})
    assert worse.p_value("air_drag") == 1.0


def test_an_error_that_may_be_noise_is_within_one_more_draw_of_it():
    """5 mm, known to 0.1: t of two degrees of freedom, 2.92, times sqrt(3) sqrt(4/3) of that: 5.584 mm."""
    found = flat_evidence({"hem": 6.0}, floor_error_mm=0.1)
    assert found.is_within_noise(level(found.base, 5.58))
    assert not found.is_within_noise(level(found.base, 5.59))
    assert found.gap_mm2 == pytest.approx(144 - 25)
    error = found.error_of(found.base)
    assert (error.value, error.interval) == (pytest.approx(12.0), pytest.approx((12.0, 12.0)))


def test_closure_has_an_interval_and_is_not_given_where_there_is_hardly_a_gap():
    """108 of 119 mm^2, the floor known exactly; of 25.2 beside 25 nothing."""
    found = flat_evidence({"hem": 6.0}, floor_error_mm=0.0)
    closed = found.closure_of(found.singles["hem"])
    assert closed.value == pytest.approx(108 / 119)
    assert closed.interval == pytest.approx((108 / 119, 108 / 119))
    still = flat_evidence({"hem": 5.0}, base=5.02)
    assert still.closure_of(still.singles["hem"]) is None
    assert flat_evidence({}).win_shares() == {}


def test_a_cause_leaves_three_fifths_of_the_gap_at_most_and_no_more_than_its_law_may():
    """Of 119 beyond the noise's 25: 71.4 and 1 of mesh; by law 25, twice that 1, and a share of the gap.

    Laws of lift differ by so much that the three fifths are less.
    """
    found = flat_evidence({"air_drag": 6.0, "hem": 6.0, "air_lift": 6.0}, numerics_mm=1.0, floor_error_mm=0.0)
    for name, one in found.singles.items():
        share = max((3 * KINDS[name].law_spread) ** 2, 0.05)
        by_law = 25.0 + 2.0 + share * 119.0
        assert float(found.most_by_law(one, np.array(119.0))) == pytest.approx(by_law)
        limit = np.sqrt(min(0.6 * 119 + 26, by_law))
        for over, is_enough in ((-0.01, True), (0.01, False)):
            assert found.explains_enough(level(one, limit + over)) == is_enough
    # Noise that is hardly known may be a fifth larger, and no more.
    loose = dataclasses.replace(found, floor_error_mm=1.0)
    assert float(loose.most_by_law(found.singles["hem"], np.array(0.0))) == pytest.approx(30.0 + 2.0)


def test_a_cause_leaves_half_of_the_gap_of_a_silhouette_at_most_whatever_its_law():
    """Half of 119 beyond the noise's 25 and 4 of mesh and solver; one take of markers, and three fifths count."""
    found = flat_evidence({"air_lift": 6.0}, numerics_mm=2.0, floor_error_mm=0.0)
    takes = [SimpleNamespace(camera=SimpleNamespace(is_placed=is_placed)) for is_placed in (True, True, False)]
    for recordings, share in ((takes[:2], 0.5), (takes, 0.6), ([], 0.6)):
        judged = dataclasses.replace(found, judge=SimpleNamespace(recordings=recordings))
        limit = np.sqrt(share * 119 + 25 + 4)
        for over, is_enough in ((-0.01, True), (0.01, False)):
            assert judged.explains_enough(level(found.singles["air_lift"], limit + over)) == is_enough


def test_draws_are_won_by_the_effect_that_leaves_least():
    """Of four draws of one half-second each the hem leaves less in three."""
    picks = Resampling(np.repeat(np.arange(4)[:, None], 12, 1), 1.0)
    found = flat_evidence({"hem": 6.0, "air_drag": 6.0}, resampling=picks)
    sums = found.singles["hem"].errors.sums.copy()
    sums[:3], sums[3] = 100.0, 900.0
    better = dataclasses.replace(found.singles["hem"].errors, sums=sums)
    singles = {**found.singles, "hem": dataclasses.replace(found.singles["hem"], errors=better)}
    found = dataclasses.replace(found, singles=singles)
    assert found.win_shares() == {"hem": 0.75, "air_drag": 0.25}
    base, drawn = found.draws
    assert base == pytest.approx(np.full(4, 144.0))
    assert drawn["hem"] == pytest.approx([10.0, 10.0, 10.0, 90.0])
    # Worth naming is what leaves least and closes a quarter of a gap of 119.
    assert found.worth_naming["hem"].tolist() == [True, True, True, False]
    assert found.worth_naming["air_drag"].tolist() == [False, False, False, True]


@pytest.mark.parametrize(("mm", "is_named"), [(10.6, True), (10.75, False)])
def test_an_effect_that_closes_less_than_a_quarter_of_the_gap_is_not_worth_naming(mm, is_named):
    """119 / 4 of 144 mm^2: 114.25 mm^2, 10.69 mm."""
    assert flat_evidence({"hem": mm}).worth_naming["hem"].all() == is_named


@pytest.mark.parametrize(("base", "is_named"), [(5.45, False), (5.5, True)])
def test_nothing_is_worth_naming_where_the_base_error_is_hardly_above_the_noise(base, is_named):
    """1.2 times 25 mm^2: 5.477 mm."""
    assert flat_evidence({"hem": 5.0}, base=base).worth_naming["hem"].all() == is_named


@pytest.mark.parametrize(("mesh", "is_coarse"), [(7.9, False), (8.1, True)])
def test_a_mesh_is_coarse_that_is_wrong_by_more_than_noise_and_solver_together(mesh, is_coarse):
    """5 mm of noise and 3 of the solver."""
    found = flat_evidence({"hem": 6.0}, mesh_mm=mesh, numerics_mm=float(np.hypot(mesh, 3.0)))
    assert found.is_coarse == is_coarse


@pytest.mark.parametrize(("closure", "passes"), [(0.24, False), (0.26, True)])
def test_an_effect_that_closes_less_than_a_quarter_of_the_gap_passes_no_test(closure, passes):
    """Of 119 mm^2 beyond the noise, in every half-second alike."""
    evidence = evidence_of({"air_drag": np.sqrt(144 - closure * 119)})
    assert evidence.p_value("air_drag") < 0.05
    assert passing_effects(evidence) == (["air_drag"] if passes else [])


@pytest.mark.parametrize(("wins", "verdict"), [(0.82, "effect"), (0.78, "ambiguous")])
def test_an_effect_that_wins_four_of_five_draws_has_no_rival(monkeypatch, wins, verdict):
    """The hem closes nearly as much, and wins the other draws."""
    evidence = evidence_of({"air_drag": 6.0, "hem": 6.2})
    monkeypatch.setattr(Evidence, "win_shares", lambda self: {"air_drag": wins, "hem": 1.0 - wins})
    assert decide(evidence).verdict == verdict

"""Terms of the verdict that only a particular take brings to bear, each on errors that allow hand calculation."""

from __future__ import annotations

import dataclasses
import re
from types import SimpleNamespace

import numpy as np
import pytest

from fit.gap.closure import BlockErrors, Resampling, gain_p_value
from fit.gap.edge_driven import sentence
from fit.gap.evidence import closes_enough, is_shown_by_edge
from fit.gap.passing import may_be_added, passing_effects
from fit.gap.probabilities import probabilities
from fit.gap.verdict import decide
from fit.gap.weighed import decide_by_mass
from tests.fit.gap.test_weighed import found_of
from tests.fit.gap.verdict_scene import COARSE, EFFECTS, KINDS, UNSETTLED, evidence_of, hypothesis, like, with_edge

OBSERVER = SimpleNamespace(**EFFECTS)


def blocks(one, *squares):
    """The same hypothesis whose mean squared errors [mm^2] alternate between half-seconds."""
    sums = np.resize(10.0 * np.array(squares), 12)
    return dataclasses.replace(one, errors=BlockErrors(sums, np.full(12, 10.0), np.zeros(3)))


def with_blocks(evidence, **squares):
    """Evidence of a base model that misses by 12 mm throughout, and of effects with alternating errors."""
    singles = {k: blocks(evidence.singles[k], *given) for k, given in squares.items()}
    return dataclasses.replace(evidence, base=blocks(evidence.base, 144.0), singles=singles)


@pytest.mark.parametrize(("sizes", "is_allowed"), [(1.0, True), (2.5, False)])
def test_an_effect_at_the_end_of_its_range_is_not_added(sizes, is_allowed):
    """Two and a half typical sizes of drag are all of its range."""
    pair = hypothesis(("hem", "air_drag"), 5.5, sizes=sizes)
    assert may_be_added(OBSERVER, pair, 0.001) == is_allowed


def test_two_effects_are_named_though_no_draw_finds_one_of_them_worth_naming():
    """Drag passes alone and the hem is needed beside it; noise, mesh and solver together may hide the gap."""
    evidence = evidence_of({"air_drag": 6.9}, base=8.0, joint=[(("air_drag", "hem"), 5.0)])
    evidence = dataclasses.replace(evidence, numerics_mm=5.5)
    assert passing_effects(evidence) == ["air_drag"]
    assert not evidence.exceeds(25.0 + 5.5**2)
    evidence.__dict__["worth_naming"] = {"air_drag": np.zeros(400, bool)}
    assert decide(evidence).named == ["air_drag", "hem"]


@pytest.mark.parametrize("failed", [(UNSETTLED, COARSE), (COARSE, UNSETTLED)])
def test_of_two_failed_gates_the_one_that_forbids_a_diagnosis_is_told(failed):
    """A coarse mesh alone would still allow a verdict."""
    found = decide(evidence_of({"air_drag": 5.5}, gate_list=failed))
    assert found.verdict == "inconclusive"
    assert found.sentence.startswith("No diagnosis: apart ")


def test_an_effect_that_closes_four_fifths_as_much_and_often_leaves_less_is_a_rival():
    """The hem leaves 57 mm^2 where the drag leaves 42, 0.85 of its closure; every second half-second it is better."""
    evidence = with_blocks(evidence_of({"air_drag": 6.5, "hem": 7.6}), air_drag=(84.0, 0.5), hem=(0.5, 114.5))
    shares = evidence.win_shares()
    assert 0.5 < shares["air_drag"] < 0.8
    assert evidence.closure_of(evidence.singles["hem"]).value == pytest.approx(0.85 * 101.75 / 119, abs=0.001)
    found = decide(evidence)
    assert (found.verdict, found.named) == ("ambiguous", ["air_drag", "hem"])
    # Each is as probable as draws in which it leaves no more than a cause may; the best in a draw may leave more.
    likely = probabilities(evidence, None)
    assert all(abs(likely[name] - shares[name]) > 0.03 for name in found.named)
    said = [f"(probability {100 * likely[name]:.0f} %)" for name in found.named]
    assert re.findall(r"\(probability \d+ %\)", found.sentence) == said


@pytest.mark.parametrize(("cosine", "left", "verdict"), [
    (0.95, 31.4, "ambiguous"),  # 5.6 mm: nearly all of the drag's closure
    (0.95, 42.3, "effect"),  # 6.5 mm: 0.89 of it
    (0.85, 31.4, "effect"),
])  # fmt: skip
def test_a_collinear_effect_that_closes_nine_tenths_as_much_is_a_rival_though_it_wins_no_draw(cosine, left, verdict):
    evidence = with_blocks(evidence_of({"air_drag": 5.5, "hem": 5.6}), air_drag=(30.25,), hem=(left,))
    evidence = dataclasses.replace(evidence, screened=like(air_drag=1.0, hem=cosine))
    assert evidence.win_shares() == {"air_drag": 1.0, "hem": 0.0}
    assert decide(evidence).verdict == verdict


def test_an_effect_is_significant_among_all_that_were_refitted():
    """One in 30 alone is one in 15 of two; errors alternate, so that Student's t over 12 half-seconds is 2."""
    evidence = with_blocks(evidence_of({"air_drag": 10.0}), air_drag=(144 - 40 * 2.7, 144 + 40 * 0.7))
    own = gain_p_value(evidence.base.errors, evidence.singles["air_drag"].errors, evidence.floor_mm)
    assert 0.025 < own < 0.05
    assert passing_effects(evidence) == ["air_drag"]
    two = with_blocks(evidence_of({"air_drag": 10.0, "hem": 12.0}), air_drag=(144 - 40 * 2.7, 144 + 40 * 0.7),
                      hem=(144.0,))  # fmt: skip
    assert two.p_value("air_drag") == pytest.approx(2 * own)
    assert passing_effects(two) == []


@pytest.mark.parametrize("by", ["rules", "evidence"])
def test_a_size_is_certain_by_the_librarys_own_law_whatever_other_laws_say(by):
    """Noise leaves 0.8 of the lift, and laws that differ by 0.4 another 0.66: together more than all of it."""
    evidence = evidence_of({"time_offset": 8.0, "air_lift": 5.4})
    pair = hypothesis(("time_offset", "air_lift"), 5.4, deviation=0.8 / 1.645)
    alone = hypothesis(("air_lift",), 5.4, deviation=0.8 / 1.645)
    assert evidence.amplitude("air_lift", beside=pair)[1][0] < 0.0 < evidence.amplitude(
        "air_lift", beside=pair, any_law=False)[1][0]  # fmt: skip
    if by == "rules":
        singles = {"time_offset": evidence.singles["time_offset"]}
        found = decide(dataclasses.replace(evidence, singles=singles, joint=[(pair, 0.001)]))
        assert found.named == ["time_offset", "air_lift"]
    else:
        evidence = dataclasses.replace(evidence, singles={"air_lift": alone})
        found = decide_by_mass(evidence, found_of({(): (0.05, 0.0), ("air_lift",): (0.95, 0.0)}))
        assert found.named == ["air_lift"]


def test_a_third_effect_must_be_needed_beside_two_and_not_beside_one():
    """It closes 0.05 mm of what two leave, and most of what one leaves."""
    joint = [(("time_offset", "hem"), 5.5), (("time_offset", "hem", "air_drag"), 5.45)]
    assert decide(evidence_of({"time_offset": 9.0}, joint=joint)).named == ["time_offset", "hem"]


def test_the_mass_decides_between_no_effect_an_unknown_cause_and_an_effect():
    evidence = evidence_of({"air_drag": 5.5, "hem": 5.6})
    unknown = found_of({(): (0.3, 0.1), ("air_drag",): (0.2, 0.4)})
    assert decide_by_mass(evidence, unknown).verdict == "unknown"
    # The hem has more mass in all, most of it with an unknown cause beside it.
    of_drag = found_of({(): (0.05, 0.0), ("air_drag",): (0.4, 0.0), ("hem",): (0.25, 0.3)})
    assert decide_by_mass(evidence, of_drag).named[0] == "air_drag"


def test_an_unknown_cause_names_no_likeliest_effect():
    """Six tenths of the mass hold an unknown cause; the drag's size may be nothing."""
    shares = found_of({(): (0.0, 0.5), ("air_drag",): (0.4, 0.1)})
    found = decide_by_mass(evidence_of({"air_drag": 5.5}, sizes=0.01), shares)
    assert found.verdict == "unknown"
    assert "likeliest" not in found.sentence


def test_an_effect_that_closes_a_fifth_on_other_motion_is_no_cause_however_wide_its_interval():
    evidence = with_blocks(evidence_of({"air_drag": 10.0}), air_drag=(144 - 24 * 2.5, 144 + 24 * 0.5))
    closed = evidence.closure_of(evidence.singles["air_drag"])
    assert closed.value == pytest.approx(24 / 119)
    assert closed.interval[1] > 0.25
    found = decide_by_mass(evidence, found_of({(): (0.1, 0.0), ("air_drag",): (0.9, 0.0)}))
    assert found.verdict == "unknown"
    assert "on the held-out motion 20 % of the gap closes" in found.sentence


def test_a_gap_that_may_not_close_at_the_tracked_edge_does_not_lie_there():
    """A fifth closes on average; what one half-second closes, the next one opens."""
    evidence = evidence_of({})
    held = blocks(hypothesis((), 10.0), 144 - 24 * 4.0, 144 + 24 * 2.0)
    evidence = dataclasses.replace(evidence, base=blocks(evidence.base, 144.0))
    low, high = evidence.closure_of(held).interval
    assert low < 0.0 < high
    assert sentence(evidence, held).endswith("the gap does not lie between hanger and edge.")
    sure = blocks(held, 120.0)
    assert "20 % of the gap [20 to 21 %] lies between hanger and edge." in sentence(evidence, sure)


def test_hope_is_for_the_usual_half_second_too():
    """A third of what most half-seconds leave is closed; twice as much would be most of it."""
    before = dataclasses.replace(hypothesis(("air_drag",), 1.0), errors=BlockErrors(
        np.array([100.0] * 11 + [10000.0]), np.full(12, 10.0), np.zeros(3)))  # fmt: skip
    after = dataclasses.replace(before, errors=BlockErrors(
        np.array([65.0] * 11 + [10000.0]), np.full(12, 10.0), np.zeros(3)))  # fmt: skip
    gap = before.errors.squared_mm
    assert not closes_enough(OBSERVER, gap, before, after, 0.0)
    assert closes_enough(OBSERVER, gap, before, after, 0.0, hope=2.0)


def test_the_edge_must_show_more_than_laws_of_the_earlier_effects_leave():
    """150 of 4850 squares beyond noise: a depth scale's law may leave 279 of them, a time offset's none."""
    base = with_edge(hypothesis((), 12.0), 6000)
    exact, other = (with_edge(hypothesis((k,), 9.0), 1300) for k in ("time_offset", "depth_scale"))
    found = with_edge(hypothesis(("time_offset", "depth_scale"), 8.0), 1150)
    assert is_shown_by_edge(OBSERVER, base, exact, found)
    assert not is_shown_by_edge(OBSERVER, base, other, found)


def test_draws_hold_an_error_of_mesh_and_solver_along_each_models_own_residual():
    """2 N / 3 |r| for N of 3 mm, and mean squares of one number: 6 times the residual's rms, none without residual."""
    evidence = evidence_of({"air_drag": 9.0, "hem": 8.0})
    residuals = {"": [2.0, -2.0, 2.0], "air_drag": [1.0, 1.0, -1.0], "hem": [0.0, 0.0, 0.0]}

    def level(one, name):
        return dataclasses.replace(one, errors=BlockErrors(np.full(12, 1000.0), np.full(12, 10.0),
                                                          np.array(residuals[name])))  # fmt: skip

    evidence = dataclasses.replace(
        evidence, base=level(evidence.base, ""), singles={k: level(h, k) for k, h in evidence.singles.items()},
        numerics_mm=3.0, resampling=Resampling(np.zeros((4000, 12), int), 1.0),
    )  # fmt: skip
    base, drawn = evidence.draws
    spread = {"": base.std(), **{k: d.std() for k, d in drawn.items()}}
    for name, residual in residuals.items():
        own = np.sqrt(np.square(residual).sum() / (len(residual) / 3))
        assert spread[name] == pytest.approx(2 * 3.0 / 3.0 * own, rel=0.05), name
    between = float(np.dot(residuals[""], residuals["air_drag"])) / (np.sqrt(12.0) * np.sqrt(3.0))
    assert np.corrcoef(base, drawn["air_drag"])[0, 1] == pytest.approx(between, abs=0.05)


@pytest.mark.parametrize(("sizes", "is_contradicted"), [(1.0, True), (5.0, False)])
def test_an_effect_at_its_bound_contradicts_no_other_by_its_edge(sizes, is_contradicted):
    """The offset's edge is nearer by 150 squares and it closes as much; five typical sizes are all of its range."""
    evidence = evidence_of({"depth_scale": 6.0})
    offset = with_edge(hypothesis(("time_offset",), 6.0, sizes=sizes), 1150)
    evidence = dataclasses.replace(evidence, base=with_edge(evidence.base, 1300), singles={
        "depth_scale": with_edge(evidence.singles["depth_scale"], 1300), "time_offset": offset})  # fmt: skip
    assert ("depth_scale" in evidence.contradicted) == is_contradicted


def test_of_two_effects_that_explain_the_edge_the_nearer_one_is_identified():
    """The offset's edge is nearer by 90 squares; the scale closes more of the cloth's gap."""
    evidence = evidence_of({"time_offset": 9.0, "depth_scale": 6.0})
    edges = {"time_offset": 1100, "depth_scale": 1190}
    singles = {k: with_edge(h, edges[k]) for k, h in evidence.singles.items()}
    evidence = dataclasses.replace(evidence, base=with_edge(evidence.base, 2150), singles=singles)
    assert evidence.contradicted == frozenset()
    assert evidence.identified_by_edge == {"time_offset"}


@pytest.mark.parametrize(("name", "is_told"), [("eroded_outline", True), ("time_offset", False)])
def test_an_effect_explains_the_edge_within_the_spread_of_its_laws(name, is_told):
    """150 squares beyond noise are 2.5 certain errors: more than one, less than the 6 that erosion's laws may leave."""
    evidence = evidence_of({name: 8.0})
    singles = {name: with_edge(evidence.singles[name], 1300)}
    evidence = dataclasses.replace(evidence, base=with_edge(evidence.base, 2150), singles=singles)
    assert KINDS["eroded_outline"].law_spread == 0.2
    assert (evidence.identified_by_edge == {name}) == is_told

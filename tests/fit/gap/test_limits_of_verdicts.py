"""Verdicts and their words exactly at their limits, and with one effect more than usual, worked by hand."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from fit.gap.closure import BlockErrors, Resampling
from fit.gap.evidence import NEAR, NEAR_TWIN, RIVAL, Evidence
from fit.gap.findings import describe_effects
from fit.gap.gates import convergence_gate
from fit.gap.hypotheses import TWIN_COSINE, shortlist
from fit.gap.posterior import REFITTED_WITHIN, Found, _wanted
from fit.gap.power import imitated
from fit.gap.probabilities import probabilities
from fit.gap.screening import GROUP_COSINE, cosine, groups
from fit.gap.verdict import CLEAR_WIN, decide
from fit.gap.weighed import decide_by_mass
from fit.methods import SI
from formats.diagnosis_records import Gate
from tests.fit.gap.test_evidence import flat_evidence
from tests.fit.gap.test_findings import costing
from tests.fit.gap.test_posterior_by_hand import FAR, mass_of, search_of
from tests.fit.gap.test_probabilities import HALVES, with_halves
from tests.fit.gap.test_weighed import found_of
from tests.fit.gap.verdict_scene import COARSE, KINDS, evidence_of, hypothesis, like, signature, with_edge


def closing(percent):
    """A finer mesh that closes so much of the gap."""
    return Gate(name="mesh and step", passed=False, figure=percent, limit=40.0, unit="%", sentence="coarse")


def test_a_limit_that_grew_is_said_with_its_own_number():
    """A best effect that costs a third as much: the root of 3.24, 80 %."""
    fits = [SimpleNamespace(cost=cost) for cost in (10.0, 11.0)]
    gate = convergence_gate(fits, 10.0 / 3.24)
    assert gate.limit == pytest.approx(80.0)
    assert "At most 80 % above is allowed" in gate.sentence


def test_where_no_effect_passes_the_finer_mesh_comes_first():
    assert decide(evidence_of({}, gate_list=[COARSE])).verdict == "numerics"


def test_a_finer_mesh_that_closes_exactly_as_much_as_the_effect_comes_first():
    evidence = evidence_of({"air_drag": 6.0})
    closed = evidence.closure_of(evidence.singles["air_drag"]).value
    shares = found_of({(): (0.1, 0.0), ("air_drag",): (0.9, 0.0)})
    for figure, verdict in ((100 * closed, "numerics"), (np.nextafter(100 * closed, 0.0), "effect")):
        coarse = dataclasses.replace(evidence, gates=[*evidence.gates, closing(float(figure))])
        assert decide(coarse).verdict == verdict
        assert decide_by_mass(coarse, shares).verdict == verdict


def test_an_effect_that_wins_exactly_four_of_five_draws_has_no_rival(monkeypatch):
    """The hem closes nearly as much, and wins the other draws; of 400 draws 320 are four of five."""
    evidence = evidence_of({"air_drag": 6.0, "hem": 6.2})
    assert CLEAR_WIN == 320 / 400
    monkeypatch.setattr(Evidence, "win_shares", lambda self: {"air_drag": 320 / 400, "hem": 80 / 400})
    assert decide(evidence).verdict == "effect"


def test_an_effect_that_is_worth_naming_in_exactly_half_of_the_draws_is_named():
    evidence = evidence_of({"air_drag": 6.0})
    evidence.__dict__["worth_naming"] = {"air_drag": np.arange(400) < 200}
    assert decide(evidence).verdict == "effect"


def test_a_sentence_on_rivals_begins_with_the_first_one_in_capitals():
    said = decide(evidence_of({"air_drag": 6.0, "hem": 6.02})).sentence
    assert said.startswith("Air drag (probability ")
    found = {(): (0.01, 0.0), ("hem",): (0.6, 0.0), ("air_drag",): (0.39, 0.0)}
    assert decide_by_mass(evidence_of({"air_drag": 6.0, "hem": 6.02}), found_of(found)).sentence.startswith("A heavier")


def test_of_three_effects_the_middle_ones_size_beside_both_does_not_matter():
    """The middle one was judged when it was added to the first."""
    evidence = evidence_of(
        {"air_drag": 9.5}, joint=[(("air_drag", "hem"), 7.5), (("air_drag", "hem", "time_offset"), 5.2)]
    )
    pair, (three, p_value) = evidence.joint
    fitted = dataclasses.replace(three.fitted, deviation=np.array([*[0.05] * 6, 0.7, 0.05]))
    evidence = dataclasses.replace(evidence, joint=[pair, (dataclasses.replace(three, fitted=fitted), p_value)])
    assert decide(evidence).named == ["air_drag", "hem", "time_offset"]


@pytest.mark.parametrize(("squares", "said"), [
    (1050, "but the evidence is too weak to name it: another effect puts the edge nearer."),
    (1500, "which this effect alone does not explain."),
])  # fmt: skip
def test_an_unnamed_effect_explains_the_held_edge_or_leaves_it_off(squares, said):
    evidence = evidence_of({"clip_slack": 11.9})
    evidence = dataclasses.replace(
        evidence, base=with_edge(evidence.base, 3000),
        singles={"clip_slack": with_edge(evidence.singles["clip_slack"], squares)},
    )  # fmt: skip
    evidence.__dict__["identified_by_edge"] = frozenset()
    evidence.__dict__["contradicted"] = frozenset()
    assert decide(evidence).sentence.endswith(said)


def test_of_three_effects_named_together_each_has_its_size_beside_both_others(monkeypatch):
    monkeypatch.setattr(
        "fit.gap.findings.smallest_detectable", lambda evidence: {k: np.array([0.3]) for k in evidence.screened}
    )
    evidence = evidence_of({"air_drag": 9.0}, joint=[(("air_drag", "hem", "time_offset"), 5.2)])
    evidence = dataclasses.replace(evidence, base=costing(evidence.base, 100.0))
    effects = tuple(KINDS[name] for name in evidence.screened)
    found = {one.id: one.note for one in describe_effects(evidence, evidence.joint[0][0], effects, SI, weighed={})}
    both = f"{KINDS['hem'].title} and {KINDS['time_offset'].title}"
    assert f"size beside {both}; closure alone" in found["air_drag"]


@pytest.mark.parametrize(("left", "verdict"), [(5.2, "none"), (5.7, "unknown")])
def test_a_held_edge_that_is_off_makes_no_gap_where_noise_and_mesh_may_leave_the_error(left, verdict):
    """25 mm^2 of noise and 1 of the mesh, a fifth more: 31.2 mm^2. An error of 5.2 mm is 27 mm^2, of 5.7 mm 32.5."""
    evidence = flat_evidence({}, base=left, numerics_mm=1.0)
    off = dataclasses.replace(evidence, base=with_edge(evidence.base, 9000))
    assert decide_by_mass(off, found_of({(): (0.9, 0.02), ("air_drag",): (0.08, 0.0)})).verdict == verdict


def test_mesh_and_solver_are_said_to_hide_a_gap_only_where_there_is_one_beyond_noise():
    """An error of 4 mm is below the noise of 5, whose square is 25 and not 10."""
    shares = found_of({(): (0.9, 0.02), ("air_drag",): (0.08, 0.0)})
    assert "may be wrong" not in decide_by_mass(flat_evidence({}, base=4.0, numerics_mm=1.0), shares).sentence
    assert "may be wrong" in decide_by_mass(flat_evidence({}, base=5.7, numerics_mm=5.0), shares).sentence


def test_gates_that_passed_are_not_said_to_have_failed_by_masses():
    """The only gate that may stop a verdict by masses here is that of the mesh, and it passed."""
    fine = Gate(name="mesh and step", passed=True, figure=99.0, limit=40.0, unit="%", sentence="fine")
    evidence = evidence_of({"air_drag": 6.0}, gate_list=[fine])
    assert decide_by_mass(evidence, found_of({(): (0.1, 0.0), ("air_drag",): (0.9, 0.0)})).verdict == "effect"


def test_a_set_exactly_at_the_reach_of_refits_is_not_refitted():
    at, within = -REFITTED_WITHIN, np.nextafter(-REFITTED_WITHIN, 0.0)
    assert _wanted(Found({(): None}, mass_of(none=(0, -np.inf, 0), a=(at, -np.inf, 0))), 0) == []
    assert _wanted(Found({(): None}, mass_of(none=(0, -np.inf, 0), a=(within, FAR, 0))), 0) == [("a",)]


def test_effects_whose_cosine_is_exactly_that_of_twins_are_no_twins():
    found = like(first=1.0, second=TWIN_COSINE)
    found["second"] = dataclasses.replace(found["second"], predicted=1e-3, predicted_mm2=0.0)
    found["first"] = dataclasses.replace(found["first"], contribution=np.array([1.0, 0.0]))
    found["second"] = dataclasses.replace(found["second"], contribution=np.array([0.9, np.sqrt(1 - 0.9**2)]))
    length = float(np.linalg.norm(found["second"].contribution))
    assert 0.9 / length == TWIN_COSINE
    assert shortlist(found) == ["first"]


def test_an_effect_is_imitated_only_where_less_than_the_needed_error_is_its_own(monkeypatch):
    """Enough is 4 mm^2: 2 mm of motion of which 2 mm are its own, or a little less."""
    monkeypatch.setattr("fit.gap.power.needed_mm2", lambda evidence, name: 4.0)
    evidence = evidence_of({"air_drag": 6.0})
    evidence.observer.in_mm = lambda row: float(np.abs(row).max())
    size = {"air_drag": np.array([2.0 * KINDS["air_drag"].typical])}
    for own, names in ((2.0, []), (1.99, ["air_drag"])):
        evidence.screened["air_drag"] = signature(raw=np.full((1, 3), 2.0), projected=np.full((1, 3), own))
        assert list(imitated(evidence, size)) == names


def test_effects_are_together_only_in_the_draws_in_which_they_leave_little():
    """Drag and hem leave nothing in half of the draws and 100 of 119 mm^2 in the others; alone both leave 96."""
    evidence = flat_evidence({"air_drag": 11.0, "hem": 11.0}, resampling=HALVES, floor_error_mm=0.0)
    both = with_halves(hypothesis(("hem", "air_drag"), 5.0), 5.0, 11.2)
    assert probabilities(evidence, both) == pytest.approx({"hem": 0.8, "air_drag": 0.8})


def test_effects_leave_no_more_than_their_laws_leave_of_the_gap_beyond_noise():
    """An offset's law leaves a twentieth of 119 mm^2, 6, beside 25 of noise; of 169 mm^2 it would leave 8.5."""
    evidence = flat_evidence({"time_offset": 11.0, "hem": 11.0}, floor_error_mm=0.0)
    for left, is_named in ((30.5, True), (32.5, False)):
        both = with_halves(hypothesis(("time_offset", "clock_drift"), 5.0), left**0.5, left**0.5)
        assert (probabilities(evidence, both)["clock_drift"] > 0.5) == is_named


def test_of_two_effects_that_the_held_edge_identifies_the_nearer_one_is_present_in_each_draw():
    """Slack leaves less in one half of the draws, an offset in the other: 4 x 0.5 / (1 + 3 x 1) each."""
    resampling = Resampling(HALVES.picks, 1.0)
    evidence = flat_evidence({"clip_slack": 11.9, "time_offset": 11.9}, resampling=resampling, floor_error_mm=0.0)
    singles = {
        "clip_slack": with_halves(evidence.singles["clip_slack"], 11.8, 11.9),
        "time_offset": with_halves(evidence.singles["time_offset"], 11.9, 11.8),
    }
    evidence = dataclasses.replace(evidence, singles=singles)
    evidence.__dict__["identified_by_edge"] = frozenset(singles)
    assert probabilities(evidence, None) == pytest.approx({"clip_slack": 0.5, "time_offset": 0.5})


def flat(names, mm2):
    """A hypothesis with exactly this mean squared error in every half-second."""
    errors = BlockErrors(np.full(12, 10.0 * mm2), np.full(12, 10.0), np.zeros(3))
    return dataclasses.replace(hypothesis(names, 5.0), errors=errors)


def twins_of(other_mm2, *, better=None):
    """The twins of a lag beside drag, which alone leaves 100 mm^2 and with the lag 50, and their share of draws."""
    several, other = flat(("air_drag", "filter_lag"), 50.0), flat(("air_drag", "time_offset"), other_mm2)
    picks = np.repeat(np.arange(10)[:, None], 12, axis=1)
    if better is not None:
        sums = other.errors.sums.copy()
        sums[:better], sums[better : 2 * better] = 400.0, 2 * sums[0] - 400.0
        other = dataclasses.replace(other, errors=dataclasses.replace(other.errors, sums=sums))
    evidence = dataclasses.replace(
        evidence_of({}), singles={"air_drag": flat(("air_drag",), 100.0)}, instead=[other],
        resampling=Resampling(picks, 1.0),
    )  # fmt: skip
    return evidence.alternatives(several)


@pytest.mark.parametrize(("left", "is_twin"), [(55.0, True), (55.1, False)])
def test_a_twin_that_closes_exactly_nine_tenths_is_one(left, is_twin):
    """45 of the 50 mm^2 that the effect closes."""
    assert NEAR_TWIN * 50.0 == 45.0
    assert bool(twins_of(left)) == is_twin


@pytest.mark.parametrize(("left", "better", "is_twin"), [(60.0, 1, True), (60.1, 1, False), (60.0, 0, False)])
def test_a_twin_that_closes_exactly_four_fifths_is_one_where_a_tenth_of_the_draws_say_so(left, better, is_twin):
    """Of ten draws of one half-second each, it leaves 40 mm^2 in one, and in the others more than the effect's 50."""
    assert (NEAR * 50.0, RIVAL) == (40.0, 0.1)
    assert bool(twins_of(left, better=better)) == is_twin


def test_a_twin_that_leaves_as_much_in_every_draw_is_better_in_none(monkeypatch):
    """It closes four fifths and a little more, by errors that the draws do not hold."""
    several = flat(("air_drag", "filter_lag"), 50.0)
    other = dataclasses.replace(several, effects=("air_drag", "time_offset"))
    sums = np.append(several.errors.sums[:11], 700.0)
    other = dataclasses.replace(other, errors=dataclasses.replace(other.errors, sums=sums))
    evidence = dataclasses.replace(
        evidence_of({}), singles={"air_drag": flat(("air_drag",), 60.0)}, instead=[other],
        resampling=Resampling(np.zeros((10, 12), int), 1.0),
    )  # fmt: skip
    assert NEAR_TWIN * 10.0 > 60.0 - other.errors.squared_mm > NEAR * 10.0
    assert evidence.alternatives(several) == {}


@pytest.mark.parametrize(("squared", "is_worth_it"), [(30.0, False), (30.001, True)])
def test_a_gap_of_exactly_a_fifth_more_than_the_noise_is_none(squared, is_worth_it):
    """1.2 times 25 mm^2."""
    evidence = flat_evidence({"air_drag": 5.0})
    (worth,) = evidence.are_worth_naming(np.array([squared]), {"air_drag": np.array([25.0])}).values()
    assert worth.tolist() == [is_worth_it]


def test_effects_whose_cosine_is_exactly_that_of_a_group_are_no_group():
    one, other = signature((1.0, 0.0)), signature((0.9, np.sqrt(1 - 0.9**2)))
    assert cosine(one, other) == GROUP_COSINE == 0.9
    screened = {"hem": one, "air_drag": other}
    assert groups(screened)["hem"] != groups(screened)["air_drag"]
    assert not dataclasses.replace(evidence_of({}), screened=screened).alike("hem", "air_drag")


@pytest.mark.parametrize(("kept", "is_refuted"), [(1.0, False), (np.nextafter(1.0, 0.0), True)])
def test_a_refit_that_keeps_exactly_a_quarter_of_its_promise_is_not_refuted(kept, is_refuted):
    promising = SimpleNamespace(sizes=lambda subset: {"a": 4.0})
    fitted = SimpleNamespace(cost=50.0, active=("a",), amplitudes=np.array([kept, 0.0, 0.0]))
    assert search_of()._refutes(promising, fitted) == is_refuted

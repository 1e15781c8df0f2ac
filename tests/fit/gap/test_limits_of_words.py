"""What a diagnosis says and keeps at its limits: words, numbers and names, each from made-up figures."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import j0, jn_zeros

from fit.gap import first_round
from fit.gap.closure import BlockErrors
from fit.gap.correlation import effective_count
from fit.gap.detectable import MESH_SHARE
from fit.gap.edge_words import describe_held_edge, still_off
from fit.gap.evidence import RIVAL, Evidence, share_in_median_block
from fit.gap.findings import alike_ends, describe_effects
from fit.gap.fitting import by_jackknife, from_prior
from fit.gap.gates import CONVERGED
from fit.gap.hypotheses import _starts_of_refit, further
from fit.gap.likelihood import shapes_of
from fit.gap.next_experiment import _inflation
from fit.gap.passing import FAMILY_WISE_LEVEL, effects_identified_by_edge, may_be_added, what_lacks
from fit.gap.posterior import Linear
from fit.gap.power import Power
from fit.gap.probabilities import probabilities
from fit.gap.rounds import Rounds
from fit.gap.screening import screen
from fit.gap.verdict import _likely_all_the_same, decide
from fit.gap.weighed import decide_by_mass, known_error_mm, limited
from fit.gap.where import _phases
from fit.methods import SI
from fit.search.intervals import jackknife
from tests.fit.gap.linear_scene import LinearObserver
from tests.fit.gap.named_fits import Named
from tests.fit.gap.test_evidence import flat_evidence
from tests.fit.gap.test_hypotheses import NUMBERS
from tests.fit.gap.test_rounds import a_search
from tests.fit.gap.test_weighed import found_of
from tests.fit.gap.verdict_scene import KINDS, evidence_of, hypothesis, signature, with_edge


def test_an_effect_that_removes_exactly_what_the_mesh_may_make_removes_no_more():
    """Half of 4^2 mm^2, of 144."""
    evidence = flat_evidence({"air_drag": 6.0}, numerics_mm=4.0)
    drag = evidence.singles["air_drag"]
    for left, is_too_little in ((136.0, True), (135.9, False)):
        errors = BlockErrors(np.full(12, 10.0 * left), np.full(12, 10.0), np.zeros(3))
        some = dataclasses.replace(evidence, singles={"air_drag": dataclasses.replace(drag, errors=errors)})
        assert MESH_SHARE * 16.0 == 144.0 - 136.0
        lacking = " ".join(what_lacks(some, "air_drag"))
        assert ("removes no more error than mesh and solver may make" in lacking) == is_too_little


@pytest.mark.parametrize(
    ("p_value", "said"),
    [(0.3, "p is 0.30 where less than 0.05 is needed"), (FAMILY_WISE_LEVEL, "p is 0.05 where less than 0.05"),
     (np.nextafter(FAMILY_WISE_LEVEL, 0.0), "")],
)  # fmt: skip
def test_a_p_value_is_said_with_as_many_decimals_as_its_level_and_is_below_it(p_value, said, monkeypatch):
    monkeypatch.setattr(Evidence, "p_value", lambda self, effect: p_value)
    lacking = [one for one in what_lacks(evidence_of({"air_drag": 6.0}), "air_drag") if one.startswith("p is")]
    assert len(lacking) == bool(said)
    assert all(one.startswith(said) for one in lacking)


def test_an_effect_that_was_screened_alone_and_could_not_show_is_said_to_be_beyond_these_takes(monkeypatch):
    monkeypatch.setattr(
        "fit.gap.findings.smallest_detectable", lambda evidence: {k: np.array([1e6]) for k in evidence.screened}
    )
    evidence = dataclasses.replace(evidence_of({"air_drag": 6.0}), singles={})
    (drag,) = describe_effects(evidence, None, (KINDS["air_drag"],), SI, weighed={})
    assert drag.note.startswith("these takes could not have shown the effect: only from")


def test_refits_are_kept_by_the_names_of_their_effects(monkeypatch):
    names, kept = [], Named()
    monkeypatch.setattr(kept, "recall", lambda wanted, go: names.extend(wanted) or [])
    monkeypatch.setattr(first_round, "judged", lambda judge, fits: [])
    search = SimpleNamespace(observer=None, judge=None, kept=kept)
    start = SimpleNamespace(active=("air_drag",))
    Rounds._refit(search, start, {}, ["hem"])
    Rounds._refit(search, start, {}, ["hem"], "-again")
    assert names == ["air_drag+hem", "air_drag+hem-again"]


def test_deviations_by_the_jackknife_hold_the_priors_own_as_its_square():
    """A parameter that the data determine about as well as its prior."""
    rng = np.random.default_rng(0)
    jacobian, residual, block = rng.normal(size=(40, 1)), rng.normal(size=40), np.repeat(np.arange(8), 5)
    prior = np.array([0.15])
    own = from_prior(jacobian, prior)
    whole = np.diag(jackknife(residual, jacobian, block, np.diag(prior**-2))[0])
    assert (whole > own**2).all()
    found = by_jackknife(jacobian, residual, block, prior)
    # Student's 90 % of seven degrees of freedom, 1.895, over 1.645.
    assert found == pytest.approx(np.hypot(1.895 / 1.645 * np.sqrt(whole - own**2), own), rel=1e-3)


def test_of_unnamed_effects_the_one_that_puts_the_held_edge_nearest_is_told():
    evidence = evidence_of({"clip_slack": 11.9, "time_offset": 11.9})
    singles = {
        k: with_edge(evidence.singles[k], squares) for k, squares in (("clip_slack", 1500), ("time_offset", 1100))
    }
    evidence = dataclasses.replace(evidence, base=with_edge(evidence.base, 3000), singles=singles)
    assert f"With {KINDS['time_offset'].title} it is" in describe_held_edge(evidence)


def test_error_of_the_held_edge_that_a_law_may_leave_is_not_said_to_stay():
    """Of 9000 squared deviations 7850 show; a depth scale's law leaves 0.24^2 of them, 452, and an offset's none."""
    base = with_edge(hypothesis((), 12.0), 9000)
    evidence = dataclasses.replace(evidence_of({}), base=base)
    for name, is_said in (("depth_scale", False), ("time_offset", True)):
        assert bool(still_off(evidence, with_edge(hypothesis((name,), 6.0), 1500))) == is_said


def test_a_verdict_of_none_shows_no_gap():
    assert decide(evidence_of({"air_drag": 5.0}, base=5.3)).verdict == "none"
    assert not decide(evidence_of({"air_drag": 5.0}, base=5.3)).shows_gap
    assert decide(evidence_of({"air_drag": 6.0})).shows_gap


@pytest.mark.parametrize(("share", "begun"), [(0.1, 0.3), (0.1001, 0.1001)])
def test_a_guess_of_exactly_a_tenth_of_a_typical_size_begins_at_three_tenths(share, begun):
    row = np.linalg.qr(np.random.default_rng(0).normal(size=(NUMBERS, 1)))[0].T[0]
    hem = KINDS["hem"]
    observer = LinearObserver(-50.0 * row, np.zeros((NUMBERS, len(SI.initial))), {"hem": 50.0 * row / hem.typical})
    found = screen(observer, observer.fitted(), ("hem",))["hem"]
    found = dataclasses.replace(found, amplitude=np.array([share * hem.typical]))
    problem, starts, _ = _starts_of_refit(observer, observer.fitted(), found, "hem")
    _, amplitudes = problem.unpack(np.array(starts))
    assert amplitudes[2, observer.columns["hem"]] == pytest.approx(begun * hem.typical)


def test_an_unknown_cause_that_is_as_likely_as_a_named_one_comes_first():
    """A half each, of sizes that may be nothing."""
    evidence = evidence_of({"air_drag": 5.5}, sizes=0.01)
    for unknown, named, said in ((0.5, 0.5, "that no effect in the library explains"), (0.4, 0.6, "The likeliest is")):
        shares = {(): (0.0, 0.0), ("air_drag",): (named, unknown)}
        found = SimpleNamespace(fits=dict.fromkeys(shares), shares=lambda shares=shares: shares)
        assert said in decide_by_mass(evidence, found).sentence


def test_the_median_half_second_of_a_quiet_take_is_that_of_a_loud_one():
    """Errors and noise a hundredth as large: a third of what is left either way."""
    counts = np.array([2.0, 1.0, 1.0])
    before, after = np.array([36.0, 18.0, 1009.0]), np.array([18.0, 15.0, 1009.0])
    for scale in (1.0, 1e-4):
        one, other = (BlockErrors(scale * sums, counts, np.zeros(3)) for sums in (before, after))
        assert share_in_median_block(one, other, 3.0 * scale**0.5) == pytest.approx(1 / 3)
    quiet = BlockErrors(np.full(3, 9.1e-4), np.ones(3), np.zeros(3))
    closed = BlockErrors(np.full(3, 9.0e-4), np.ones(3), np.zeros(3))
    assert share_in_median_block(quiet, closed, 0.03) == pytest.approx(0.1 / 0.9)


def test_takes_that_could_not_show_a_gap_show_none(monkeypatch):
    monkeypatch.setattr("fit.gap.verdict.power_of", lambda evidence: Power("noise hides", ["a hem"]))
    found = decide(evidence_of({"air_drag": 5.0}, base=5.3))
    assert (found.verdict, found.shows_gap) == ("inconclusive", False)


def test_shapes_of_a_sheet_have_deviations_that_fall_with_their_number_and_a_mean_square_of_one():
    """Near the held edge too, where all of them are small; across the first of three nothing bends."""
    corners = [(-0.5, 0.0), (0.5, 0.0), (0.5, -1.0), (-0.5, -1.0)]
    garment = SimpleNamespace(
        outline_m=corners, points=[SimpleNamespace(at_m=(x, -down)) for down in (0.05, 0.1) for x in (-0.3, 0.4)]
    )
    shapes = shapes_of(SimpleNamespace(garment=garment, judged=np.ones(4, bool)))
    assert (shapes**2).sum(1).mean() == pytest.approx(1.0)
    height = np.repeat([0.95, 0.9], 2)
    plain = [j0(zero * np.sqrt(height)) / number for number, zero in enumerate(jn_zeros(0, 3), 1)]
    assert shapes[:, 1:3] / shapes[:, :1] == pytest.approx(np.array(plain[1:]).T / plain[0][:, None])


@pytest.mark.parametrize(("name", "starts"), [("depth_scale", []), ("time_offset", [("clip_slack",)])])
def test_an_effect_whose_law_explains_the_held_edge_needs_no_other_start(name, starts):
    """As above, 1500 of 9000 squared deviations are within a depth scale's law. Another effect leaves 1100."""
    search = a_search((12.0, 100.0), {name: (6.0, 40.0), "clip_slack": (11.0, 90.0)})
    search.base = with_edge(search.base, 9000)
    order = [with_edge(search.singles[name], 1500), with_edge(search.singles["clip_slack"], 1100)]
    assert [one.effects for one in search._further_starts(order)] == starts


def test_an_effect_is_added_below_exactly_its_level():
    both = hypothesis(("air_drag", "hem"), 6.0)
    for p_value, is_added in ((FAMILY_WISE_LEVEL, False), (np.nextafter(FAMILY_WISE_LEVEL, 0.0), True)):
        assert may_be_added(evidence_of({}).observer, both, p_value) == is_added


def test_the_known_error_is_that_of_mesh_and_solver_and_of_a_shaken_hanger():
    """2 mm, and the root of 13 - 4 that the noise has beyond the measured one."""
    noise = SimpleNamespace(mm=13.0**0.5, measured_mm=2.0)
    assert known_error_mm(noise, SimpleNamespace(numerics_mm=2.0)) == pytest.approx(13.0**0.5)


def test_without_any_fitted_set_an_unknown_cause_is_unknown():
    shares = {(): (0.1, 0.9)}
    found = SimpleNamespace(fits={(): None}, shares=lambda: shares)
    assert decide_by_mass(evidence_of({}), found).verdict == "unknown"


def test_an_unknown_cause_that_is_as_likely_as_a_certain_effect_comes_first():
    shares = {(): (0.0, 0.0), ("air_drag",): (0.5, 0.5)}
    found = SimpleNamespace(fits=dict.fromkeys(shares), shares=lambda: shares)
    assert decide_by_mass(evidence_of({"air_drag": 5.5}), found).verdict == "unknown"


def test_effects_together_may_leave_exactly_what_their_laws_do():
    """A twentieth of 119 mm^2 and 25 of noise."""
    evidence = flat_evidence({"time_offset": 11.0, "hem": 11.0}, floor_error_mm=0.0)
    left = 25.0 + 0.05 * 119.0
    for squared, is_named in ((left, True), (left + 1e-9, False)):
        errors = BlockErrors(np.full(12, squared), np.ones(12), np.zeros(3))
        both = dataclasses.replace(hypothesis(("time_offset", "clock_drift"), 5.0), errors=errors)
        assert (probabilities(evidence, both)["clock_drift"] > 0.5) == is_named


@pytest.mark.parametrize("scale", [1.0, 1e-4])
def test_effects_are_compared_alike_however_little_they_move(scale):
    """Half of the residual is along the first one; two of three are twins; and weights count by their shares."""
    rng = np.random.default_rng(0)
    first, second = np.linalg.qr(rng.normal(size=(60, 2)))[0].T * 3.0 * scale
    observer = SimpleNamespace(layout=SimpleNamespace(block=np.repeat(np.arange(6), 10)))
    base = SimpleNamespace(residual=5.0 * first / scale + rng.normal(0, 0.01, 60))
    assert _inflation(observer, base, [first, second]) == 1.0
    linear = object.__new__(Linear)
    linear.columns = SimpleNamespace(effects=("a", "b", "c"))
    linear.seen = np.stack([first, 0.99 * first + 0.1 * second, second])
    assert linear.twins() == {frozenset("ab")}
    assert effective_count(np.eye(3), scale * np.array([1.0, 1.0, 2.0])) == pytest.approx(16 / 6)


def test_a_hanger_of_constant_speed_does_not_speed_up():
    """An eighth of a metre per second, in steps that numbers hold exactly."""
    time = np.arange(64) / 32
    held = np.zeros((64, 6))
    held[:, [0, 3]] = (0.125 * time)[:, None]
    assert set(_phases(SimpleNamespace(time=time, held=lambda instants: held))) == {"hanger slowing down"}


@pytest.mark.parametrize(("cost", "is_alike"), [((1.0 + CONVERGED) * 64.0, True), ((1.0 + CONVERGED) * 64.001, False)])
def test_an_end_that_costs_exactly_as_much_as_starts_may_differ_by_is_alike(cost, is_alike, monkeypatch):
    monkeypatch.setattr("fit.gap.findings.block_errors", lambda observer, residual: None)
    monkeypatch.setattr("fit.gap.findings.share_of", lambda *given: SimpleNamespace(p_value=0.001))
    best, near, other = (SimpleNamespace(cost=one, residual=None) for one in (64.0, 64.0, cost))
    assert alike_ends(None, best, [best, other, near]) == [best, near, other][: 2 + is_alike]


def test_an_effect_that_wins_exactly_a_tenth_of_the_draws_is_a_rival(monkeypatch):
    for share, verdict in ((RIVAL, "ambiguous"), (np.nextafter(RIVAL, 0.0), "effect")):
        monkeypatch.setattr(Evidence, "win_shares", lambda self, share=share: {"air_drag": 0.7, "hem": share})
        assert decide(evidence_of({"air_drag": 6.0, "hem": 6.2})).verdict == verdict


def test_an_effect_that_closes_exactly_a_quarter_of_the_gap_is_a_cause(monkeypatch):
    """29.75 of 119 mm^2; nothing else is against it."""
    monkeypatch.setattr("fit.gap.weighed.excludes_zero", lambda interval: True)
    shares = found_of({(): (0.1, 0.0), ("air_lift",): (0.9, 0.0)})
    evidence = flat_evidence({"air_lift": 6.0})
    lift = evidence.singles["air_lift"]
    for left, verdict in ((114.25, "effect"), (114.3, "unknown")):
        errors = BlockErrors(np.full(12, 10.0 * left), np.full(12, 10.0), np.zeros(3))
        base = BlockErrors(np.full(12, 1440.0), np.full(12, 10.0), np.zeros(3))
        some = dataclasses.replace(
            evidence, base=dataclasses.replace(evidence.base, errors=base),
            singles={"air_lift": dataclasses.replace(lift, errors=errors)},
        )  # fmt: skip
        assert decide_by_mass(some, shares).verdict == verdict


def test_a_probability_of_exactly_a_half_is_told_beside_a_p_value(monkeypatch):
    monkeypatch.setattr(Evidence, "p_value", lambda self, effect: 0.3)
    for chance, is_said in ((0.5, True), (np.nextafter(0.5, 0.0), False)):
        monkeypatch.setattr("fit.gap.verdict.probabilities", lambda *given, chance=chance: {"air_drag": chance})
        assert bool(_likely_all_the_same(evidence_of({"air_drag": 6.0}), "air_drag")) == is_said


def test_mesh_and_solver_may_leave_the_square_of_their_error():
    """25 mm^2 of noise and 4 of 2 mm, a fifth more: 34.8. An error of 37 mm^2 is more."""
    evidence = flat_evidence({}, base=37.0**0.5, numerics_mm=2.0)
    off = dataclasses.replace(evidence, base=with_edge(evidence.base, 9000))
    shares = found_of({(): (0.9, 0.02), ("air_drag",): (0.08, 0.0)})
    assert decide_by_mass(off, shares).verdict == "unknown"


def test_two_effects_that_leave_too_much_are_told_with_what_they_leave():
    said = decide(evidence_of({"air_drag": 9.0}, joint=[(("air_drag", "time_offset"), 6.6)])).sentence
    assert "come nearest, and together leave 16 % of it" in said


def test_effects_that_the_held_edge_identifies_come_by_what_they_close():
    evidence = evidence_of({"clip_slack": 9.0, "time_offset": 7.0})
    evidence.__dict__["identified_by_edge"] = frozenset({"clip_slack", "time_offset"})
    assert effects_identified_by_edge(evidence) == ["time_offset", "clip_slack"]


def test_a_best_set_that_was_never_fitted_limits_no_odds():
    found = found_of({(): (0.1, 0.0), ("air_drag",): (0.9, 0.0)})
    del found.fits[("air_drag",)]
    assert limited(None, found) is found.mass


def test_a_further_effect_that_saves_exactly_a_twentieth_of_the_most_distance_is_tried():
    """Half of 10 mm^2 a tenth."""
    for nearer, tried in ((0.5, ["first", "second"]), (0.4999, ["first"])):
        found = {
            "first": signature((1.0, 0.0), predicted=50.0, predicted_mm2=10.0),
            "second": signature((0.0, 1.0), predicted=40.0, predicted_mm2=nearer),
        }  # fmt: skip
        assert further(found, 9) == tried


def test_an_effect_has_its_amplitude_however_little_a_typical_size_moves():
    """A millionth of what noise does, and a million typical sizes of it."""
    row = np.linalg.qr(np.random.default_rng(0).normal(size=(NUMBERS, 1)))[0].T[0]
    hem = KINDS["hem"]
    for scale in (1.0, 1e-6):
        observer = LinearObserver(-3.0 * row, np.zeros((NUMBERS, len(SI.initial))), {"hem": scale * row / hem.typical})
        found = screen(observer, observer.fitted(), ("hem",))["hem"]
        assert found.amplitude[0] * scale / hem.typical == pytest.approx(3.0, rel=1e-6)

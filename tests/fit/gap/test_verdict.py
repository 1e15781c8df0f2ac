"""The verdict and its probabilities, on made-up figures that allow hand calculation of each rule."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.stats import t as student

from fit.cloth.effect import amplitudes_of
from fit.effects import LIBRARY, find_effects
from fit.gap.closure import BlockErrors
from fit.gap.passing import FAMILY_WISE_LEVEL, may_be_added, passing_effects
from fit.gap.probabilities import LEFT_WIDTH, ODDS, SHARE_LEFT, probabilities
from fit.gap.rounds import Rounds
from fit.gap.verdict import _unnamed, decide, lacks
from formats.diagnosis_records import in_percent
from tests.fit.gap.verdict_scene import BLOCKS, COARSE, STILL, UNSETTLED, evidence_of, hypothesis, signature


@pytest.mark.parametrize(
    ("given", "verdict", "named"),
    [
        # 12 mm without, 6 with, floor 5: (144 - 36) / (144 - 25) = 91 % of the gap.
        ({"singles": {"air_drag": 6.0, "hem": 11.5}}, "effect", ["air_drag"]),
        ({"singles": {"air_drag": 11.9}}, "unknown", []),
        # 10.2 mm: a third of the gap, significant and yet not the cause.
        ({"singles": {"air_drag": 10.2}}, "unknown", []),
        ({"singles": {"air_drag": 6.0, "hem": 6.02}}, "ambiguous", ["air_drag", "hem"]),
        # A draught closes 80 %, more than four fifths of 91 %, and is the best in no draw.
        ({"singles": {"air_drag": 6.0, "hem": 6.02, "draught": 7.0}}, "ambiguous", ["air_drag", "hem"]),
        # A finer mesh closes 60 %: more than 44 % with drag, less than 91 %.
        ({"singles": {"air_drag": 9.6}, "gate_list": [COARSE]}, "numerics", []),
        ({"singles": {"air_drag": 6.0}, "gate_list": [COARSE]}, "effect", ["air_drag"]),
        ({"singles": {"air_drag": 6.0}, "gate_list": [STILL]}, "inconclusive", []),
        ({"singles": {"air_drag": 6.0}, "gate_list": [UNSETTLED]}, "inconclusive", []),
        ({"singles": {"air_drag": 5.0}, "base": 5.3}, "none", []),
        # Drag of 3.0, the end of its range: no such air.
        ({"singles": {"air_drag": 6.0}, "sizes": 2.5}, "unknown", []),
        ({"singles": {"air_drag": 9.0}, "joint": [(("air_drag", "hem"), 5.5)]}, "several", ["air_drag", "hem"]),
        ({"singles": {"air_lift": 9.0}, "joint": [(("air_lift", "hem"), 5.5)], "joint_p": 0.3}, "effect", ["air_lift"]),
        # Of 119 mm^2 11 may be left by laws of drag good to 10 %, 30^2 %, beside 30 of noise and 2 of mesh: 43.
        ({"singles": {"air_drag": 6.5}}, "effect", ["air_drag"]),
        ({"singles": {"air_drag": 6.6}}, "unknown", []),
        ({"singles": {"air_lift": 8.0}}, "effect", ["air_lift"]),
        # A twentieth, 6, whatever is known of the clock.
        ({"singles": {"time_offset": 6.1}}, "effect", ["time_offset"]),
        ({"singles": {"time_offset": 6.2}}, "unknown", []),
        ({"singles": {"air_drag": 9.0}, "joint": [(("air_drag", "time_offset"), 6.6)]}, "unknown", []),
        # Alone drag closes 19 % and the hem 10 %, together 91 %, or 40 %.
        (
            {"singles": {"air_drag": 11.0, "hem": 11.5}, "joint": [(("air_drag", "hem"), 6.0)]},
            "several",
            ["air_drag", "hem"],
        ),
        ({"singles": {"air_drag": 11.0, "hem": 11.5}, "joint": [(("air_drag", "hem"), 9.8)]}, "unknown", []),
        # With drag 0.6 mm^2 are left beyond the noise, less than the 1 mm^2 of mesh and solver: nothing needs a hem.
        ({"singles": {"air_drag": 5.06}, "base": 6.0, "joint": [(("air_drag", "hem"), 5.0)]}, "effect", ["air_drag"]),
        # The hem closes 12 % of the gap, but 14 of the 56 mm^2 that lift leaves beyond the noise: a quarter.
        ({"singles": {"air_lift": 9.0}, "joint": [(("air_lift", "hem"), 8.2)]}, "effect", ["air_lift"]),
    ],
)
def test_the_verdict_follows_the_rules(given, verdict, named):
    found = decide(evidence_of(**given))
    assert (found.verdict, found.named) == (verdict, named), found.sentence


def test_no_effect_passes_if_there_is_hardly_a_gap_to_close():
    """25.2 of 25 mm^2 are noise: drag fits that better, to 16, but no share of a gap is defined."""
    evidence = evidence_of({"air_drag": 4.0}, base=5.02)
    assert evidence.closure_of(evidence.singles["air_drag"]) is None
    assert evidence.p_value("air_drag") < FAMILY_WISE_LEVEL
    assert passing_effects(evidence) == []
    assert passing_effects(evidence_of({"air_drag": 6.0})) == ["air_drag"]


@pytest.mark.parametrize(("deviation", "p_value", "is_added"), [
    (0.5, 0.04, True), (0.5, 0.06, False), (0.7, 0.04, False),
])  # fmt: skip
def test_an_effect_is_added_where_its_size_is_surely_something(deviation, p_value, is_added):
    """The added effect is one typical size long: 1.645 x 0.5 is less than that, and 1.645 x 0.7 is more."""
    both = hypothesis(("air_drag", "hem"), 6.0, deviation=deviation)
    assert may_be_added(evidence_of({}).observer, both, p_value) == is_added


@pytest.mark.parametrize(("deviations", "is_added"), [((0.7, 0.05), True), ((0.05, 0.7), False)])
def test_of_several_effects_the_size_of_the_last_one_is_surely_something(deviations, is_added):
    both = hypothesis(("air_drag", "hem"), 6.0)
    fitted = dataclasses.replace(both.fitted, deviation=np.array([*[0.05] * 5, *deviations]))
    assert may_be_added(evidence_of({}).observer, dataclasses.replace(both, fitted=fitted), 0.04) == is_added


def test_twins_of_one_of_two_effects_share_its_probability():
    """Both leave 5.5 mm beside the drag, in other half-seconds: each is the better one in about half of the draws."""
    pair = hypothesis(("air_drag", "filter_lag"), 5.5, seed=4)
    evidence = evidence_of({"air_drag": 9.5}, joint=[(("air_drag", "time_offset"), 5.5)], instead=[pair])
    together = evidence.joint[0][0]
    offset, lag, drag = (probability_of(n, evidence, together) for n in ("time_offset", "filter_lag", "air_drag"))
    assert 0.25 < offset < 0.75
    assert offset + lag == pytest.approx(drag, abs=1e-9)
    assert drag > 0.9


def test_takes_are_predictable_where_the_model_with_an_effect_is(monkeypatch):
    """Without the rotation of the hanger a base fit ends at too soft a cloth, whose motion is unpredictable."""
    search = object.__new__(Rounds)
    search.observer = None
    base, single = hypothesis((), 12.0), hypothesis(("hanger_rotation",), 6.0)
    worse = dataclasses.replace(base.fitted, vector=base.fitted.vector / 30, residual=np.array([9.0, 0.0, 0.0]))
    search.base, search.singles = dataclasses.replace(base, fitted=worse), {single.effects[0]: single}
    monkeypatch.setattr("fit.gap.gates.predictability_gate", lambda observer, vector, amplitudes: (vector, amplitudes))
    vector, amplitudes = search.predictability()
    assert vector is single.fitted.vector
    assert amplitudes is single.fitted.amplitudes


def test_an_effect_at_the_end_of_its_range_is_no_rival():
    """A tilt of 0.1 rad, which no rig has, closes 91 %; a draught that closes 76 % is named all the same."""
    evidence = evidence_of({"gravity_tilt": 6.0, "draught": 7.3})
    tilt = "gravity_tilt"
    stopped = dataclasses.replace(
        evidence.singles[tilt].fitted, amplitudes=amplitudes_of(LIBRARY, gravity_tilt=(0.1, 0.0))
    )
    singles = {**evidence.singles, tilt: dataclasses.replace(evidence.singles[tilt], fitted=stopped)}
    evidence = dataclasses.replace(evidence, singles=singles)
    found = decide(evidence)
    assert (found.verdict, found.named) == ("effect", ["draught"])
    assert probability_of("gravity_tilt", evidence) == 0.0
    assert probability_of("draught", evidence) > 0.6


@pytest.mark.parametrize(("blocks", "verdict"), [(5, "effect"), (1, "unknown")])
def test_an_effect_that_acts_in_few_half_seconds_is_named_if_enough_of_them_hold_the_gap(blocks, verdict):
    """Lift closes nine tenths of 400 mm^2 in some half-seconds of twelve, and there is next to no gap in the others."""
    few = np.where(np.arange(BLOCKS) < blocks, 4000.0, 300.0)
    left = few - np.where(np.arange(BLOCKS) < blocks, 3300.0, -15.0 + 30.0 * (np.arange(BLOCKS) % 2))
    evidence = evidence_of({"air_lift": 9.0})
    (lift,) = evidence.singles.values()
    before, after = (BlockErrors(sums, np.full(BLOCKS, 10.0), np.zeros(3)) for sums in (few, left))
    evidence = dataclasses.replace(
        evidence, base=dataclasses.replace(evidence.base, errors=before),
        singles={"air_lift": dataclasses.replace(lift, errors=after)},
    )  # fmt: skip
    assert (evidence.p_value("air_lift") < FAMILY_WISE_LEVEL) == (verdict == "effect")
    assert decide(evidence).verdict == verdict


def level(mm):
    return BlockErrors(np.full(BLOCKS, 10.0 * mm**2), np.full(BLOCKS, 10.0), np.zeros(3))


@pytest.mark.parametrize(("deviation", "verdict"), [(0.55, "effect"), (0.65, "unknown")])
def test_an_amplitude_that_may_be_nothing_is_not_named(deviation, verdict):
    """A typical size, known to 1.645 times its deviation."""
    evidence = evidence_of({"air_lift": 6.0})
    (lift,) = evidence.singles.values()
    fitted = dataclasses.replace(lift.fitted, deviation=np.full(6, deviation))
    singles = {"air_lift": dataclasses.replace(lift, fitted=fitted)}
    found = decide(dataclasses.replace(evidence, singles=singles))
    assert found.verdict == verdict
    # 144 - 36 of 144 - 25 mm^2 are 91 %.
    weak = "explains it for sure. Air lift would close 91 % of it [89 to 93 %], but the evidence is too weak"
    assert (weak in found.sentence) == (verdict == "unknown")


def test_at_the_end_of_its_range_or_with_little_closed_no_effect_is_said_to_come_near():
    for evidence in (evidence_of({"air_drag": 6.0}, sizes=2.5), evidence_of({"air_drag": 11.9})):
        assert "There is a gap that no effect in the library explains." in decide(evidence).sentence


def test_of_effects_with_too_weak_evidence_the_one_that_closes_most_is_said_to_come_near():
    """Of 119 mm^2 lift closes 113.75, or 96 %; drag and a hem, before and after it, close 92 and 91 %."""
    said = _unnamed(evidence_of({"air_drag": 5.9, "air_lift": 5.5, "hem": 6.0}))
    assert "for sure. Air lift would close 96 % of it [94 to 98 %], but the evidence is too weak" in said


@pytest.mark.parametrize(
    ("frequency", "least", "verdict"), [(0.0, 2.0, "none"), (4.5, 0.5, "none"), (4.5, 2.0, "inconclusive")]
)
def test_no_gap_under_a_pull_says_what_could_not_have_been_seen(monkeypatch, frequency, least, verdict):
    """Tilts of twice their typical 0.03 rad, or half of it, would have shown; effects without motion are not listed."""
    smallest = {"gravity_tilt": np.array([0.03 * least, np.inf]), "hem": np.array([0.001])}
    evidence = evidence_of({"air_drag": 5.0}, base=5.3)
    monkeypatch.setattr("fit.gap.power.smallest_detectable", lambda given: smallest if given is evidence else {})
    evidence.observer.frequency = frequency
    evidence.screened["gravity_tilt"] = evidence.screened["hem"] = signature(raw=np.zeros((2, 3)))
    evidence.observer.in_mm = lambda row: float(np.abs(row).max())
    found = decide(evidence)
    assert (found.verdict, found.named) == (verdict, [])
    told = "These could not have been seen: tilted gravity (x) below 3.4 degrees."
    assert (told in found.sentence) == (verdict == "inconclusive")
    assert ("pull of 4.5 Hz" in found.sentence) == (verdict == "inconclusive")


def test_a_model_that_leaves_no_more_than_the_noise_closes_the_gap_to_within_it():
    """144 - 22 of 144 - 25 mm^2 are 102 %; with 6.0 mm, 91 %, and the noise is known to 5.0 + 5.84 x 0.08 = 5.5."""
    below = decide(evidence_of({"air_drag": 4.7})).sentence
    assert "102 % of the gap is closed" in below
    assert "The remaining error is within the noise." in below
    assert "the sensor's noise alone is 5.0 mm" in below
    for mm, is_within in ((5.4, True), (5.5, False)):
        assert ("within the noise" in decide(evidence_of({"air_drag": mm})).sentence) == is_within
    joint = evidence_of({"air_drag": 9.0}, joint=[(("air_drag", "hem"), 4.9)])
    assert "The remaining error is within the noise." in decide(joint).sentence


@pytest.mark.parametrize(
    ("name", "verdict"), [("air_drag", "effect"), ("stretch_viscosity", "unknown"), ("anisotropy", "unknown")]
)
def test_an_effect_by_which_solvers_differ_must_exceed_their_error(name, verdict):
    """(12^2 - 6^2) mm^2 = 108 is more than half of 9^2 = 81, and less than three times it."""
    evidence = dataclasses.replace(evidence_of({name: 6.0}), numerics_mm=9.0)
    assert decide(evidence).verdict == verdict


@pytest.mark.parametrize(("share", "verdict"), [(0.45, "unknown"), (0.55, "effect")])
def test_a_named_effect_is_worth_naming_in_half_of_the_draws(share, verdict):
    evidence = evidence_of({"air_drag": 6.0})
    drag = next(iter(evidence.singles))
    evidence.__dict__["worth_naming"] = {drag: np.arange(400) < 400 * share}
    assert decide(evidence).verdict == verdict


LACKS = [(6.0, 0.8, 1.0, "lacks"), (8.3, 0.5, 0.8, "probably lacks"), (9.6, 0.0, 0.5, "may lack")]


def probability_of(name, evidence, several=None):
    return probabilities(evidence, several)[name]


def test_an_effect_that_leaves_much_is_less_probable():
    """With d mm it leaves (d^2 - 26) / 119 of the gap.

    The probability is 1 / (1 + exp((left - SHARE_LEFT) / LEFT_WIDTH)), its odds times ODDS.
    """
    for mm in (5.0, 8.0, 8.6, 9.2):
        left = (mm**2 - 26) / 119
        share = 1 / (1 + np.exp((left - SHARE_LEFT) / LEFT_WIDTH))
        expected = ODDS * share / (1 - share + ODDS * share)
        assert probability_of("air_lift", evidence_of({"air_lift": mm})) == pytest.approx(expected, abs=0.08)


@pytest.mark.parametrize(("mm", "least", "most", "words"), LACKS)
def test_the_sentence_that_names_a_cause_is_as_sure_as_it_is_probable(mm, least, most, words):
    evidence = evidence_of({"air_lift": mm})
    likely = probability_of("air_lift", evidence)
    assert least < likely < most
    title = evidence.observer.library["air_lift"].title
    begun = f"The model {words} {title}, with a probability of {in_percent(likely)}."
    assert decide(evidence).sentence.startswith(begun)


@pytest.mark.parametrize(
    ("likely", "words"),
    [([0.8], "lacks x, with a probability of 80 %."), ([0.5], "probably lacks x, with a probability of 50 %."),
     ([0.978], "lacks x, with a probability of 98 %."), ([0.9951], "lacks x, with a probability of more than 99 %."),
     ([0.9, 0.6], "probably lacks x, each with a probability of at least 60 %."),
     ([0.999, 1.0], "lacks x, each with a probability of more than 99 %."),
     ([0.004], "may lack x, with a probability of less than 1 %."),
     ([0.001, 0.004], "may lack x, each with a probability of less than 1 %."),
     ([0.9, 0.004], "may lack x, the least probable with a probability of less than 1 %.")],
)  # fmt: skip
def test_a_named_cause_has_its_probability_in_its_sentence(likely, words):
    assert lacks(likely, "x") == f"The model {words}"


def test_effects_that_together_leave_much_are_less_probable_too():
    """Lift alone leaves 85 of 119 mm^2, with a draught 49, or 40 % beyond mesh and solver: as one effect would."""
    evidence = evidence_of({"air_lift": 10.5}, joint=[(("air_lift", "draught"), 8.6)])
    share = 1 / (1 + np.exp((48 / 119 - SHARE_LEFT) / LEFT_WIDTH))
    expected = ODDS * share / (1 - share + ODDS * share)
    assert probability_of("draught", evidence, evidence.joint[0][0]) == pytest.approx(expected, abs=0.1)


def test_a_twin_that_leaves_more_takes_nothing_from_the_probability_of_the_better_one():
    """Beside the drag a time offset leaves 5.5 mm, and a filter lag, which closes nine tenths as much, 5.9."""
    worse = hypothesis(("air_drag", "filter_lag"), 5.9, seed=9)
    evidence = evidence_of({"air_drag": 9.5}, joint=[(("air_drag", "time_offset"), 5.5)], instead=[worse])
    together = evidence.joint[0][0]
    assert probability_of("time_offset", evidence, together) > 0.9
    assert probability_of("filter_lag", evidence, together) < 0.05


def test_the_error_of_mesh_and_solver_does_not_count_against_an_effect():
    """With 8 mm 39 of 119 mm^2 are left, of which 5.5 mm of mesh and solver make 30."""
    evidence = evidence_of({"air_lift": 8.0})
    coarse = dataclasses.replace(evidence, numerics_mm=5.5)
    assert probability_of("air_lift", coarse) > probability_of("air_lift", evidence) + 0.03


def test_an_effect_that_leaves_more_than_its_laws_would_is_not_probable():
    """With 7 mm 24 of 119 mm^2 are left: as a cause of some law four in five, as a drag hardly."""
    assert probability_of("air_lift", evidence_of({"air_lift": 7.0})) > 0.7
    assert probability_of("air_drag", evidence_of({"air_drag": 7.0})) < 0.1
    evidence = evidence_of({"air_drag": 9.0}, joint=[(("air_drag", "time_offset"), 7.0)])
    assert probability_of("air_drag", evidence, evidence.joint[0][0]) < 0.1


def test_effects_that_are_needed_together_are_as_probable_as_their_sum_is():
    """9.5 mm with drag alone, 5.5 with a hem as well: nearly nothing is left. With 9.4 the hem adds nothing."""
    for joint, likely in ((5.5, 1.0), (9.4, 0.0)):
        evidence = evidence_of({"air_drag": 9.5, "hem": 11.9}, joint=[(("air_drag", "hem"), joint)])
        together = evidence.joint[0][0]
        assert probability_of("hem", evidence, together) == pytest.approx(likely, abs=0.1)
        assert probability_of("hem", evidence) == pytest.approx(0.0, abs=0.02)


@pytest.mark.parametrize(("error", "verdict"), [(0.5, "effect"), (0.1, "effect"), (0.01, "unknown")])
def test_error_that_a_cause_leaves_beyond_its_law_is_noise_only_as_far_as_the_noise_is_uncertain(error, verdict):
    """Of 119 mm^2 drag may leave 10.7, and the mesh 2; left are 14.3: with noise of 5.2 mm for 5 that is enough."""
    evidence = dataclasses.replace(evidence_of({"air_drag": np.sqrt(39.3)}), floor_error_mm=error)
    assert decide(evidence).verdict == verdict


def test_an_interval_holds_what_laws_differ_by_unless_the_effect_is_one_of_measurement():
    """90 % of a deviation of 5 % and, for drag, of a law that is good to 10 %: 1.645 hypot(0.05, 0.1) = 0.184."""
    evidence = evidence_of({"air_drag": 6.0, "time_offset": 7.0})
    for name, half in (("air_drag", 0.1839), ("time_offset", 0.0823)):
        effect = find_effects([name])[0]
        size, (low, high) = evidence.amplitude(name)
        assert size == pytest.approx(effect.typical)
        assert (high - low) / 2 == pytest.approx(half * effect.typical, rel=0.02)


def test_the_sentence_says_where_a_local_effect_acts():
    sentence = decide(evidence_of({"hem": 6.0})).sentence
    assert "With a heavier hem (0.01 kg/m [0.00" in sentence
    assert "along the bottom) it misses by 6.0 mm" in sentence
    assert " at the " not in decide(evidence_of({"air_drag": 6.0})).sentence


@pytest.mark.parametrize("given", [{"singles": {"air_drag": 7.0}}, {"singles": {"air_lift": 10.3}}])
def test_the_nearest_effect_that_leaves_too_much_is_reported_with_what_it_leaves(given):
    """Drag leaves 24 of 119 mm^2, more than its laws would; lift 81, more than any cause."""
    found = decide(evidence_of(**given))
    left = {
        "air_drag": "air drag comes nearest, and leaves 20 %",
        "air_lift": "air lift comes nearest, and leaves 68 %",
    }
    assert found.verdict == "unknown"
    assert left[next(iter(given["singles"]))] in found.sentence, found.sentence
    assert "more than a true cause would" in found.sentence


@pytest.mark.parametrize(("mesh", "verdict"), [(7.6, "unknown"), (7.8, "numerics")])
def test_a_gap_that_nothing_explains_and_that_may_mostly_be_the_meshs_own_error_asks_for_a_finer_one(mesh, verdict):
    """A gap of 12^2 - 5^2 = 119 mm^2, half of it is 7.7^2; of 7.8 mm the mesh's own 7.8 are above noise of 5."""
    made_up = dataclasses.replace(evidence_of({"air_drag": 11.9}), mesh_mm=mesh, numerics_mm=mesh)
    found = decide(made_up)
    assert (found.verdict, found.named) == (verdict, [])
    assert ("wrong by 7.8 mm, and most of the gap" in found.sentence) == (verdict == "numerics")


@pytest.mark.parametrize(
    ("mesh", "numerics", "verdict"),
    [
        # A gap of 12 mm over noise of 5 mm, all within what mesh and solver may be wrong by.
        (20.0, 20.1, "numerics"),
        (6.9, 20.0, "none"),  # the solver's share, 18.8 mm, is the greater part: no mesh mends it
        (0.0, 20.0, "none"),
    ],
)
def test_a_gap_within_a_coarse_meshs_own_error_is_no_proof_of_none(mesh, numerics, verdict):
    made_up = dataclasses.replace(evidence_of({}), mesh_mm=mesh, numerics_mm=numerics)
    found = decide(made_up)
    assert (found.verdict, found.named) == (verdict, [])
    assert f"Mesh and solver may be wrong by {numerics:.1f} mm".lower() in found.sentence.lower()


def test_where_there_is_no_gap_the_mesh_hides_none():
    made_up = dataclasses.replace(evidence_of({}, base=5.0), mesh_mm=20.0, numerics_mm=20.0)
    assert decide(made_up).verdict == "none"


@pytest.mark.parametrize("error", [0.0, 0.3])
def test_the_interval_of_closure_holds_what_is_not_known_of_the_noise(error):
    """119 of 144 - F^2 mm^2 are all, to 2 F times what F is not known to, t of two replicas less than three, of 119."""
    evidence = evidence_of({"air_drag": 5.0}, floor_error=error)
    evidence = dataclasses.replace(evidence, base=dataclasses.replace(evidence.base, errors=level(12.0)))
    drag = dataclasses.replace(evidence.singles["air_drag"], errors=level(5.0))
    closed = evidence.closure_of(drag)
    half = student.ppf(0.95, 2) * 10 * error / 119
    assert closed.value == pytest.approx(1.0)
    assert closed.interval == pytest.approx((1 - half, 1 + half))

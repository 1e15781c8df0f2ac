"""Figures and words of one diagnosis agree with each other: probability, p-value, interval, closure and range."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest

from fit.gap.closure import BlockErrors, gain_p_value
from fit.gap.findings import alike_ends, base_parameters, describe_effects, with_nothing
from fit.gap.passing import FAMILY_WISE_LEVEL, what_lacks
from fit.gap.probabilities import probabilities
from fit.gap.verdict import _unnamed, decide
from fit.methods import SI
from formats.diagnosis_records import in_percent
from tests.fit.gap.verdict_scene import BLOCKS, KINDS, evidence_of, hypothesis, like


def in_blocks(squared):
    """Mean squared errors [mm^2] of blocks of ten points."""
    return BlockErrors(10.0 * np.asarray(squared), np.full(BLOCKS, 10.0), np.zeros(3))


def one_take(rest=20.0, **changes):
    """Evidence of a take that is fitted to and judged on: two half-seconds hold the gap, which drag closes unevenly."""
    evidence = evidence_of({"air_drag": 5.4})
    before, after = np.full(BLOCKS, 30.0), np.full(BLOCKS, rest)
    before[:2], after[:2] = (144.0 * BLOCKS - 30.0 * (BLOCKS - 2)) / 2, (119.0, 29.0)
    drag = dataclasses.replace(evidence.singles["air_drag"], errors=in_blocks(after))
    base = dataclasses.replace(evidence.base, errors=in_blocks(before))
    screened = like(**dict.fromkeys(KINDS, 0.1))
    given = {"base": base, "singles": {"air_drag": drag}, "screened": screened, "is_held_out": False} | changes
    return dataclasses.replace(evidence, **given)


def test_a_likely_effect_with_a_weak_test_is_told_why_both_hold():
    evidence = one_take()
    p_value, chance = evidence.p_value("air_drag"), probabilities(evidence, None)["air_drag"]
    assert p_value >= FAMILY_WISE_LEVEL
    assert chance > 0.5
    said = decide(evidence).sentence
    assert f"too weak to name it: p is {p_value:.2g} where less than 0.05 is needed." in said
    assert f"allows for the choice among {len(evidence.screened)} effects on the takes they are judged on." in said
    assert f"Its probability of {in_percent(chance)} does not: it ranks the library's effects." in said


def test_on_a_held_out_take_the_p_value_allows_for_the_refitted_effects_alone():
    others = [name for name in KINDS if name != "air_drag"][:15]
    idle = evidence_of(dict.fromkeys(others, 12.1)).singles
    evidence = one_take(singles=one_take().singles | idle, is_held_out=True)
    assert evidence.p_value("air_drag") >= FAMILY_WISE_LEVEL
    said = decide(evidence).sentence
    assert "The p-value allows for 16 refitted effects and for the few independent half-seconds." in said
    assert "ranks the library's effects, and tests none." in said


def test_each_test_that_an_effect_fails_is_named():
    assert what_lacks(evidence_of({"air_lift": 6.0}), "air_lift") == []
    assert what_lacks(evidence_of({"air_lift": 11.9}), "air_lift") == ["less than 25 % is too little"]
    nothing = dataclasses.replace(evidence_of({"air_lift": 6.0}), numerics_mm=20.0)
    assert "it removes no more error than mesh and solver may make" in what_lacks(nothing, "air_lift")
    evidence = evidence_of({"air_lift": 6.0})
    lift = evidence.singles["air_lift"]
    unsure = dataclasses.replace(lift, fitted=dataclasses.replace(lift.fitted, deviation=np.full(6, 0.65)))
    evidence = dataclasses.replace(evidence, singles={"air_lift": unsure})
    assert what_lacks(evidence, "air_lift") == ["its size may be 0, as far as noise, mesh and solver can tell"]


def test_an_unnamed_effect_that_passes_every_test_lacks_draws_of_effects_that_pass():
    """Draws that name an effect which fails a test do name one, so it is not that most draws name none."""
    evidence = evidence_of({"air_drag": 6.0})
    assert what_lacks(evidence, "air_drag") == []
    said = _unnamed(evidence)
    assert "too weak to name it: fewer than half of the draws name an effect that passes every test." in said


def test_a_closure_of_an_unnamed_effect_has_its_interval_and_its_meaning_beyond_all():
    said = decide(one_take(rest=12.0)).sentence
    found = re.search(r"Air drag would close (\d+) % of it \[(-?\d+) to (\d+) %\]( \(above 100 %: less is left)?", said)
    assert found is not None
    assert int(found[1]) > 100
    assert found[4]
    within = decide(one_take()).sentence
    assert "above 100 %" not in within


def test_more_than_all_of_the_gap_is_explained_where_it_is_named():
    """144 - 24 of 144 - 25 mm^2 are 101 %."""
    said = decide(evidence_of({"air_lift": 24.0**0.5})).sentence
    assert "101 % of the gap is closed" in said
    assert "(above 100 %: less is left than the noise was estimated to be)" in said
    assert "above 100 %" not in decide(evidence_of({"air_lift": 5.001})).sentence


@pytest.mark.parametrize(("mm", "reaches_zero"), [(6.0, False), (12.3, True)])
def test_an_effect_that_does_not_lower_the_error_has_an_interval_with_zero(mm, reaches_zero):
    evidence = evidence_of({"gravity_tilt": mm})
    _, ends = evidence.amplitude("gravity_tilt")
    assert ends[0] > 0  # the fit alone finds it
    is_confirmed = gain_p_value(evidence.base.errors, evidence.singles["gravity_tilt"].errors, 5.0) < 0.05
    assert is_confirmed != reaches_zero
    low, high = with_nothing(evidence, "gravity_tilt", ends)
    assert (low, high) == ((0.0, ends[1]) if reaches_zero else ends)
    assert with_nothing(evidence, "gravity_tilt", (-3.0, -1.0)) == ((-3.0, 0.0) if reaches_zero else (-3.0, -1.0))


def described_with(smallest, monkeypatch, singles):
    monkeypatch.setattr("fit.gap.findings.smallest_detectable", lambda evidence: {
        name: np.full(1, smallest) for name in evidence.screened
    })  # fmt: skip
    evidence = evidence_of(singles)
    base = dataclasses.replace(evidence.base, fitted=dataclasses.replace(evidence.base.fitted, residual=np.ones(3)))
    evidence = dataclasses.replace(evidence, base=base)
    effects = tuple(KINDS[k] for k in evidence.screened)
    return {one.id: one for one in describe_effects(evidence, None, effects, SI)}


def test_the_interval_in_the_table_is_that_of_the_test(monkeypatch):
    found = described_with(0.01, monkeypatch, {"air_drag": 6.0, "gravity_tilt": 12.3})
    assert found["gravity_tilt"].p_value == 1.0
    assert found["gravity_tilt"].amplitude_interval[0] == 0.0
    assert found["air_drag"].p_value < 0.05
    assert found["air_drag"].amplitude_interval[0] > 0.0


@pytest.mark.parametrize(("smallest", "is_shown"), [(1.49, True), (1.51, False), (12016.0, False)])
def test_an_effect_that_would_show_only_beyond_its_range_could_not_have_shown(monkeypatch, smallest, is_shown):
    """The delay of the stamps ranges from -0.5 to 1.5 of an interval."""
    found = described_with(smallest, monkeypatch, {"air_drag": 6.0, "frame_timing": 12.3})["frame_timing"]
    assert (found.minimum_detectable == smallest) == is_shown
    assert (found.minimum_detectable is None) != is_shown
    assert ("these takes could not have shown the effect: only from " in found.note) != is_shown
    assert ("on would it show, and its range ends at 1.5" in found.note) != is_shown


class Seen:
    """What `block_errors` asks of an observer: residuals in metres, two numbers a block and three a point."""

    class layout:  # noqa: N801
        block = np.repeat(np.arange(BLOCKS), 3)
        moving = staticmethod(lambda values: values)
        metres = staticmethod(lambda residual: 1e-3 * residual)

    edge_errors = staticmethod(lambda residual: None)


def ended(cost_share=1.0, wobble=0.0, **changes):
    """A base fit whose cost is this share of 36 mm^2, more or less in every second block."""
    values = {p.name: p.initial for p in SI.parameters} | changes
    one = hypothesis((), 5.0, deviation=0.1).fitted
    shares = 1.0 + wobble * np.where(np.arange(BLOCKS) % 2, 1.0, -1.0)
    residual = np.sqrt(cost_share * np.repeat(shares, 3))
    return dataclasses.replace(one, vector=np.array([values[p.name] for p in SI.parameters]), residual=residual)


@pytest.fixture
def uncorrelated(monkeypatch):
    monkeypatch.setattr("fit.gap.closure.correlation_of", lambda observer, residual: np.eye(BLOCKS))


@pytest.mark.usefixtures("uncorrelated")
@pytest.mark.parametrize(
    ("share", "wobble", "is_alike"),
    [(1.01, 0.3, True), (1.01, 0.0, True), (1.14, 0.0, True), (1.16, 0.0, False), (1.2, 0.99, True), (1.2, 0.3, False)],
)
def test_ends_are_alike_where_costs_agree_or_the_better_one_may_be_chance(share, wobble, is_alike):
    """A fifth more in every block is no chance; a fifth more on average, and twice or nothing in each block, is."""
    best, near, other = ended(), ended(1.1), ended(share, wobble)
    found = [id(one) for one in alike_ends(Seen(), best, [other, best, near])]
    assert found[0] == id(best)
    assert id(near) in found
    assert (id(other) in found) == is_alike


@pytest.mark.usefixtures("uncorrelated")
def test_the_second_best_end_counts_where_none_is_as_good():
    best, second, third = ended(), ended(1.3), ended(1.4)
    assert [id(one) for one in alike_ends(Seen(), best, [best, third, second])] == [id(best), id(second)]
    assert [id(one) for one in alike_ends(Seen(), best, [best])] == [id(best)]


def test_the_interval_of_a_base_parameter_covers_every_alike_end_and_predicts_a_further_one():
    """Student's t of two degrees is 2.920, so that three ends a factor of e^x apart give 2.920 sqrt(4/3) x."""
    first, apart = SI.parameters[0], np.log(1.1)
    ends = [ended(), *(ended(**{first.name: first.initial * np.exp(x)}) for x in (apart, -apart))]
    (found, second, *_) = base_parameters(SI, ends)
    assert found.fitted == first.initial
    half = np.hypot(0.1645, 2.920 * np.sqrt(4 / 3) * apart)
    assert half > 0.1645 + apart  # beyond the hull of the ends' own intervals
    assert found.interval_low == pytest.approx(first.initial * np.exp(-half), rel=1e-3)
    assert found.interval_high == pytest.approx(first.initial * np.exp(half), rel=1e-3)
    assert (second.interval_low, second.interval_high) == pytest.approx(
        (second.initial * np.exp(-0.1645), second.initial * np.exp(0.1645)), rel=1e-3
    )
    wide = [ended(), *(ended(**{first.name: first.initial * x}) for x in (2.0, 0.5))]
    assert [one.is_identified for one in base_parameters(SI, wide)[:2]] == [False, True]
    assert found.is_identified
    (alone, *_) = base_parameters(SI, ends[:1])
    assert alone.is_identified


def test_an_alike_end_at_a_bound_leaves_the_whole_range():
    first = SI.parameters[0]
    (found, *_) = base_parameters(SI, [ended(), ended(**{first.name: first.maximum})])
    assert (found.interval_low, found.interval_high) == (first.minimum, first.maximum)
    assert (found.is_identified, found.is_at_bound) == (False, False)


def test_a_closure_below_the_least_one_reads_as_below_it():
    """24.8 % of the gap: 144 mm^2 - 0.248 (144 - 25) are left, of which mesh and solver may make 64."""
    evidence = evidence_of({"air_lift": float(np.sqrt(144 - 0.248 * 119))})
    said = _unnamed(dataclasses.replace(evidence, numerics_mm=8.0))
    assert "would close 24.8 % of it [" in said
    assert "less than 25 % is too little" in said

"""Sentences of a diagnosis on its gap, its parameters and its limits, from made-up figures."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from fit.effects import LIBRARY
from fit.gap.findings import (
    _reached,
    at_bounds,
    base_parameters,
    describe_effects,
    describe_gap,
    left_out,
    notes,
    unseparated,
)
from fit.gap.floor import Floor
from fit.methods import SI
from tests.fit.gap.verdict_scene import KINDS, evidence_of, hypothesis, with_edge


def fitted_at(**changes):
    """A fit at the initial parameters, some of which are elsewhere; deviations of 0.1."""
    values = {p.name: p.initial for p in SI.parameters} | changes
    fitted = hypothesis((), 5.0, deviation=0.1).fitted
    return dataclasses.replace(fitted, vector=np.array([values[p.name] for p in SI.parameters]))


ONE, TWO, THREE = SI.parameters[:3]


def listed(parameter):
    return f"{parameter.name.replace('_', ' ')} (range from {parameter.minimum:.3g} {parameter.unit})"


def test_parameters_at_their_bounds_are_listed_as_one_writes():
    low = {p.name: p.minimum for p in (ONE, TWO, THREE)}
    first, second, third = map(listed, (ONE, TWO, THREE))
    one = at_bounds(SI, fitted_at(**{ONE.name: ONE.minimum}))
    assert one.startswith(f" In the base fit, {first} is at its bound. The takes identify no value")
    two = at_bounds(SI, fitted_at(**{k: low[k] for k in (ONE.name, TWO.name)}))
    assert two.startswith(f" In the base fit, {first} and {second} are at their bounds. The takes identify no value")
    three = at_bounds(SI, fitted_at(**low))
    assert three.startswith(
        f" In the base fit, {first}, {second} and {third} are at their bounds. The takes identify no value"
    )
    assert at_bounds(SI, fitted_at()) == ""


def test_a_parameter_near_its_upper_bound_is_told_with_the_bound_and_not_with_the_value_of_the_search():
    told = at_bounds(SI, fitted_at(**{TWO.name: 0.995 * TWO.maximum}))
    assert f"{TWO.name.replace('_', ' ')} (range up to {TWO.maximum:g} {TWO.unit}) is at its bound." in told
    assert f"{0.995 * TWO.maximum:.4g}" not in told


@pytest.mark.parametrize(("share", "is_stopped"), [(0.009, True), (0.011, False), (0.989, False), (0.991, True)])
def test_a_parameter_is_stopped_within_a_hundredth_of_its_range_on_its_scale(share, is_stopped):
    assert ONE.is_log
    value = ONE.minimum * (ONE.maximum / ONE.minimum) ** share
    assert (at_bounds(SI, fitted_at(**{ONE.name: value})) != "") == is_stopped


def test_a_logarithms_interval_is_a_factor_and_a_plain_ones_a_difference():
    """Deviations of 0.1: factors of exp(0.1645), within the range; a plain parameter gets 0.1645 of its unit."""
    (first, *_) = base_parameters(SI, [fitted_at()])
    assert first.interval_low == pytest.approx(ONE.initial * np.exp(-0.1645))
    assert first.interval_high == pytest.approx(ONE.initial * np.exp(0.1645))
    assert first.is_identified
    assert (first.fitted, first.initial, first.minimum, first.maximum) == (
        ONE.initial, ONE.initial, ONE.minimum, ONE.maximum
    )  # fmt: skip
    assert (first.name, first.unit, first.note) == (ONE.name, ONE.unit, ONE.meaning)
    plain = SimpleNamespace(parameters=[dataclasses.replace(ONE, is_log=False)])
    (found,) = base_parameters(plain, [fitted_at()])
    assert found.interval_high - found.fitted == pytest.approx(0.1645)
    assert found.fitted - found.interval_low == pytest.approx(0.1645)
    assert found.is_identified is None


@pytest.mark.parametrize(("deviation", "is_identified"), [(0.42, True), (0.43, False)])
def test_a_parameter_is_identified_where_its_interval_is_less_than_a_factor_of_two(deviation, is_identified):
    """0.7 is the logarithm of 2.01, and 0.4255 deviations of 1.645."""
    fitted = dataclasses.replace(fitted_at(), deviation=np.full(5, deviation))
    assert base_parameters(SI, [fitted])[0].is_identified == is_identified


def test_an_interval_ends_with_the_range():
    value = ONE.minimum * 1.2
    (first, *_) = base_parameters(SI, [dataclasses.replace(fitted_at(**{ONE.name: value}), deviation=np.full(5, 9.0))])
    assert (first.interval_low, first.interval_high) == (ONE.minimum, ONE.maximum)


def test_effects_that_were_not_tested_are_listed_up_to_three():
    titles = [effect.title for effect in LIBRARY]
    assert left_out(LIBRARY, LIBRARY) == ""
    assert left_out(LIBRARY[1:], LIBRARY) == f" Not looked for, as asked: {titles[0]}."
    assert left_out(LIBRARY[3:], LIBRARY) == f" Not looked for, as asked: {', '.join(titles[:3])}."
    assert left_out(LIBRARY[5:], LIBRARY) == f" Not looked for, as asked: {', '.join(titles[:3])} and 2 more."


def said(training=3, held_out=1, *, frequency=0.0, is_static=True, stated=1.0, **changes):
    kind = SimpleNamespace(garment=SimpleNamespace(points_are_material=is_static), is_static=is_static)
    observer = SimpleNamespace(frequency=frequency, resolution=SimpleNamespace(spacing=0.0504), recordings=[kind, kind])
    floor = Floor(mm=2.0, error_mm=0.1, measured_mm=1.0, stated_mm=stated)
    return notes(training, held_out, observer, floor, **({"is_predictable": True} | changes))


@pytest.fixture
def statics(monkeypatch):
    monkeypatch.setattr("fit.gap.findings.has_static", lambda recording: recording.is_static)


@pytest.mark.usefixtures("statics")
def test_notes_say_what_limits_the_figures_and_nothing_else():
    assert len(said()) == 5
    assert "a search of the diagnosis' own" in said()[3]
    assert said()[0] == "Free rollouts, predictable as they are; mesh of 50 mm."
    assert said(is_predictable=False)[0].startswith("Free rollouts, which no pull makes predictable")
    assert said(frequency=1.5, is_predictable=False)[0].startswith("Observer pull of 1.5 Hz; ")
    assert "share of draws" in said()[2]
    assert "masses of the sets" in said(by="evidence")[2]
    (stated,) = said(stated=2.0)[5:]
    assert "off by 2.0 mm" in stated
    assert "measured 1.0 mm" in stated
    (silhouette,) = said(is_static=False)[5:]
    assert "silhouette" in silhouette
    (not_held_out,) = said(held_out=0)[5:]
    assert "No held-out take" in not_held_out
    assert "One or two takes" in said(training=1, held_out=1)[-1]
    assert len(said(training=2, held_out=1)) == 5


@pytest.mark.usefixtures("statics")
def test_every_note_is_shown_whole_and_in_its_order():
    assert said(1, 0, frequency=2.0, is_static=False, stated=2.0, by="evidence") == [
        "Observer pull of 2 Hz; mesh of 50 mm.",
        "Errors are root mean square distances of the tracked points that are not on the held edge. Points on the "
        "held edge tell how the cloth is held and timed.",
        "Probabilities are masses of the sets of effects that hold an effect, weighed on the takes fitted to.",
        "The base model is fitted by a search of the diagnosis' own, so its values may differ from those of a fit. One "
        "of its starts is the best refit with an effect. So another library may end it elsewhere. The intervals of its "
        "parameters cover the takes' noise, the ends of those starts that are as good, and a further end by their "
        "scatter.",
        "The sensor's noise in this diagnosis is a distance in space, measured on the judged takes. The hanger's "
        "noise, which shakes the simulated cloth, is part of it. `hangtime takes show` gives a point's noise in one "
        "coordinate.",
        "The takes state that their points are off by 2.0 mm. The diagnosis measured 1.0 mm, and takes the noise floor "
        "from that.",
        "Points of a silhouette sit constantly a little beside the material, so each point's mean offset was taken "
        "out. Effects that only move the cloth's resting position cannot be seen.",
        "No held-out take: closure is measured on the motion it was fitted to and flatters.",
        "One or two takes: the same cloth, hung anew, may differ from them by more than their noise.",
    ]
    assert said()[2] == (
        "Probabilities follow from the share of draws in which an effect is best and worth naming. A draw chooses "
        "judged half-second blocks and an error of mesh and solver. docs/reference/blind-check.md says how well this "
        "holds on held-out takes. Probabilities rank the library's effects as causes of the gap. The p-values test "
        "each effect, and allow for the number of those tried."
    )
    assert said(held_out=0)[5] == (
        "No held-out take: closure is measured on the motion it was fitted to and flatters. Probabilities flatter too, "
        "because only the p-values allow for the choice among all effects."
    )


def test_the_gap_is_stated_with_the_floors_interval_and_what_the_named_effect_leaves():
    """Three replicas: 2.92 standard errors of 0.08 mm."""
    evidence = evidence_of({"air_drag": 6.0})
    drag = evidence.singles["air_drag"]
    gap = describe_gap(evidence, drag, None)
    assert gap.floor_mm.value == 5.0
    assert gap.floor_mm.interval == pytest.approx((5.0 - 2.92 * 0.08, 5.0 + 2.92 * 0.08))
    assert gap.base_mm.value == pytest.approx(12.0)
    assert gap.with_effect_mm.value == pytest.approx(6.0)
    assert gap.closure.value == pytest.approx((144 - 36) / (144 - 25))
    assert (gap.numerics_mm, gap.is_held_out) == (1.0, True)
    nothing = (gap.edge_mm, gap.edge_with_effect_mm, gap.held_by_edge_mm, gap.closure_held_by_edge)
    assert nothing == (None, None, None, None)
    wide = describe_gap(dataclasses.replace(evidence, floor_error_mm=3.0), None, drag)
    assert wide.floor_mm.interval == (0.0, pytest.approx(13.76))
    assert (wide.with_effect_mm, wide.closure) == (None, None)
    assert wide.held_by_edge_mm.value == pytest.approx(6.0)
    assert wide.closure_held_by_edge.value == pytest.approx(gap.closure.value)


def test_the_error_of_the_edge_is_stated_where_it_was_tracked():
    evidence = evidence_of({"air_drag": 6.0})
    evidence = dataclasses.replace(evidence, base=with_edge(evidence.base, 1e4))
    gap = describe_gap(evidence, with_edge(evidence.singles["air_drag"], 2500), None)
    assert (gap.edge_mm, gap.edge_with_effect_mm) == (pytest.approx(2.0), pytest.approx(1.0))
    assert describe_gap(evidence, evidence.singles["air_drag"], None).edge_with_effect_mm is None


def costing(one, cost):
    residual = np.array([np.sqrt(cost), 0.0, 0.0])
    return dataclasses.replace(one, fitted=dataclasses.replace(one.fitted, residual=residual))


@pytest.fixture
def described(monkeypatch):
    """Describe effects of which a draught moves no point and the hem is at its bound."""
    monkeypatch.setattr("fit.gap.findings.smallest_detectable", lambda evidence: {
        k: np.array([np.inf]) if k == "draught" else np.array([0.3, 0.5, np.inf]) * min(1.0, KINDS[k].high)
        for k in evidence.screened
    })  # fmt: skip
    monkeypatch.setattr("fit.gap.findings.is_at_bound", lambda observer, h, name: name == "hem")

    def go(singles, best=None, joint=(), **changes):
        evidence = evidence_of(singles, joint=joint)
        evidence = dataclasses.replace(
            evidence,
            base=costing(evidence.base, 100.0),
            singles={k: costing(h, 40.0) for k, h in evidence.singles.items()},
        )
        named = evidence.joint[0][0] if joint else evidence.singles.get(best)
        effects = tuple(KINDS[k] for k in evidence.screened)
        return evidence, {one.id: one for one in describe_effects(evidence, named, effects, SI, **changes)}

    return go


def test_refitted_effects_are_listed_by_what_they_close_most_first(described):
    evidence, found = described({"hem": 11.0, "air_drag": 6.0, "draught": 9.0}, "air_drag")
    assert list(found) == ["air_drag", "draught", "hem"]
    drag, draught, hem = found.values()
    assert drag.closure.value == pytest.approx((144 - 36) / (144 - 25))
    assert (drag.amplitude, drag.amplitude_interval) == evidence.amplitude("air_drag")
    assert drag.p_value == evidence.p_value("air_drag") < 0.01
    assert (drag.probability > 0.5) == (hem.probability < 0.5)
    assert drag.minimum_detectable == 0.5
    assert drag.note == "best effect in 100 % of bootstrap draws"
    assert drag.fitted_share == pytest.approx(0.6)
    assert (draught.minimum_detectable, draught.absorbed) == (None, None)
    assert draught.note.startswith("these takes could not have shown the effect")
    assert set(draught.components) == set(KINDS["draught"].components)
    assert (drag.explained, drag.absorbed, drag.correlation) == (0.3, 0.2, 0.4)
    assert (drag.components, drag.unit, drag.tested) == ({}, KINDS["air_drag"].unit, True)
    assert hem.amplitude_interval is None
    assert hem.note == "at its bound, so that its size has no interval; best effect in 0 % of bootstrap draws"


def test_masses_are_stated_instead_of_shares_of_draws(described):
    _, found = described({"hem": 11.0, "air_drag": 6.0}, "air_drag", weighed={"air_drag": 0.7})
    assert (found["air_drag"].probability, found["hem"].probability) == (0.7, 0.0)
    assert (found["air_drag"].p_value, found["air_drag"].note) == (None, "")


def test_effects_that_are_named_together_have_their_sizes_beside_each_other(described):
    evidence, found = described({"air_drag": 9.0}, joint=[(("air_drag", "filter_lag"), 5.2)])
    drag, lag = found["air_drag"], found["filter_lag"]
    pair = evidence.joint[0][0]
    assert drag.amplitude == evidence.amplitude("air_drag", beside=pair)[0]
    assert drag.note == f"size beside {KINDS['filter_lag'].title}; closure alone"
    assert lag.note == f"found beside {KINDS['air_drag'].title} only"
    assert lag.amplitude_interval == evidence.amplitude("filter_lag", beside=pair)[1]
    assert (drag.p_value, lag.p_value, lag.closure, lag.fitted_share) == (None, None, None, None)
    assert drag.closure.value == pytest.approx((144 - 81) / (144 - 25))


def test_an_effect_that_was_only_screened_or_is_in_the_base_model_has_no_closure(monkeypatch, described):
    evidence, _ = described({"air_drag": 6.0, "filter_lag": 7.0})
    alone = dataclasses.replace(evidence, singles={"air_drag": evidence.singles["air_drag"]})
    effects = (KINDS["shear_stiffness"], KINDS["filter_lag"], KINDS["air_drag"])
    drag, *others = describe_effects(alone, None, effects, SI)
    by_name = {one.id: one for one in others}
    lag, shear = by_name["filter_lag"], by_name["shear_stiffness"]
    assert drag.id == "air_drag"
    assert lag.note == (
        "screened only: it explains 30 % of the residual, and was not chosen for a refit; its size is a linear estimate"
    )
    assert (lag.closure, lag.p_value, lag.amplitude_interval, lag.fitted_share) == (None, None, None, None)
    assert (lag.probability, lag.amplitude, lag.tested) == (0.0, 0.0, True)
    assert (shear.tested, shear.amplitude, shear.group) == (False, 0.0, "shear_stiffness")
    assert (shear.unit, lag.unit) == (KINDS["shear_stiffness"].unit, KINDS["filter_lag"].unit)
    assert shear.note == "part of the base model, which fits its shear stiffness"


@pytest.mark.parametrize(
    ("verdict", "proposal", "is_said"),
    [("ambiguous", None, True), ("ambiguous", object(), False), ("unknown", None, False), ("effect", None, False)],
)
def test_named_effects_that_no_motion_would_separate_are_noted(verdict, proposal, is_said):
    expected = (
        "No motion of the menu would separate the named effects by one standard deviation more than these takes do."
    )
    assert unseparated(verdict, proposal) == ([expected] if is_said else [])


@pytest.mark.parametrize(("value", "said"), [(5.9, "range from 2"), (6.0, "range up to 10"), (9.0, "range up to 10")])
def test_the_nearer_end_of_a_range_is_the_one_that_was_reached(value, said):
    assert _reached(SimpleNamespace(minimum=2.0, maximum=10.0, unit="1"), value) == said

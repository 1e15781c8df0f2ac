"""Whole diagnoses by evidence of takes whose truth is known, in a linear world without simulation."""

from __future__ import annotations

import dataclasses
import functools
import re

import numpy as np
import pytest

from fit.gap import diagnosis as steps
from formats.figures import short
from tests.fit.gap.linear_cloth import LinearCloth, World, diagnosed, misses_by, points_of, three_takes
from tests.fit.gap.test_linear_diagnosis import FITTED, HELD_OUT, HEM, finding, gate


@functools.cache
def of_two():
    """Air drag and a hem, and strain stiffening that moves the cloth as air drag does but for 0.4 %."""
    world = World(alike={"strain_stiffening": "air_drag"}, apart=0.004)
    training, held_out = three_takes(world, {"hem": HEM, "air_drag": 1.5})
    weighed = []
    with pytest.MonkeyPatch.context() as patch:
        weigh = steps.weigh
        patch.setattr(steps, "weigh", lambda *given: weighed.append((given[0], weigh(*given))) or weighed[-1][1])
        found = diagnosed(training, held_out, world, by="evidence", added=("anisotropy",))
    return world, held_out[0], found, *weighed[0]


def test_two_effects_are_named_with_their_sizes_and_judged_on_the_held_out_take():
    world, take, found, _, _ = of_two()
    d = found.diagnosis
    assert d.verdict == "several"
    assert "hem" in d.named
    assert finding(d, "hem").amplitude == pytest.approx(HEM, rel=0.05)
    sizes = {name: finding(d, name).amplitude for name in d.named}
    together = misses_by(take, points_of(take, world, found.best.vector, sizes))
    assert d.gap.with_effect_mm.value == pytest.approx(together, rel=1e-3)
    assert together == pytest.approx(HELD_OUT, rel=0.05)
    base = misses_by(take, points_of(take, world, found.base.vector))
    assert d.gap.base_mm.value == pytest.approx(base, rel=1e-6)
    for name in d.named:
        assert short(finding(d, name).amplitude) in d.sentence
    assert d.notes[2].startswith("Probabilities are masses of the sets of effects")
    assert not any("best refit with an effect" in note for note in d.notes)  # the base fit is what it was before


def test_a_probability_is_the_mass_of_every_set_with_the_effect_and_a_twin_stands_beside_the_named_one():
    _, _, found, _, weighed = of_two()
    d = found.diagnosis
    (other,) = set(d.named) - {"hem"}
    (twin,) = {"air_drag", "strain_stiffening"} - {other}
    assert d.alternatives == {other: [twin]}
    shares = weighed.shares()
    assert sum(known + wide for known, wide in shares.values()) == pytest.approx(1.0)
    for name in ("hem", other, twin, "draught"):
        mass = sum(known for subset, (known, _) in shares.items() if name in subset)
        assert finding(d, name).probability == pytest.approx(mass, abs=1e-9)
    assert finding(d, other).probability + finding(d, twin).probability > 0.99
    assert finding(d, other).probability > finding(d, twin).probability > 0.02
    # Both stand for one cause, and the sentence is as sure as of the cause.
    assert re.search(r"each with a probability of (at least|more than) 99 %", d.sentence), d.sentence
    assert all(one.p_value is None for one in d.effects)


def test_all_fits_of_the_search_are_judged_on_the_held_out_take_and_one_that_was_asked_for_too():
    world, take, found, rounds, weighed = of_two()
    d = found.diagnosis
    assert ("anisotropy",) not in weighed.fits
    assert rounds.singles.keys() == {one[0] for one in weighed.fits if len(one) == 1} | {"anisotropy"}
    assert finding(d, "anisotropy").closure is not None
    for hypothesis in [rounds.base, *rounds.singles.values(), *(h for h, _ in rounds.joint)]:
        fitted = hypothesis.fitted
        sizes = {k: fitted.amplitudes[LinearCloth.columns_of(k)] for k in hypothesis.effects}
        left = misses_by(take, points_of(take, world, fitted.vector, sizes))
        assert hypothesis.errors.squared_mm**0.5 == pytest.approx(left, rel=1e-6)
    starts = len(rounds.fits)
    assert f"Of {starts} starts of" in gate(d, "base fit").sentence


def test_collinear_effects_share_the_mass_and_are_ambiguous():
    """Strain stiffening moves this cloth as air drag does but for a ten-thousandth."""
    world = World(alike={"strain_stiffening": "air_drag"}, apart=1e-4)
    training, held_out = three_takes(world, {"air_drag": 1.5})
    d = diagnosed(training, held_out, world, by="evidence").diagnosis
    assert d.verdict == "ambiguous"
    assert set(d.named) == {"air_drag", "strain_stiffening"}
    best, other = (finding(d, name) for name in d.named)
    assert best.probability >= other.probability > 0.2
    assert best.probability + other.probability == pytest.approx(1.0, abs=0.02)
    for one in (best, other):
        assert f"(probability {100 * one.probability:.0f} %)" in d.sentence
    assert d.next_experiment is None
    assert d.notes[-1].startswith("No motion of the menu would separate the named effects")


def test_a_motion_of_no_effect_is_an_unknown_cause():
    world = World()
    training, held_out = three_takes(world, {}, unknown=6e-3)
    d = diagnosed(training, held_out, world, by="evidence").diagnosis
    assert (d.verdict, d.named) == ("unknown", [])
    assert sum(one.probability for one in d.effects) < 0.5
    assert d.gap.closure is None
    assert np.isfinite(d.gap.base_mm.value)


def test_without_a_gap_the_empty_set_has_the_mass_and_without_other_takes_the_sentence_says_so():
    world = World()
    training, _ = three_takes(world, {})
    d = diagnosed(training, [], world, by="evidence").diagnosis
    assert (d.verdict, d.named, d.gap.is_held_out) == ("none", [], False)
    assert sum(one.probability for one in d.effects) < 0.5
    assert d.gap.base_mm.value == pytest.approx(FITTED, rel=0.1)
    assert "on the motion it was fitted to (no held-out take)" in d.sentence


def test_a_base_fit_that_comes_nearer_beside_an_effect_is_what_all_later_steps_are_about(monkeypatch):
    """The base fit that is handed in ended a third of every stiffness away."""
    world, poor = World(), []
    training, held_out = three_takes(world, {"hem": HEM})
    fit_base = steps.fit_base

    def ended_early(*given):
        (best, *_), observer, gate_of_pull = fit_base(*given)
        vector = 1.3 * best.vector
        residual = observer.residuals(vector[None], observer.off[None])[0]
        poor.append(dataclasses.replace(best, vector=vector, residual=residual))
        return list(poor), observer, gate_of_pull

    monkeypatch.setattr(steps, "fit_base", ended_early)
    found = diagnosed(training, held_out, world, by="evidence")
    d = found.diagnosis
    assert (d.verdict, d.named) == ("effect", ["hem"])
    assert found.base.cost < 0.99 * poor[0].cost
    assert [one.fitted for one in d.base_parameters] == found.base.vector.tolist()
    (take,) = held_out
    assert d.gap.base_mm.value == pytest.approx(misses_by(take, points_of(take, world, found.base.vector)), rel=1e-6)
    assert "Of 2 starts" in gate(d, "base fit").sentence
    limit = 100 * (max(1.15, (found.base.cost / found.best.cost) ** 0.5) - 1)
    assert gate(d, "base fit").limit == pytest.approx(limit, rel=1e-3)
    # The finer mesh closes nothing that the new base fit leaves.
    assert gate(d, "mesh and step").figure < 5.0
    assert finding(d, "hem").fitted_share == pytest.approx(1 - found.best.cost / found.base.cost, rel=1e-3)


def test_a_cloth_that_moves_with_an_edge_off_the_hangers_path_is_an_unknown_cause():
    """The whole cloth follows an edge that moves 5 mm beside the hanger's path; no shape of hanging cloth does that."""
    world = World()
    training, held_out = three_takes(world, {}, off=5e-3)
    d = diagnosed(training, held_out, world, by="evidence").diagnosis
    assert (d.verdict, d.named) == ("unknown", [])
    assert "The base model puts the held edge" in d.sentence
    assert "lies between hanger and edge." in d.sentence
    assert d.gap.held_by_edge_mm.value == pytest.approx(HELD_OUT, rel=0.1)

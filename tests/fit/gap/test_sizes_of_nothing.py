"""Effects whose size may be 0: what their refits close, and what is said of it."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest

from fit.api.shown import diagnosis_tables
from fit.api.tables import as_text
from fit.cloth.effect import amplitudes_of
from fit.effects import LIBRARY
from fit.gap import first_round, rounds
from fit.gap.closure import closure
from fit.gap.findings import MAY_BE_NOTHING, NO_SIZE, describe_effects, of_no_size, within_range
from fit.gap.first_round import FirstRound
from fit.gap.fitting import Pinned
from fit.gap.floor import Floor
from fit.gap.hypotheses import Hypothesis, never_worse
from fit.gap.rounds import Rounds
from fit.gap.weighed import weigh
from fit.methods import SI
from tests.fit.gap.linear_cloth import World, diagnosed, three_takes
from tests.fit.gap.linear_takes import MESH, NOISE, LinearTakes
from tests.fit.gap.named_fits import Named
from tests.fit.gap.verdict_scene import EFFECTS, KINDS, NO_EDGE, evidence_of, hypothesis, signature
from tests.fit.report.report_scene import diagnosis


def costing(one, cost):
    return dataclasses.replace(one, fitted=dataclasses.replace(one.fitted, residual=np.array([cost**0.5, 0.0, 0.0])))


def test_a_refit_that_costs_more_than_the_model_in_it_closes_exactly_nothing():
    """As of two demo takes: the hem's size is 0, and its refit costs 17094 where the base fit costs 17057."""
    base, hem = costing(hypothesis((), 18.2), 17057.0), costing(hypothesis(("hem",), 17.9, sizes=0.0), 17094.0)
    screened = {"hem": signature(raw=np.full((1, 3), 7.0))}
    found = never_worse(base, hem, screened)
    assert found.effects == found.fitted.active == ("hem",)
    assert closure(base.errors, found.errors, 4.4) == (0.0, (0.0, 0.0))
    assert found.fitted.vector is base.fitted.vector
    assert not found.fitted.amplitudes.any()
    assert found.fitted.cost == base.fitted.cost
    assert found.fitted.deviation is hem.fitted.deviation
    assert found.fitted.jacobian[:, -1] == pytest.approx(7.0)
    assert never_worse(base, costing(hem, 17057.0), screened).errors is base.errors
    better = costing(hem, 17056.0)
    assert never_worse(base, better, screened) is better
    pinned = Pinned(hem.fitted.amplitudes, np.ones(1), 1.0)
    by_edge = dataclasses.replace(hem, fitted=dataclasses.replace(hem.fitted, pinned=pinned))
    assert never_worse(base, by_edge, screened) is by_edge


def poor(world, search):
    """Refits that end 1.3 times as stiff as they should, so that they cost more than the base fit."""
    base = search.base.fitted

    def fit(observer, tasks):
        vector = 1.3 * base.vector
        residual = world.residuals(vector[None], world.off[None])[0]
        wide = [np.column_stack([base.jacobian, *(world.rows[k].T for k in task.active)]) for task in tasks]
        deviation = [np.full(one.shape[1], 0.1) for one in wide]
        return [
            dataclasses.replace(
                base, vector=vector, active=task.active, residual=residual, jacobian=one, deviation=sd
            )
            for task, one, sd in zip(tasks, wide, deviation, strict=True)
        ]  # fmt: skip

    return fit


def test_refits_of_a_first_round_are_no_worse_than_the_base_fit(monkeypatch):
    world = LinearTakes(3)
    world.missed = world.noisy() + world.moved(1e-3 * MESH)
    search = Rounds(world, world, [world.base()], lambda *_: None, Named())
    monkeypatch.setattr(first_round, "fit", poor(world, search))
    monkeypatch.setattr(first_round, "across_valleys", lambda observer, one: [])
    search.first_round(("hem",), has_gap=False)
    assert search.singles["hem"].errors is search.base.errors
    assert isinstance(search, FirstRound)


def test_by_evidence_an_asked_effect_is_no_worse_than_the_base_fit_either(monkeypatch):
    world = LinearTakes(3)
    world.missed = world.noisy() + world.moved(1e-3 * MESH) - world.rows["air_drag"][0]
    search = Rounds(world, world, [world.base()], lambda *_: None, Named())
    monkeypatch.setattr(first_round, "fit", poor(world, search))
    own = np.sqrt(3) * 1e3 * NOISE
    weigh(search, Floor(own, 0.02, own, own), SimpleNamespace(numerics_mm=MESH), ("draught",))
    assert search.singles["draught"].errors is search.base.errors


@pytest.mark.parametrize(
    ("closes_nothing", "interval", "said"),
    [
        (True, (-1.0, 1.0), NO_SIZE),
        (False, (-1.0, 1.0), MAY_BE_NOTHING),
        (False, (0.0, 1.0), MAY_BE_NOTHING),
        (False, (0.05, 1.0), ""),
        (False, (-1.0, -0.05), ""),
        (False, None, ""),
    ],
)
def test_an_effect_that_may_be_nothing_says_what_its_closure_is(closes_nothing, interval, said):
    assert of_no_size(interval, closes_nothing=closes_nothing) == said


def test_an_effect_of_size_0_closes_nothing_only_where_the_base_fit_took_its_place(monkeypatch):
    """A refit may end with size 0 at a better minimum than the base fit, and closes a part of the gap then."""
    detectable = {"hem": np.array([0.01]), "air_drag": np.array([0.1])}
    monkeypatch.setattr("fit.gap.findings.smallest_detectable", lambda evidence: detectable)
    evidence = evidence_of({"hem": 10.0, "air_drag": 11.0}, sizes=0.0)
    base = costing(evidence.base, 100.0)
    evidence = dataclasses.replace(evidence, base=base)
    evidence.singles["hem"] = dataclasses.replace(evidence.singles["hem"], errors=base.errors)
    drag, hem = describe_effects(evidence, None, (KINDS["hem"], KINDS["air_drag"]), SI)
    assert (drag.id, drag.amplitude, hem.id, hem.amplitude) == ("air_drag", 0.0, "hem", 0.0)
    assert drag.closure.value > 0.1
    assert drag.note.startswith(f"{MAY_BE_NOTHING}; best effect in ")
    assert hem.closure.value == 0.0
    assert hem.note == NO_SIZE  # of a tie with the base fit the draws say nothing


def a_round():
    world = LinearTakes(3)
    world.missed = world.noisy() + world.moved(1e-3 * MESH) - world.rows["air_drag"][0]
    return world, Rounds(world, world, [world.base()], lambda *_: None, Named())


def test_an_effect_of_size_0_has_the_jacobian_of_where_the_base_fit_ended(monkeypatch):
    """Further effects are screened and begun by the fit's residual and its jacobian together."""
    world, search = a_round()
    ended = poor(world, search)

    def fit(observer, tasks):
        return [dataclasses.replace(one, jacobian=2.0 * one.jacobian) for one in ended(observer, tasks)]

    monkeypatch.setattr(first_round, "fit", fit)
    monkeypatch.setattr(first_round, "across_valleys", lambda observer, one: [])
    search.first_round(("hem",), has_gap=False)
    fitted, base = search.singles["hem"].fitted, search.base.fitted
    assert fitted.jacobian == pytest.approx(np.column_stack([base.jacobian, *search.screened["hem"].raw]))


def test_an_effect_first_refitted_beside_another_one_is_no_worse_than_the_base_fit(monkeypatch):
    world, search = a_round()
    search.screened = first_round.screen(world, search.base.fitted, search.tested)
    monkeypatch.setattr(rounds, "fit", poor(world, search))
    monkeypatch.setattr(first_round, "leads", lambda *given: [])
    pair = dataclasses.replace(hypothesis(("hem", "draught"), 5.0).fitted, amplitudes=world.off)
    search._each_alone(Hypothesis(pair.active, pair, search.base.errors), 0.0)
    assert {name: one.errors is search.base.errors for name, one in search.singles.items()} == {
        "hem": True, "draught": True
    }  # fmt: skip


@pytest.mark.parametrize(("cost", "is_kept"), [(30.0, True), (30.1, False)])
def test_several_effects_give_way_to_the_fit_they_started_from_where_that_costs_less(cost, is_kept):
    """Two start from the first one alone, three from two; a pair by another start is compared with that one."""
    search = object.__new__(Rounds)
    drag, hem = (costing(hypothesis((name,), 8.0), 30.0) for name in ("air_drag", "hem"))
    search.singles = {"air_drag": drag}
    search.screened = {"hem": signature(), "draught": signature(raw=np.ones((2, 3)))}
    pair = costing(hypothesis(("air_drag", "hem"), 6.0), cost)
    found = search._no_worse_than_start(pair, costing(hem, 20.0))
    assert (found is pair) == is_kept
    if not is_kept:
        assert (found.effects, found.errors, found.fitted.cost) == (pair.effects, drag.errors, drag.fitted.cost)
        assert found.fitted.amplitudes is drag.fitted.amplitudes
        assert found.fitted.jacobian.shape[1] == pair.fitted.jacobian.shape[1]
    two = costing(pair, 30.0)
    three = costing(hypothesis(("air_drag", "hem", "draught"), 5.0), cost)
    found = search._no_worse_than_start(three, two)
    assert (found is three) == is_kept
    assert is_kept or found.errors is two.errors


def test_a_pair_that_costs_more_than_its_start_is_not_named(monkeypatch):
    search = object.__new__(Rounds)
    search.observer = SimpleNamespace(**EFFECTS, off=amplitudes_of(LIBRARY), layout=NO_EDGE)
    drag, pair = costing(hypothesis(("air_drag",), 8.0), 30.0), costing(hypothesis(("air_drag", "hem"), 5.2), 31.0)
    search.base, search.singles, search.judge = costing(hypothesis((), 12.0), 99.0), {"air_drag": drag}, None
    search.joint, search.instead, search.beside = [], [], {}
    search.screened, search.tested = {"air_drag": signature(), "hem": signature()}, ("air_drag", "hem")
    monkeypatch.setattr(Rounds, "_with_another", lambda self, start, floor, chosen=None: [(pair, 0.001)])
    monkeypatch.setattr(Rounds, "_polished", lambda self, joint: joint)
    search.further_rounds(5.0, 0.1)
    ((found, p_value),) = search.joint
    assert found.errors is drag.errors
    assert p_value >= 0.5


@pytest.mark.parametrize(
    ("name", "interval", "part"),
    [
        ("hem", (-0.002, 0.06), (0.0, 0.05)),
        ("attachment_offset", (-0.01, 0.1), (0.0, 0.05 * 3**0.5)),
        ("attachment_offset", (0.01, 0.02), (0.01, 0.02)),
        ("anisotropy", (-9.0, 9.0), None),
    ],
)
def test_an_interval_of_a_size_ends_with_the_range(name, interval, part):
    """A hem adds mass; an offset has three directions of 50 mm at most."""
    effect = KINDS[name]
    if part is None:
        count = len(effect.components)
        part = (0.0 if count > 1 else effect.low, effect.high * count**0.5)
    assert within_range(effect, interval) == pytest.approx(part)


def test_a_named_effect_whose_interval_holds_0_is_told_without_doubt():
    """As one that the held edge shows, whose size other laws leave open."""
    given = diagnosis()
    drag = msgspec.structs.replace(given.effects[0], amplitude_interval=(-0.1, 2.0))
    told = as_text(diagnosis_tables(diagnosis(effects=[drag]), ("air_drag",)))
    assert "With air_drag at 1.31: closes 87 % of the gap" in told
    assert "Its size may be 0" not in told
    unnamed = as_text(diagnosis_tables(diagnosis(effects=[drag], named=[]), ("air_drag",)))
    assert "Its size may be 0" in unnamed


def test_a_requested_effect_that_is_not_there_is_told_as_what_it_is():
    world = World()
    training, held_out = three_takes(world, {"air_drag": 1.5})
    found = diagnosed(training, held_out, world, added=("draught", "hem")).diagnosis
    assert found.named == ["air_drag"]
    refitted = {one.id: one for one in found.effects if one.fitted_share is not None and found.named != [one.id]}
    nothing = [one for one in refitted.values() if one.amplitude_interval and one.amplitude_interval[0] <= 0.0]
    assert nothing
    told = as_text(diagnosis_tables(found, tuple(one.id for one in nothing)))
    for one in nothing:
        assert one.note.startswith((NO_SIZE, MAY_BE_NOTHING))
        doubt = "No size of it fits" if one.note.startswith(NO_SIZE) else "Its size may be 0, and that the difference"
        (line,) = [line for line in told.splitlines() if line.startswith(f"With {one.id} ")]
        assert doubt in line

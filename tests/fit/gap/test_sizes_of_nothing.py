"""Effects whose size may be 0: what their refits close, and what is said of it."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest

from fit.api.shown import diagnosis_tables
from fit.api.tables import as_text
from fit.gap import first_round
from fit.gap.closure import closure
from fit.gap.findings import MAY_BE_NOTHING, NO_SIZE, of_no_size, within_range
from fit.gap.first_round import FirstRound
from fit.gap.fitting import Pinned
from fit.gap.floor import Floor
from fit.gap.hypotheses import never_worse
from fit.gap.rounds import Rounds
from fit.gap.weighed import weigh
from tests.fit.gap.linear_cloth import World, diagnosed, three_takes
from tests.fit.gap.linear_takes import MESH, NOISE, LinearTakes
from tests.fit.gap.named_fits import Named
from tests.fit.gap.verdict_scene import KINDS, hypothesis
from tests.fit.report.report_scene import diagnosis


def costing(one, cost):
    return dataclasses.replace(one, fitted=dataclasses.replace(one.fitted, residual=np.array([cost**0.5, 0.0, 0.0])))


def test_a_refit_that_costs_more_than_the_model_in_it_closes_exactly_nothing():
    """As of two demo takes: the hem's size is 0, and its refit costs 17094 where the base fit costs 17057."""
    base, hem = costing(hypothesis((), 18.2), 17057.0), costing(hypothesis(("hem",), 17.9, sizes=0.0), 17094.0)
    found = never_worse(base, hem)
    assert found.effects == found.fitted.active == ("hem",)
    assert closure(base.errors, found.errors, 4.4) == (0.0, (0.0, 0.0))
    assert found.fitted.vector is base.fitted.vector
    assert not found.fitted.amplitudes.any()
    assert found.fitted.cost == base.fitted.cost
    assert found.fitted.deviation is hem.fitted.deviation
    assert never_worse(base, costing(hem, 17057.0)).errors is base.errors
    better = costing(hem, 17056.0)
    assert never_worse(base, better) is better
    pinned = Pinned(hem.fitted.amplitudes, np.ones(1), 1.0)
    by_edge = dataclasses.replace(hem, fitted=dataclasses.replace(hem.fitted, pinned=pinned))
    assert never_worse(base, by_edge) is by_edge


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
    ("sizes", "interval", "said"),
    [
        ([0.0, 0.0], (-1.0, 1.0), NO_SIZE),
        ([0.1], (-1.0, 1.0), MAY_BE_NOTHING),
        ([0.1], (0.0, 1.0), MAY_BE_NOTHING),
        ([0.1], (0.05, 1.0), ""),
        ([-0.1], (-1.0, -0.05), ""),
        ([0.1], None, ""),
    ],
)
def test_an_effect_that_may_be_nothing_says_what_its_closure_is(sizes, interval, said):
    assert of_no_size(np.array(sizes), interval) == said


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

"""Steps of the rounds on linear takes of known truth: which fits they ask for, and what they leave out."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from fit.gap.fitting import Task, fit
from fit.gap.hypotheses import judged
from fit.gap.rounds import Rounds
from tests.fit.gap.linear_takes import MESH, NOISE, LinearTakes
from tests.fit.gap.named_fits import Named

OWN = float(np.sqrt(3) * 1e3 * NOISE)  # mm


def searched(**sizes):
    """A search after its first round in takes that hold effects of these sizes, and the fit of all of them."""
    world = LinearTakes(3)
    world.missed = world.noisy() + world.moved(1e-3 * MESH)
    for name, size in sizes.items():
        world.missed = world.missed - size * world.rows[name][0]
    search = Rounds(world, world, [world.base()], lambda *said: None, Named())
    search.first_round(tuple(sizes), has_gap=True)
    return search


def fitted(search, *names):
    """The joint fit of some effects, judged."""
    (found,) = judged(search.judge, fit(search.observer, [Task(search.base.fitted.vector, search.observer.off, names)]))
    return found


def size_of(search, hypothesis, name):
    columns, typical = search.observer.columns[name], search.observer.library[name].typical
    return hypothesis.fitted.amplitudes[columns][0] / typical


def test_a_twin_is_tried_beside_the_effect_that_stays_and_does_not_replace_what_is_there():
    """The takes hold drag and a filter lag, which resembles a time offset."""
    search = searched(air_drag=1.5, filter_lag=2.0)
    pair = fitted(search, "air_drag", "filter_lag")
    assert search._better_of_twins(pair, 1e-6, OWN) is pair
    wrong = fitted(search, "air_drag", "time_offset")
    found = search._better_of_twins(wrong, 1e-6, OWN)
    assert set(found.effects) == {"air_drag", "filter_lag"}
    assert found.errors.squared_mm < wrong.errors.squared_mm
    assert size_of(search, found, "filter_lag") == pytest.approx(2.0, abs=0.1)


@pytest.mark.parametrize(
    ("order", "left"),
    [
        (("hem", "air_drag", "draught"), ("air_drag", "draught")),  # the hem is not there
        (("air_drag", "hem", "draught"), ("air_drag", "draught")),
        (("air_drag", "draught", "hem"), None),  # the last one was just found to be needed
    ],
)
def test_an_idle_earlier_effect_is_dropped_and_never_the_last_one(order, left):
    search = searched(air_drag=1.5, draught=2.0)
    three = fitted(search, *order)
    before = [(three, 0.02)]
    search.joint = list(before)
    search._drop_idle(three, 0.02, 0.1)
    if left is None:
        assert search.joint == before
        return
    ((found, p_value),) = search.joint
    assert (found.effects, p_value) == (left, 0.02)
    assert size_of(search, found, "air_drag") == pytest.approx(1.5, abs=0.1)
    assert size_of(search, found, "hem") == 0.0
    assert found.fitted.cost == pytest.approx(three.fitted.cost, rel=0.01)


def test_a_single_effect_that_is_left_of_several_replaces_nothing():
    """Of drag, a hem and a draught only the last one is there: with one effect left these are no joint hypotheses."""
    search = searched(draught=2.0)
    three = fitted(search, "air_drag", "hem", "draught")
    search.joint = [(three, 0.02)]
    search._drop_idle(three, 0.02, 0.1)
    assert search.joint == [(three, 0.02)]


def test_a_base_fit_that_ends_dearer_than_one_from_an_effects_fit_gives_way_and_their_middle_is_tried(monkeypatch):
    """The given base fit ended at three times each stiffness, which costs more than 15 % of the best."""
    world = LinearTakes(3)
    world.missed = world.noisy() + world.moved(1e-3 * MESH) - 1.5 * world.rows["air_drag"][0]
    best = world.base()
    vector = 3.0 * best.vector
    poor = dataclasses.replace(best, vector=vector, residual=world.residuals(vector[None], world.off[None])[0])
    search = Rounds(world, world, [poor], lambda *said: None, Named())
    begun, recall = {}, search.kept.recall

    def recalled(names, go):
        found = recall(names, go)
        begun.update({name: (go.args[1], found) for name in names if name.startswith("base")})
        return found

    monkeypatch.setattr(search.kept, "recall", recalled)
    search.first_round((), has_gap=True)
    assert list(begun) == ["base-again", "base-between"]
    ((again,), (second,)), ((between,), (third,)) = begun["base-again"], begun["base-between"]
    assert (again.known_cost, again.active, between.active) == (poor.cost, (), ())
    assert not again.amplitudes.any()
    assert not between.amplitudes.any()
    assert again.vector is min((h.fitted for h in search.singles.values()), key=lambda f: f.cost).vector
    assert between.vector == pytest.approx(np.sqrt(poor.vector * second.vector))  # of logarithms
    assert second.cost < poor.cost / 1.15
    assert search.fits == sorted([poor, second, third], key=lambda f: f.cost)
    assert search.base.fitted is search.fits[0]
    assert search.base.errors.squared_mm == pytest.approx(float(world.in_mm(search.fits[0].residual)) ** 2)


def test_a_further_effect_is_one_of_those_that_were_refitted_beside_the_start(monkeypatch):
    """On takes that chose no effect: the p-value of each times their number, at most 1."""
    search = searched(air_drag=1.5, hem=1.0)
    search.judge = LinearTakes(3)
    search.judge.missed = search.observer.missed
    names, recall = [], search.kept.recall
    monkeypatch.setattr(search.kept, "recall", lambda wanted, go: names.extend(wanted) or recall(wanted, go))
    monkeypatch.setattr("fit.gap.rounds.gain_p_value", lambda before, after, floor: 0.01 * floor)
    tried = search._with_another(search.singles["air_drag"], 2.0)
    assert 1 < len(names) < len(search.tested) - 1
    assert [p_value for _, p_value in tried] == pytest.approx([0.02 * len(names)] * len(tried))
    assert tried

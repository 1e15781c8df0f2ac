"""Rounds of a diagnosis and the verdict by masses on linear takes of known truth, without simulation."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from fit.gap import first_round, from_raw
from fit.gap import rounds as module
from fit.gap.fitting import Pinned
from fit.gap.floor import Floor
from fit.gap.rounds import Rounds
from fit.gap.weighed import known_error_mm, weigh
from fit.observer.simulation_error import FREE_DIRECTIONS
from tests.fit.gap.linear_takes import MESH, NOISE, LinearTakes, best_of
from tests.fit.gap.named_fits import Named
from tests.fit.gap.verdict_scene import EFFECTS, hypothesis


@pytest.fixture
def world():
    made = LinearTakes(3)
    made.missed = made.noisy() + made.moved(1e-3 * MESH)
    return made


def rounds_of(world):
    told = []
    return Rounds(world, world, [world.base()], lambda *said: told.append(said), Named()), told


def size_of(world, hypothesis, name):
    return hypothesis.fitted.amplitudes[world.columns[name]][0] / world.library[name].typical


def test_the_first_round_refits_the_effect_that_is_there_to_its_size(world):
    world.missed = world.missed - 1.5 * world.rows["air_drag"][0]
    search, told = rounds_of(world)
    assert set(search.tested) == set(world.library)
    before = search.base.errors.squared_mm
    search.first_round((), has_gap=True)
    assert [share for _, share in told] == [0.32, 0.4, 0.62]
    assert [stage.split()[0] for stage, _ in told] == ["screening", "1", "continuing"]
    assert told[1][0] == "1 refit, each with one effect"
    best = min(search.singles.values(), key=lambda h: h.errors.squared_mm)
    assert best.effects == ("air_drag",)
    assert size_of(world, best, "air_drag") == pytest.approx(1.5, abs=0.1)
    assert best.errors.squared_mm == pytest.approx(3 * (1e3 * NOISE) ** 2 + MESH**2, rel=0.25)
    assert search.base.errors.squared_mm == pytest.approx(before, rel=0.01)
    assert [f.cost for f in search.fits] == sorted(f.cost for f in search.fits)
    assert len(search.fits) >= 2
    assert search.least is min((h.fitted for h in search.singles.values()), key=lambda f: f.cost)


def test_without_a_gap_only_a_requested_effect_is_refitted(world):
    search, _ = rounds_of(world)
    search.first_round((), has_gap=False)
    assert search.singles == {}
    assert set(search.screened) == set(world.library)
    search.first_round(("hem",), has_gap=False)
    assert list(search.singles) == ["hem"]
    assert abs(size_of(world, search.singles["hem"], "hem")) < 0.2


def test_a_requested_effect_is_refitted_beside_the_shortlist_and_once(world):
    world.missed = world.missed - 1.5 * world.rows["air_drag"][0]
    search, _ = rounds_of(world)
    search.first_round(("air_drag", "draught"), has_gap=True)
    assert {"air_drag", "draught"} <= set(search.singles)
    assert all(h.effects == (name,) for name, h in search.singles.items())


def test_a_second_effect_is_found_beside_the_first_and_no_third(world):
    world.missed = world.missed - 1.5 * world.rows["air_drag"][0] - world.rows["hem"][0]
    search, _ = rounds_of(world)
    search.first_round((), has_gap=True)
    search.further_rounds(np.sqrt(3) * 1e3 * NOISE, MESH)
    pairs = [(h, p) for h, p in search.joint if set(h.effects) == {"air_drag", "hem"}]
    assert pairs
    found, p_value = pairs[0]
    assert p_value < 0.01
    assert size_of(world, found, "air_drag") == pytest.approx(1.5, abs=0.1)
    assert size_of(world, found, "hem") == pytest.approx(1.0, abs=0.1)
    assert set(search.beside) >= {search.joint[0][0].effects[0]}
    assert search.named(SimpleNamespace(verdict="several", named=["hem", "air_drag"])) is found
    assert search.named(SimpleNamespace(verdict="effect", named=["hem"])) is search.singles["hem"]
    assert search.named(SimpleNamespace(verdict="none", named=[])) is None


def test_an_effect_is_tried_with_another_under_its_own_name_and_never_with_itself(world, monkeypatch):
    world.missed = world.missed - 1.5 * world.rows["air_drag"][0] - world.rows["hem"][0]
    search, _ = rounds_of(world)
    search.first_round((), has_gap=True)
    names = []
    recall = search.kept.recall
    monkeypatch.setattr(search.kept, "recall", lambda wanted, go: names.extend(wanted) or recall(wanted, go))
    start = search.singles["air_drag"]
    tried = search._with_another(start, 1.0)
    assert all(h.effects[0] == "air_drag" and len(set(h.effects)) == 2 for h, _ in tried)
    assert "air_drag+hem" in names
    assert set(search.beside["air_drag"]) == {n for n in search.tested if n != "air_drag"} - solvers(world)
    del names[:]
    ((twin, _),) = search._with_another(start, 1.0, ("hem", "air_drag"))
    assert twin.effects == ("air_drag", "hem")
    assert names == ["air_drag+hem-as-twin"]
    assert search._with_another(start, 1.0, ("air_drag",)) == []


def solvers(world):
    return {name for name, effect in world.library.items() if effect.differs_by_solver}


def test_the_family_of_a_further_effect_is_what_was_tested(world, monkeypatch):
    """All that was tested where the takes chose it too; else what was refitted; no more than one."""
    search, _ = rounds_of(world)
    monkeypatch.setattr(module, "is_shown_by_edge", lambda *_: False)
    monkeypatch.setattr(module, "gain_p_value", lambda before, after, floor: 0.01 * floor)
    assert search._p_value(search.base, search.base, 3, 1.0) == pytest.approx(0.01 * len(search.tested))
    search.judge = LinearTakes(4)
    assert search._p_value(search.base, search.base, 3, 1.0) == pytest.approx(0.03)
    assert search._p_value(search.base, search.base, 3, 50.0) == 1.0
    monkeypatch.setattr(module, "is_shown_by_edge", lambda *_: True)
    assert search._p_value(search.base, search.base, 3, 50.0) == 0.0


def test_sizes_that_the_held_edge_disputes_are_fitted_again_and_the_others_are_kept(world, monkeypatch):
    """The held edge identifies `filter_lag` at twice its fitted size, and does not identify drag."""
    world.missed = world.missed - 1.5 * world.rows["air_drag"][0] - 0.5 * world.rows["filter_lag"][0]
    search, _ = rounds_of(world)
    search.first_round(("air_drag", "filter_lag"), has_gap=True)
    asked, names = [], []

    def disputed(observer, without, fitted, trust):
        asked.append((fitted.active, trust))
        assert without is search.base.fitted.residual
        if fitted.active != ("filter_lag",):
            return None
        columns, typical = world.columns["filter_lag"], world.library["filter_lag"].typical
        amplitudes, sd = fitted.amplitudes.copy(), np.full(len(world.off), np.inf)
        amplitudes[columns], sd[columns] = 2.0 * typical, 1e-4 * typical
        return Pinned(amplitudes, sd, trust)

    recall = search.kept.recall
    monkeypatch.setattr(search.kept, "recall", lambda wanted, go: names.extend(wanted) or recall(wanted, go))
    monkeypatch.setattr(first_round, "disputed", disputed)
    before = dict(search.singles)
    search.sizes_by_edge(0.4)
    assert list(search.singles) == list(before)
    assert all((search.singles[k] is h) == (k != "filter_lag") for k, h in before.items())
    again = search.singles["filter_lag"]
    assert size_of(world, again, "filter_lag") == pytest.approx(2.0, abs=0.01)
    assert again.errors.squared_mm > before["filter_lag"].errors.squared_mm
    assert names == ["filter_lag-by-edge"]
    judged = int(world.layout.is_judged.sum())
    noise = float((world.layout.sd[world.layout.is_judged] ** 2).mean())
    trust = 1 + judged * (0.4e-3**2 / 3) / (FREE_DIRECTIONS * noise)
    assert [one for _, one in asked] == pytest.approx(np.full(len(before), trust))
    (kept,) = search._by_edge([before["filter_lag"]], 0.4, "-of-pair")
    assert names[-1] == "filter_lag-of-pair-by-edge"
    assert kept.effects == ("filter_lag",)


def test_effects_that_the_edge_leads_to_come_after_the_promising_ones_and_once(world, monkeypatch):
    search, _ = rounds_of(world)
    monkeypatch.setattr(first_round, "leads", lambda observer, screened, residual: ["hem", "draught"])
    assert search._and_leads(["air_drag", "hem"], {}, search.base.fitted) == ["air_drag", "hem", "draught"]


@pytest.mark.parametrize(("measured", "known"), [(3.0, 4.123), (5.0, 1.0), (6.0, 1.0)])
def test_a_floor_above_the_points_own_noise_is_what_the_hanger_shakes(measured, known):
    """Of a floor of 5 mm points of 3 mm leave 4, beside 1 mm of mesh and solver; points of 5 or 6 mm leave none."""
    floor = Floor(mm=5.0, error_mm=0.1, measured_mm=measured, stated_mm=1.0)
    assert known_error_mm(floor, SimpleNamespace(numerics_mm=1.0)) == pytest.approx(known, abs=1e-3)


def test_weighing_refits_what_may_win_and_judges_each_fit_once(world):
    world.missed = world.missed - world.rows["air_drag"][0] - 0.8 * world.rows["hem"][0]
    search, told = rounds_of(world)
    own = np.sqrt(3) * 1e3 * NOISE
    found = weigh(search, Floor(own, 0.02, own, own), SimpleNamespace(numerics_mm=MESH), ())
    assert best_of(found) == ("air_drag", "hem")
    assert set(search.screened) == set(world.library)
    assert set(search.singles) == {one[0] for one in found.fits if len(one) == 1}
    ((several, p_value),) = search.joint
    assert several.fitted is found.fits[("air_drag", "hem")]
    assert p_value == 0.0
    assert search.base.fitted is found.fits[()]
    assert search.fits[0].cost == min(f.cost for f in search.fits)
    assert told
    assert {share for _, share in told} == {0.5}


def test_weighing_goes_on_from_a_better_base_fit_and_keeps_each_fit_under_its_own_name(world, monkeypatch):
    """The given base fit ended a third of each stiffness away; a new fit beside the drag comes nearer."""
    world.missed = world.missed - world.rows["air_drag"][0]
    best = world.base()
    vector = 1.3 * best.vector
    poor = replace(best, vector=vector, residual=world.residuals(vector[None], world.off[None])[0])
    search = Rounds(world, world, [poor], lambda *_: None, Named())
    names, recall = [], search.kept.recall
    monkeypatch.setattr(search.kept, "recall", lambda wanted, go: names.extend(wanted) or recall(wanted, go))
    own = np.sqrt(3) * 1e3 * NOISE
    found = weigh(search, Floor(own, 0.02, own, own), SimpleNamespace(numerics_mm=MESH), ("draught",))
    assert best_of(found) == ("air_drag",)
    assert search.base.fitted is found.fits[()]
    assert search.base.effects == ()
    assert search.base.errors.squared_mm == pytest.approx(float(world.in_mm(found.fits[()].residual)) ** 2)
    assert found.fits[()].cost < poor.cost
    assert search.fits == [found.fits[()], poor]
    assert "weighed-base-1" in names
    assert {"weighed-air_drag-1", "weighed-air_drag-2"} <= set(names)
    assert len(set(names)) == len(names)
    # An effect that was asked for by name is refitted whatever its mass.
    assert ("draught",) not in found.fits
    assert search.singles["draught"].effects == ("draught",)


def test_raw_points_are_judged_by_a_base_model_that_is_fitted_to_them(world, monkeypatch):
    """Raw points of one kind are fitted to, those of another judged; without held-out takes the first ones are both."""
    raw, other = LinearTakes(7), LinearTakes(8)
    for made in (raw, other):
        made.missed = made.noisy() + made.moved(4e-3)
    monkeypatch.setattr(from_raw, "raw_recordings", lambda takes: f"raw {takes}")
    monkeypatch.setattr(world, "of", lambda takes: {"raw train": raw, "raw test": other}[takes], raising=False)
    kept = Named()
    assert from_raw.raw_error_mm(world, world, "train", "test", world.base(), kept) is None
    world.recordings = [replace(r, camera=replace(r.camera, is_placed=True)) for r in world.recordings]
    best = raw.base()
    for held_out, judge in (("test", other), ("", raw)):
        found = from_raw.raw_error_mm(world, world, "train", held_out, world.base(), kept)
        residual = judge.residuals(best.vector[None], judge.off[None])[0]
        assert found == pytest.approx(float(judge.in_mm(residual)), rel=0.02)


@pytest.mark.parametrize(("deviation", "is_kept"), [(0.5, True), (0.7, False)])
def test_a_twin_whose_size_may_be_nothing_takes_no_place_of_an_effect(deviation, is_kept, monkeypatch):
    """The twin beside the lift leaves 5.9 mm, and the offset 5.5; 1.645 x 0.7 sizes are more than its one."""
    search = object.__new__(Rounds)
    search.singles, search.observer = {"air_lift": hypothesis(("air_lift",), 9.0)}, SimpleNamespace(**EFFECTS)
    twin = hypothesis(("air_lift", "clock_drift"), 5.9, deviation=deviation)
    monkeypatch.setattr(Rounds, "_twins", lambda self, replaced, kept: ("clock_drift",))
    monkeypatch.setattr(Rounds, "_with_another", lambda self, start, floor, chosen: [(twin, 0.01)])
    monkeypatch.setattr(Rounds, "_polished", lambda self, joint: joint)
    pair = hypothesis(("time_offset", "air_lift"), 5.5)
    assert search._better_of_twins(pair, 0.001, 5.0) is pair
    assert search.instead == ([twin] if is_kept else [])


@pytest.mark.parametrize(("chosen", "kept"), [(None, {"new": 1}), (("time_offset",), {"old": 1})])
def test_what_resembles_what_beside_an_effect_comes_from_the_screening_of_all_effects(chosen, kept, monkeypatch):
    search = object.__new__(Rounds)
    search.observer, search.screened, search.tested = SimpleNamespace(**EFFECTS), {}, ("time_offset", "hem")
    search.beside = {"air_lift": {"old": 1}}
    monkeypatch.setattr(module, "screen", lambda *given: {"new": 1})
    monkeypatch.setattr(module, "further", lambda screened, most: [])
    monkeypatch.setattr(Rounds, "_and_leads", lambda self, names, screened, before: names)
    monkeypatch.setattr(Rounds, "_refit", lambda self, *given: [])
    assert search._with_another(hypothesis(("air_lift",), 9.0), 5.0, chosen) == []
    assert search.beside == {"air_lift": kept}

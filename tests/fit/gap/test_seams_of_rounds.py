"""What rounds and searches hand on: starts, screenings, p-values and figures of the right model."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import logsumexp

from fit.gap import first_round, next_experiment, rounds
from fit.gap.edge_fit import disputed
from fit.gap.fitting import Pinned
from fit.gap.likelihood import Likelihood
from fit.gap.next_experiment import MENU, MOST_ALIVE, propose
from fit.gap.posterior import SCALES, SIZE_LOG_SD, Linear
from fit.gap.probabilities import probabilities
from fit.gap.rounds import Rounds
from fit.gap.screening import screen
from fit.gap.subsets import CHANCE, SIZES, log_evidence
from tests.fit.gap.linear_takes import MESH, NOISE, LinearTakes
from tests.fit.gap.named_fits import Named
from tests.fit.gap.test_posterior_by_hand import search_of
from tests.fit.gap.verdict_scene import EFFECTS, evidence_of, hypothesis


def world_of(**sizes):
    world = LinearTakes(3)
    world.missed = world.noisy() + world.moved(1e-3 * MESH)
    for name, size in sizes.items():
        world.missed = world.missed - size * world.rows[name][0]
    return world


def scene(*names, mm=8.0):
    """Rounds that know these single effects and nothing else."""
    search = object.__new__(Rounds)
    search.observer = search.judge = SimpleNamespace(**EFFECTS)
    search.base, search.screened, search.tested = hypothesis((), 12.0), {}, ("time_offset", "hem", "air_lift")
    search.singles, search.joint, search.beside = {k: hypothesis((k,), mm) for k in names}, [], {}
    return search


def test_a_better_base_fit_is_judged_on_other_takes_and_screened_against():
    """The given fit ended a third of every stiffness away. From the end of the fit with drag one comes nearer."""
    world, judge = world_of(air_drag=1.5), world_of(air_drag=1.5)
    judge.missed = judge.missed + judge.noisy()
    best = world.base()
    vector = 1.3 * best.vector
    poor = dataclasses.replace(best, vector=vector, residual=world.residuals(vector[None], world.off[None])[0])
    search = Rounds(world, judge, [poor], lambda *said: None, Named())
    search.first_round((), has_gap=True)
    base = search.base.fitted
    assert base is search.fits[0]
    assert base.cost < poor.cost
    residual = judge.residuals(base.vector[None], judge.off[None])[0]
    assert search.base.errors.squared_mm == pytest.approx(float(judge.in_mm(residual)) ** 2)
    again = screen(world, base, search.tested)
    for name, one in search.screened.items():
        assert one.amplitude == pytest.approx(again[name].amplitude), name
        assert one.correlation == pytest.approx(again[name].correlation, rel=1e-3), name


def test_an_effect_that_the_edge_leads_to_is_refitted_beside_the_shortlist(monkeypatch):
    world, asked = world_of(air_drag=1.5), []
    search = Rounds(world, world, [world.base()], lambda *said: None, Named())
    base = search.base.fitted

    def leads(observer, screened, residual):
        asked.append(residual)
        return ["draught"]

    monkeypatch.setattr(first_round, "leads", leads)
    search.first_round((), has_gap=True)
    assert list(search.singles)[-1] == "draught"
    assert asked[0] is base.residual


def test_a_size_that_the_edge_disputes_is_fitted_again_from_the_edges_size(monkeypatch):
    search, asked = scene("time_offset"), []
    search.observer.layout = SimpleNamespace(is_edge=np.ones(3, bool))
    search.kept = Named()
    pinned = Pinned(np.full(50, 0.7), np.ones(50), 2.0)
    monkeypatch.setattr(first_round, "trust_in_edge", lambda observer, numerics: 1.0)
    monkeypatch.setattr(first_round, "disputed", lambda *given: pinned)
    monkeypatch.setattr(first_round, "fit", lambda observer, tasks: asked.extend(tasks) or ["again"])
    monkeypatch.setattr(first_round, "judged", lambda judge, fits: fits)
    assert search._by_edge(list(search.singles.values()), 0.4) == ["again"]
    (task,) = asked
    assert task.amplitudes is pinned.amplitudes
    assert task.pinned is pinned


def test_a_pair_and_what_is_dropped_of_three_know_the_edge_and_the_mesh(monkeypatch):
    search, by_edge, dropped, alone = scene("time_offset"), [], [], []
    search.observer.recordings = []
    pair = hypothesis(("time_offset", "hem"), 6.0)
    three = hypothesis(("time_offset", "hem", "air_lift"), 5.5)
    for name, value in (
        ("_further_starts", lambda self, order: []),
        ("_with_another", lambda self, start, floor: [(three if len(start.effects) == 2 else pair, 0.001)]),
        ("_polished", lambda self, found: found),
        ("_better_of_twins", lambda self, found, p_value, floor: found),
        ("_by_edge", lambda self, found, numerics: by_edge.append((found[0], numerics)) or found),
        ("_p_value", lambda self, before, found, count, floor: 0.002),
        ("_drop_idle", lambda self, found, p_value, numerics: dropped.append((found, p_value, numerics))),
        ("_each_alone", lambda self, found, numerics: alone.append((found, numerics))),
        ("_is_needed", lambda self, *given: True),
    ):
        monkeypatch.setattr(Rounds, name, value)
    search.further_rounds(5.0, 0.7)
    assert by_edge == [(pair, 0.7), (three, 0.7)]
    assert dropped == [(three, 0.002, 0.7)]
    assert alone == [(pair, 0.7)]
    assert search.joint == [(pair, 0.002), (three, 0.002)]


def test_the_p_value_of_a_further_effect_is_against_the_model_before_it(monkeypatch):
    search = scene()
    search.observer.recordings = []
    before, found = hypothesis(("time_offset",), 8.0), hypothesis(("time_offset", "hem"), 6.0)
    asked = []
    monkeypatch.setattr(rounds, "is_shown_by_edge", lambda *given: False)
    monkeypatch.setattr(rounds, "gain_p_value", lambda one, other, floor: asked.append((one, other, floor)) or 0.01)
    search._p_value(before, found, 2, 5.0)
    ((one, other, floor),) = asked
    assert one is before.errors
    assert other is found.errors
    assert floor == 5.0


@pytest.mark.parametrize("is_refuted", [False, True])
def test_further_effects_are_refitted_and_tested_from_their_start_unless_the_edge_refutes_them(monkeypatch, is_refuted):
    search, start, asked = scene("time_offset"), hypothesis(("time_offset",), 8.0), {}
    search.kept, search.screened = Named(), {"old": 1}
    joint = hypothesis(("time_offset", "hem"), 6.0)

    def screened(observer, fitted, left, known):
        asked["screened"] = fitted, left, known
        return {"new": 1}

    def refits(observer, fitted, given, names):
        asked["refits"] = fitted, given, names

    monkeypatch.setattr(rounds, "screen", screened)
    monkeypatch.setattr(rounds, "further", lambda given, most: ["hem"])
    monkeypatch.setattr(Rounds, "_and_leads", lambda self, names, given, before: names)
    monkeypatch.setattr(first_round, "refits", refits)
    monkeypatch.setattr(first_round, "fit", lambda observer, tasks: [joint.fitted])
    monkeypatch.setattr(first_round, "judged", lambda judge, fits: [joint])
    monkeypatch.setattr(rounds, "is_refuted_by_edge", lambda base, before, found: (
        is_refuted and base is search.base and before is start and found is joint))  # fmt: skip
    monkeypatch.setattr(Rounds, "_p_value", lambda self, before, found, count, floor: (before is start, count, floor))
    found = search._with_another(start, 5.0)
    assert found == ([] if is_refuted else [(joint, (True, 1, 5.0))])
    assert asked["screened"] == (start.fitted, ("hem", "air_lift"), {"old": 1})
    fitted, given, names = asked["refits"]
    assert fitted is start.fitted
    assert (given, names) == ({"new": 1}, ["hem"])


def test_the_best_fit_within_its_range_is_a_further_start():
    """The offset leaves least on held-out takes; drag at its bound fits best, the hem nearly as well."""

    def costing(one, cost):
        return dataclasses.replace(one, fitted=dataclasses.replace(one.fitted, residual=np.array([cost**0.5])))

    search = scene()
    search.base = costing(search.base, 100.0)
    offset = costing(hypothesis(("time_offset",), 6.0), 90.0)
    hem, drag = costing(hypothesis(("hem",), 11.0), 50.0), costing(hypothesis(("air_drag",), 11.0, sizes=2.5), 40.0)
    assert search._further_starts([offset, hem, drag]) == [hem]


def test_of_twins_that_stand_in_a_pair_each_has_the_limit_of_its_own_law():
    """Beside an offset the drift leaves 40 mm^2, more than an exact law; erosion leaves 39, within its law's 75."""
    evidence = evidence_of({"time_offset": 9.0})
    drift, erosion = (hypothesis(("time_offset", k), mm) for k, mm in (("clock_drift", 40**0.5),
                                                                       ("eroded_outline", 39**0.5)))  # fmt: skip
    evidence = dataclasses.replace(evidence, joint=[(drift, 0.001)], instead=[erosion])
    assert evidence.alternatives(drift) == {"clock_drift": {"eroded_outline": erosion}}
    gap = np.array(evidence.gap_mm2)
    assert evidence.most_by_law(drift, gap) < 39.0 < 40.0 < evidence.most_by_law(erosion, gap)
    likely = probabilities(evidence, drift)
    assert likely["eroded_outline"] > 0.5
    assert likely.get("clock_drift", 0.0) < 0.2


def proposed(monkeypatch, count, gains, effects=None):
    """The proposal for so many explanations, whose distances grow from nothing to these in two motions."""
    world, asked = world_of(), {}
    numbers = len(world.layout.block)
    names = list(world.library)[:count]
    alive = [hypothesis(effects or (name,), 6.0) for name in names]
    base = dataclasses.replace(world.base(), jacobian=np.zeros((numbers, 5)), residual=np.zeros(numbers))
    monkeypatch.setattr(next_experiment, "MENU", MENU[:2])
    monkeypatch.setattr(next_experiment, "imagine", lambda like, motion: (like, motion.id))

    def followed(observer, recordings, fitted):
        asked["imagined"] = recordings
        return ["followed"]

    def imagined(observer, recordings, fitted, given):
        asked["followed"], asked["alive"] = recordings, given
        return [
            (np.zeros((5, 5)), [size * row for size, row in zip(one[: len(given)], np.eye(5), strict=False)])
            for one in gains
        ]

    monkeypatch.setattr(next_experiment, "followed", followed)
    monkeypatch.setattr(next_experiment, "_imagined", imagined)
    monkeypatch.setattr(next_experiment, "_changes", lambda observer, fitted, rows: [np.zeros(numbers)] * len(rows))
    return propose(world, base, alive, [0.3] * count), asked, world, names


def test_the_motion_with_the_largest_sum_of_gains_over_all_pairs_is_proposed(monkeypatch):
    """Sizes of (4, 4, 0): three pairs grow by 4, 4 and 4; of (5, 0, 0) by 5, 5 and none."""
    found, asked, world, names = proposed(monkeypatch, 3, [np.array([5.0, 0.0, 0.0]), np.array([4.0, 4.0, 0.0])])
    assert found.id == MENU[1].id
    assert found.sigmas_next == pytest.approx(4.0)
    assert found.separates == names[:2]
    assert asked["followed"] == ["followed"]
    assert asked["imagined"] == [(world.recordings[0], motion.id) for motion in MENU[:2]]


def test_four_explanations_at_most_are_compared_and_each_is_named_by_its_last_effect(monkeypatch):
    sizes = [np.array([0.0, 0.0, 0.0, 0.0, 9.0]), np.array([3.0, 0.0, 0.0, 0.0, 0.0])]
    found, asked, _, names = proposed(monkeypatch, 5, sizes)
    assert len(asked["alive"]) == MOST_ALIVE
    assert found.id == MENU[1].id
    assert found.separates[0] == names[0]
    found, *_ = proposed(monkeypatch, 1, [sizes[1]] * 2, effects=("time_offset", "hem"))
    assert found.separates == ["hem"]


def test_an_effect_of_one_exact_law_may_leave_a_twentieth_of_its_own_motion_too():
    """A time offset's law is exact; the middle still holds sqrt(0.05) / 3 of what the offset moves."""
    world = world_of(time_offset=3.0)
    noise = [np.full(r.points.shape[1], NOISE) for r in world.recordings]
    likelihood = Likelihood(world, noise, world.base().residual, SCALES)
    linear = Linear(world, likelihood, world.base(), dict(world.rows))
    assert world.library["time_offset"].law_spread == 0.0
    evidence = log_evidence(linear.reduced, linear.columns, [("time_offset",)])[0]
    n, best = linear.columns.effects.index("time_offset"), int(evidence.argmax())
    size = linear.reduced.pull[best][n] / (linear.reduced.normal[best][n, n] + SIZES**-2)
    middle = np.hypot(MESH, np.sqrt(0.05) / 3 * abs(size) * linear.motion[n])
    assert middle > 1.5 * MESH
    weight = np.exp(-0.5 * (np.log(1e3 * SCALES / middle) / SIZE_LOG_SD) ** 2)
    expected = logsumexp(evidence, b=weight / weight.sum()) + np.log(CHANCE)
    assert linear.masses([("time_offset",)], MESH).known[0] == pytest.approx(expected)


@pytest.mark.parametrize(("cost", "then"), [(55.0, "better base"), (65.0, "e2")])
def test_refuted_sets_add_up_and_a_better_fit_brings_its_own_signatures(monkeypatch, cost, then):
    """e0 and then e1 are refuted about the base fit; e2 holds, and the base model is refitted from its end."""
    costs, known, about, metrics = {"e0": 80.0, "e1": 70.0, "e2": 60.0}, [], [], []
    linear = SimpleNamespace(masses=lambda among, known_mm: None, twins=set)
    monkeypatch.setattr("fit.gap.posterior.Likelihood", lambda *given: metrics.append(given[2]))
    monkeypatch.setattr("fit.gap.posterior.Linear", lambda observer, likelihood, fitted, rows: (
        about.append((fitted.name, dict(rows))) or linear))  # fmt: skip
    monkeypatch.setattr("fit.gap.posterior._wanted", lambda found, turn: [(f"e{turn}",)])

    def refit(wanted, tasks):
        return [SimpleNamespace(cost=costs[one], name=one, residual=f"of {one}") for (one,) in wanted]

    search = search_of(noise=[], rows={"hem": "base", "draught": "base"}, known_mm=0.5, refit=refit,
                       renew=lambda fitted: {"hem": fitted.name})  # fmt: skip
    search.about.residual, search.about.name = "of base", "base"
    better = SimpleNamespace(cost=cost, name="better base", residual="of better base")
    search._allowed, search._tasks = (lambda one: []), lambda *given: []
    search._possible = lambda mass: known.append([name for (name,) in search.refuted])
    search._refutes = lambda linear, fitted: fitted.name in {"e0", "e1"}

    def polished(best, again):
        search.found.fits[()] = better
        return search.found.fits[best]

    search._polished = polished
    search.go()
    assert known == [[], ["e0"], ["e0", "e1"], []]
    assert [name for name, _ in about] == ["base", "base", "base", then]
    assert metrics == ["of base"] * 3 + [f"of {then}"]
    assert about[-1][1] == {"hem": then, "draught": "base"}
    assert about[0][1] == {"hem": "base", "draught": "base"}


def test_what_the_held_edge_shows_is_no_error_of_mesh_and_solver():
    """An offset that moves the cloth as little as they may, and the held edge by three deviations of every number."""
    world = LinearTakes(3)
    on_edge = world.layout.is_edge
    swings = 3.0 * np.sin(np.arange(len(on_edge)) / 7.0)
    world.rows["time_offset"] = np.where(on_edge, swings, 0.05 * world.rows["time_offset"])
    world.missed = world.noisy() - world.rows["time_offset"][0]
    noise = [np.full(r.points.shape[1], NOISE) for r in world.recordings]
    likelihood = Likelihood(world, noise, world.base().residual, SCALES)
    linear = Linear(world, likelihood, world.base(), dict(world.rows))
    nothing, offset, drag = linear.masses([(), ("time_offset",), ("air_drag",)], MESH).known
    assert offset - nothing > 100.0
    assert drag < nothing


@pytest.mark.parametrize(("truth", "kept"), [(-0.5, 0.0), (0.5, 0.5), (12.0, 10.0)])
def test_the_edges_size_is_kept_within_the_effects_range(truth, kept):
    """A lag is not negative and at most ten typical sizes, whatever the held edge alone would say."""
    world = LinearTakes(3)
    on_edge = world.layout.is_edge
    row = np.where(on_edge, 10.0 * np.sin(np.arange(len(on_edge)) / 7.0), world.rows["filter_lag"][0])
    world.rows["filter_lag"] = row[None]
    world.missed = world.noisy() - truth * row
    amplitudes = world.off
    columns, typical = world.columns["filter_lag"], world.library["filter_lag"].typical
    amplitudes[columns] = 5.0 * typical
    base = world.base()
    fitted = dataclasses.replace(
        base, active=("filter_lag",), amplitudes=amplitudes, jacobian=np.column_stack([base.jacobian, row]),
        residual=world.residuals(base.vector[None], amplitudes[None])[0],
    )  # fmt: skip
    pinned = disputed(world, base.residual, fitted, 1.0)
    assert pinned.amplitudes[columns] / typical == pytest.approx(kept, abs=0.02)


@pytest.mark.parametrize(("cost", "is_refuted"), [(80.0, True), (50.0, True), (40.0, False)])
def test_a_refit_must_save_cost_against_the_fit_that_predicted_it(cost, is_refuted):
    """The base fit costs 100, the fit about which the model is linear 50."""
    search = search_of(about=SimpleNamespace(cost=50.0))
    refit = SimpleNamespace(cost=cost, active=("a",), amplitudes=np.ones(3))
    linear = SimpleNamespace(sizes=lambda active: {"a": 1.0})
    assert search._refutes(linear, refit) == is_refuted

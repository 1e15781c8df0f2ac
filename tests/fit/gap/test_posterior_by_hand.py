"""Parts of the posterior over subsets: projections, masses, starts and choices, each against a closed form."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import logsumexp

from fit.gap.fitting import PRIOR_LOG, Problem
from fit.gap.likelihood import Likelihood
from fit.gap.posterior import (
    JOINT_STARTS,
    LEAST_KEPT,
    REFITTED_WITHIN,
    SCALES,
    SIZE_LOG_SD,
    UNKNOWN,
    WIDEST_UNKNOWN,
    Found,
    Linear,
    Mass,
    Search,
    _wanted,
)
from fit.gap.subsets import CHANCE, SIZES, log_evidence
from tests.fit.gap.linear_takes import MESH, NOISE, LinearTakes, best_of


@pytest.fixture(scope="module")
def world():
    made = LinearTakes(3)
    made.missed = made.noisy() - 1.2 * made.rows["air_drag"][0]
    return made


@pytest.fixture(scope="module")
def likelihood(world):
    noise = [np.full(r.points.shape[1], NOISE) for r in world.recordings]
    return Likelihood(world, noise, world.base().residual, SCALES)


@pytest.fixture(scope="module")
def linear(world, likelihood):
    return Linear(world, likelihood, world.base(), dict(world.rows))


@pytest.fixture(scope="module")
def beside_drag(world, likelihood):
    """The model about a fit that holds 0.7 typical sizes of drag."""
    base, columns = world.base(), world.columns["air_drag"]
    amplitudes = world.off
    amplitudes[columns] = 0.7 * world.library["air_drag"].typical
    fitted = dataclasses.replace(
        base, active=("air_drag",), amplitudes=amplitudes, residual=world.residuals(base.vector[None], amplitudes)[0],
        jacobian=np.column_stack([base.jacobian, world.rows["air_drag"][0]]),
    )  # fmt: skip
    rows = {name: own for name, own in world.rows.items() if name != "air_drag"}
    return Linear(world, likelihood, fitted, rows)


def test_motion_that_parameters_imitate_within_their_priors_is_no_signature(world, linear):
    """Ridge regression is least squares with one row more for each parameter: its prior of e^1.5."""
    jacobian = linear.jacobian
    longer = np.vstack([jacobian, np.eye(jacobian.shape[1]) / PRIOR_LOG])
    for row, seen in zip(linear.signatures, linear.seen, strict=True):
        wanted = np.append(row, np.zeros(jacobian.shape[1]))
        size = np.linalg.lstsq(longer, wanted, rcond=None)[0]
        assert seen == pytest.approx(row - jacobian @ size, abs=1e-9)
    assert linear.precision == pytest.approx(np.full(jacobian.shape[1], PRIOR_LOG**-2))
    assert linear.motion == pytest.approx([float(world.in_mm(row)) for row in linear.seen])
    assert linear.offset == pytest.approx(np.log(world.base().vector / world.parameterisation.initial))


def test_effects_of_a_fit_are_taken_out_of_its_residual_and_may_go_to_nothing(world, beside_drag):
    """The linear model's residual is that at no amplitude, whatever the fit held."""
    base = world.base()
    assert beside_drag.residual == pytest.approx(world.residuals(base.vector[None], world.off)[0], abs=1e-9)
    assert beside_drag.rows["air_drag"] == pytest.approx(world.rows["air_drag"])
    assert beside_drag.jacobian.shape == base.jacobian.shape
    n = beside_drag.columns.effects.index("air_drag")
    effect = world.library["air_drag"]
    assert beside_drag.columns.low[n] == effect.low / effect.typical
    assert beside_drag.columns.high[n] == effect.high / effect.typical


def test_the_parameters_of_the_linearisation_do_not_change_the_masses(linear, beside_drag, world):
    among = [(), ("air_drag",), ("hem",), ("air_drag", "hem")]
    one, other = (found.masses(among, MESH) for found in (linear, beside_drag))
    assert other.known - other.known[0] == pytest.approx(one.known - one.known[0], abs=1e-6)


def test_an_effect_that_moves_no_point_is_in_no_subset(world, likelihood):
    rows = dict(world.rows) | {"hem": np.zeros_like(world.rows["hem"])}
    assert "hem" not in Linear(world, likelihood, world.base(), rows).columns.effects


def test_masses_are_sums_over_the_discrepancys_size_with_its_two_priors(linear):
    """Without an effect the middle is what mesh and solver make; the wide prior is flat from there to thirty times."""
    mass = linear.masses([()], MESH)
    evidence = log_evidence(linear.reduced, linear.columns, [()])[0]
    mm = 1e3 * SCALES
    normal = np.exp(-0.5 * (np.log(mm / MESH) / SIZE_LOG_SD) ** 2)
    assert mass.known[0] == pytest.approx(logsumexp(evidence, b=normal / normal.sum()))
    flat = (mm >= MESH) & (mm <= WIDEST_UNKNOWN * MESH)
    assert mass.wide[0] == pytest.approx(logsumexp(evidence[flat]) - np.log(flat.sum()) + np.log(UNKNOWN))
    assert mass.sharp[0] == evidence[np.abs(np.log(mm / MESH)).argmin()]
    assert mass.total[0] == pytest.approx(logsumexp([mass.known[0], mass.wide[0]]))


def test_each_subset_has_the_mass_that_it_has_alone(linear):
    """With drag the middle is higher than without, and so are the sizes that the wide prior is flat over."""
    among = [(), ("air_drag",), ("air_drag", "hem")]
    together = linear.masses(among, MESH)
    for n, subset in enumerate(among):
        alone = linear.masses([subset], MESH)
        for name in ("known", "wide", "sharp"):
            assert getattr(together, name)[n] == pytest.approx(getattr(alone, name)[0]), (subset, name)


def test_an_effects_law_widens_what_it_may_leave(linear, world):
    """The middle holds a share of the effect's own motion: its law's spread, or sqrt(0.05) / 3 where that is more."""
    mass = linear.masses([("air_drag",)], MESH)
    evidence = log_evidence(linear.reduced, linear.columns, [("air_drag",)])[0]
    n, best = linear.columns.effects.index("air_drag"), int(evidence.argmax())
    normal, pull = linear.reduced.normal[best][n, n] + SIZES**-2, linear.reduced.pull[best][n]
    law = max(world.library["air_drag"].law_spread, np.sqrt(0.05) / 3)
    middle = np.hypot(MESH, law * abs(pull / normal) * linear.motion[n])
    assert middle > 1.05 * MESH
    weight = np.exp(-0.5 * (np.log(1e3 * SCALES / middle) / SIZE_LOG_SD) ** 2)
    assert mass.known[0] == pytest.approx(logsumexp(evidence, b=weight / weight.sum()) + np.log(CHANCE))
    flat = (middle <= 1e3 * SCALES) & (WIDEST_UNKNOWN * middle >= 1e3 * SCALES)
    wide = logsumexp(evidence[flat]) - np.log(flat.sum()) + np.log(CHANCE) + np.log(UNKNOWN)
    assert mass.wide[0] == pytest.approx(wide)


def test_a_size_is_found_within_its_range_and_in_its_own_unit(linear, world):
    typical = world.library["air_drag"].typical
    assert linear.sizes(("air_drag",))["air_drag"] / typical == pytest.approx(1.2, abs=0.1)
    one_sided = linear.columns.effects.index("air_drag")
    linear.columns.high[one_sided], kept = 0.5, linear.columns.high[one_sided]
    try:
        assert linear.sizes(("air_drag",))["air_drag"] / typical == pytest.approx(0.5)
    finally:
        linear.columns.high[one_sided] = kept


def test_refits_start_on_the_line_to_the_joint_solution(linear, world):
    """Parameters follow each share of the amplitudes by least squares; the order of the names does not matter."""
    subset = ("hem", "air_drag")
    vectors, amplitudes = linear.starts(subset)
    assert len(vectors) == len(JOINT_STARTS)
    drag, hem = (amplitudes[:, world.columns[name]][:, 0] for name in ("air_drag", "hem"))
    assert drag / drag[-1] == pytest.approx(JOINT_STARTS)
    assert drag[-1] / world.library["air_drag"].typical == pytest.approx(1.2, abs=0.1)
    assert abs(hem[-1]) / world.library["hem"].typical < 0.2
    jacobian = linear.jacobian
    for vector, share in zip(vectors, JOINT_STARTS, strict=True):
        at = [linear.columns.effects.index(name) for name in ("air_drag", "hem")]
        size = share * np.array([drag[-1], hem[-1]]) / [world.library[name].typical for name in ("air_drag", "hem")]
        left = linear.residual + size @ linear.signatures[at]
        longer = np.vstack([jacobian, np.eye(jacobian.shape[1]) / PRIOR_LOG])
        step = -np.linalg.lstsq(longer, np.append(left, np.zeros(jacobian.shape[1])), rcond=None)[0]
        expected = linear.fitted.vector * np.exp(np.clip(step, -1, 1))
        space = Problem(world).space
        assert vector == pytest.approx(np.clip(expected, space.minimum, space.maximum), rel=1e-6)
    joint = linear.joint(subset)
    assert joint.shape[1] == jacobian.shape[1] + len(world.rows["hem"]) + 1
    assert joint[:, -1] == pytest.approx(world.rows["air_drag"][0])


def test_a_set_is_refitted_from_its_cheapest_start_along_one_chord_and_roughly(linear, world):
    """Drag is there at 1.2 sizes, so its whole linear solution costs least; a limit of six steps, no new Jacobian."""
    search, _ = world.search()
    wanted = [("air_drag",), ("air_drag", "hem")]
    for task, subset in zip(search._tasks(linear, wanted), wanted, strict=True):
        vectors, amplitudes = linear.starts(subset)
        costs = (world.residuals(vectors, amplitudes) ** 2).sum(1)
        assert costs.argmin() == len(JOINT_STARTS) - 1
        assert task.vector == pytest.approx(vectors[-1])
        assert task.amplitudes == pytest.approx(amplitudes[-1])
        assert task.jacobian == pytest.approx(linear.joint(subset))
        assert (task.active, task.iterations, task.renewals, task.is_rough) == (subset, 6, 0, True)


def mass_of(**by_name):
    """Made-up log masses, {names joined by _and_: (known, wide, sharp)}; `none` is no effect."""
    among = [() if name == "none" else tuple(name.split("_and_")) for name in by_name]
    return Mass(among, *(np.array([v[k] for v in by_name.values()], float) for k in range(3)))


def test_shares_add_up_to_one_and_the_best_is_a_subset_that_was_fitted():
    mass = mass_of(none=(np.log(1), np.log(2), 0), a=(np.log(3), np.log(1), 0), b=(np.log(8), np.log(1), 0))
    found = Found({(): None, ("a",): None}, mass)
    assert found.shares()[("a",)] == pytest.approx((3 / 16, 1 / 16))
    assert sum(sum(pair) for pair in found.shares().values()) == pytest.approx(1.0)
    assert best_of(found) == ("a",)
    assert best_of(Found({(): None, ("c",): None}, mass)) == ()


FAR = -1e3


def test_a_set_that_may_win_is_refitted_one_effect_more_a_turn():
    near, far = -REFITTED_WITHIN + 0.1, -REFITTED_WITHIN - 0.1
    mass = mass_of(
        none=(0, FAR, 0), a=(near, FAR, 0), b=(far, FAR, 0), a_and_c=(-0.5, FAR, 0), a_and_c_and_d=(-1, FAR, 0)
    )
    pair, triple = ("a", "c"), ("a", "c", "d")
    assert _wanted(Found({(): None}, mass), 0) == [("a",)]
    assert _wanted(Found({(): None}, mass), 1) == [pair, ("a",)]
    assert _wanted(Found({(): None, pair: None}, mass), 2) == [triple, ("a",)]
    assert _wanted(Found(dict.fromkeys([(), pair, triple, ("a",)]), mass), 3) == []


def test_of_more_sets_that_may_win_the_likeliest_twelve_are_refitted():
    names = "abcdefghijklmn"
    mass = mass_of(none=(-5, FAR, 0), **{name: (-0.1 * n, FAR, 0) for n, name in enumerate(names)})
    assert _wanted(Found({(): None}, mass), 0) == [(name,) for name in names[:12]]


def test_where_only_larger_subsets_may_win_the_first_three_are_refitted():
    mass = mass_of(none=(-9, FAR, 0), **{f"a_and_{k}": (-0.1 * n, FAR, 0) for n, k in enumerate("bcdef")})
    assert _wanted(Found({(): None}, mass), 0) == [("a", "b"), ("a", "c"), ("a", "d")]


def test_beside_an_unknown_cause_three_single_effects_are_refitted_that_explain_most():
    sharp = {"a": 1, "b": 5, "c": 3, "d": 4}
    mass = mass_of(none=(-1, 0, 9), a_and_b=(FAR, FAR, 8), **{k: (FAR, FAR, v) for k, v in sharp.items()})
    assert _wanted(Found({(): None}, mass), 0) == [("b",), ("d",), ("c",)]
    assert _wanted(Found({(): None}, mass), 1) == []
    known = mass_of(none=(0, -1, 9), **{k: (FAR, FAR, v) for k, v in sharp.items()})
    assert _wanted(Found({(): None}, known), 0) == []


def search_of(**given):
    """A search with its base fit costing 100, of which nothing else is filled in."""
    search = object.__new__(Search)
    columns = {"a": slice(0, 1), "b": slice(1, 3)}
    search.observer = SimpleNamespace(columns=columns, library={k: SimpleNamespace(name=k, brings=()) for k in "ab"})
    search.about = SimpleNamespace(cost=100.0)
    search.refuted, search.found = [], Found({(): search.about})
    for name, value in given.items():
        setattr(search, name, value)
    return search


def test_a_search_refits_once_for_each_effect_that_a_set_may_have_and_weighs_all_sets_after_the_last(monkeypatch):
    """Three refits and four sums of masses; the base model is refitted from the end of the first refit only."""
    weighed, refitted, polished = [], [], []
    linear = SimpleNamespace(masses=lambda among, known: weighed.append(known) or f"{len(weighed)}", twins=set)
    monkeypatch.setattr("fit.gap.posterior.Likelihood", lambda *given: None)
    monkeypatch.setattr("fit.gap.posterior.Linear", lambda *given: linear)
    monkeypatch.setattr("fit.gap.posterior._wanted", lambda found, turn: [(f"e{turn}",)])

    def refit(wanted, tasks):
        refitted.extend(wanted)
        return [SimpleNamespace(cost=90.0 - len(refitted), residual=None) for _ in wanted]

    search = search_of(noise=[], rows={}, known_mm=0.5, refit=refit, renew=lambda fitted: {})
    search.about.residual = None
    search._allowed, search._possible, search._tasks = (lambda one: []), (lambda mass: mass), lambda *given: []
    search._refutes = lambda *given: False
    search._polished = lambda best, again: polished.append(again) or search.found.fits[best]
    told = []
    assert search.go(told.append).mass == "4"
    assert refitted == [("e0",), ("e1",), ("e2",)]
    assert weighed == [0.5] * 4
    assert polished == [True, False, False]
    assert told == ["1 refit, each with a set of effects"] * 3


@pytest.mark.parametrize(
    ("cost", "kept", "is_refuted"),
    [
        (99.81, (2.0, 2.0), True),  # within two thousandths of the cost
        (99.79, (2.0, 2.0), False),
        (50.0, (2.0, 4 * LEAST_KEPT + 0.01), False),  # of a promised 4 a quarter must be kept
        (50.0, (2.0, 4 * LEAST_KEPT - 0.01), True),
        (50.0, (-2.0, 2.0), False),
        (50.0, (0.4, 2.0), True),
    ],
)
def test_a_refit_that_keeps_nothing_of_its_promise_is_refuted(cost, kept, is_refuted):
    """Of two components the larger one counts, of either sign."""
    promising = SimpleNamespace(sizes=lambda subset: {"a": 2.0, "b": 4.0})
    fitted = SimpleNamespace(cost=cost, active=("a", "b"), amplitudes=np.array([kept[0], 0.1, -kept[1]]))
    assert search_of()._refutes(promising, fitted) == is_refuted


def test_subsets_of_refuted_ones_are_impossible_unless_they_were_fitted_well(monkeypatch):
    monkeypatch.setattr("fit.gap.posterior.is_brought", lambda observer, fitted, name: fitted.brought == name)
    ok, brings = SimpleNamespace(brought=None), SimpleNamespace(brought="b")
    mass = mass_of(none=(0, 0, 0), a=(0, 0, 0), b=(0, 0, 0), a_and_b=(0, 0, 0), a_and_c=(0, 0, 0), d_and_b=(0, 0, 0))
    fits = {("a",): ok, ("a", "b"): ok, ("d", "b"): brings, ("b",): ok}
    search = search_of(refuted=[("a",)], found=Found(fits))
    found = search._possible(mass)
    possible = {
        one for one, *logs in zip(found.among, found.known, found.wide, found.sharp, strict=True) if not any(logs)
    }
    assert possible == {(), ("b",), ("a", "b")}
    lost = np.array([one not in possible for one in found.among])
    assert (np.stack([found.known, found.wide, found.sharp])[:, lost] == -np.inf).all()


def test_twins_and_effects_that_solvers_make_are_never_beside_others():
    library = {k: SimpleNamespace(differs_by_solver=k == "d") for k in "abcd"}
    search = search_of(observer=SimpleNamespace(library=library))
    search.found.twins = {frozenset("ab")}
    allowed = search._allowed(SimpleNamespace(rows=dict.fromkeys("cabd")))
    assert allowed == [(), ("a",), ("b",), ("c",), ("d",), ("a", "c"), ("b", "c")]


def test_a_refuted_set_is_tried_again_about_the_next_fit_and_not_before(monkeypatch):
    """f0 is refuted beside the best e0, about the base fit; e1 and f1 are refuted together about the fit of e0."""
    costs = {"e0": 80.0, "f0": 90.0, "e1": 70.0, "f1": 75.0, "e2": 60.0, "f2": 65.0}
    linear = SimpleNamespace(masses=lambda among, known: None, twins=set)
    monkeypatch.setattr("fit.gap.posterior.Likelihood", lambda *given: None)
    monkeypatch.setattr("fit.gap.posterior.Linear", lambda *given: linear)
    monkeypatch.setattr("fit.gap.posterior._wanted", lambda found, turn: [(f"e{turn}",), (f"f{turn}",)])
    known = []

    def refit(wanted, tasks):
        return [SimpleNamespace(cost=costs[one], name=one, residual=None) for (one,) in wanted]

    search = search_of(noise=[], rows={}, known_mm=0.5, refit=refit, renew=lambda fitted: {})
    search.about.residual = None
    search._allowed, search._tasks = (lambda one: []), lambda *given: []
    search._possible = lambda mass: known.append([name for (name,) in search.refuted])
    search._refutes = lambda linear, fitted: fitted.name in {"f0", "e1", "f1"}
    search._polished = lambda best, again: search.found.fits[best]
    search.go()
    assert known == [[], [], ["e1", "f1"], []]


def test_where_the_model_is_linearised_does_not_change_the_evidence(world, likelihood, linear):
    """The takes are linear in the logarithms; about parameters e^0.4 times as large the prior's mean lies elsewhere."""
    base = world.base()
    vector = base.vector * np.exp(0.4)
    away = dataclasses.replace(base, vector=vector, residual=world.residuals(vector[None], world.off)[0])
    other = Linear(world, likelihood, away, dict(world.rows))
    among = [(), ("air_drag",), ("air_drag", "hem")]
    one = log_evidence(linear.reduced, linear.columns, among)
    assert log_evidence(other.reduced, other.columns, among) == pytest.approx(one, abs=1e-5)


def test_an_effect_of_two_components_is_no_twin_of_another_or_of_itself(world, likelihood):
    """Both components of a draught move the cloth as the drag does; each may be told apart by the other."""
    rows = dict(world.rows) | {"draught": np.repeat(world.rows["air_drag"], 2, axis=0)}
    found = Linear(world, likelihood, world.base(), rows).twins()
    assert found == {frozenset(("filter_lag", "time_offset"))}

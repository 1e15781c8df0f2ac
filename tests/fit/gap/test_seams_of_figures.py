"""What one function of a diagnosis hands to the next: whose figure it is, and that it arrives."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from fit.effects import LIBRARY
from fit.gap import detectable, edge_driven, fitting, from_raw, gates, hypotheses, screening, weighed
from fit.gap.base_fit import middle
from fit.gap.closure import block_errors, gain_p_value
from fit.gap.correlation import correlation_of
from fit.gap.findings import describe_effects, notes
from fit.gap.fitting import Pinned, Task, fit
from fit.gap.floor import NOISE_REPLICAS, Floor, measured_noise, noise_floor
from fit.gap.screening import Secant, screen
from fit.methods import SI
from fit.observer import residuals
from formats.diagnosis_records import Figure, Gap
from tests.fit.gap.linear_cloth import BASE, LinearCloth, World, a_take, observer_of
from tests.fit.gap.linear_takes import LinearTakes
from tests.fit.gap.named_fits import Named
from tests.fit.gap.test_gates import Chaotic, recorded
from tests.fit.gap.verdict_scene import evidence_of, hypothesis


@pytest.fixture
def world():
    made = LinearTakes(3)
    made.missed = made.noisy() + made.moved(4e-3)
    return made


def test_the_errors_of_half_seconds_carry_the_correlation_that_the_residual_shows(world):
    """An error that swings for the whole take is less evidence than as much independent noise."""
    errors = block_errors(world, world.missed)
    seen = np.unique(world.layout.moving(world.layout.block))
    np.testing.assert_array_equal(errors.correlation, correlation_of(world, world.missed)[np.ix_(seen, seen)])
    assert errors.correlation[0, 1] > 0.1
    rng = np.random.default_rng(1)
    after = dataclasses.replace(errors, sums=errors.sums * rng.uniform(0.5, 1.3, len(errors.sums)))
    alone = dataclasses.replace(errors, correlation=None)
    assert gain_p_value(errors, after, 0.0) > 1.2 * gain_p_value(alone, after, 0.0)


def test_the_smallest_amplitude_allows_for_correlated_half_seconds_and_is_seen_on_the_judged_edge(monkeypatch):
    evidence = evidence_of({"air_drag": 6.0, "hem": 7.0})
    judge, matrix, asked = SimpleNamespace(), np.array([[1.0, 0.4], [0.4, 1.0]]), []
    evidence = dataclasses.replace(evidence, judge=judge)
    monkeypatch.setattr(detectable, "correlation_of", lambda observer, residual: matrix)
    monkeypatch.setattr(
        "fit.gap.screening.Signature.minimum_detectable",
        lambda self, left, block, correlation: asked.append(correlation) or np.ones(1),
    )

    def on_edge(observer, judged_on, screened):
        assert (observer, judged_on) == (evidence.observer, judge)
        return dict.fromkeys(screened, 0.5)

    monkeypatch.setattr(detectable, "detectable_on_edge", on_edge)
    assert detectable.smallest_detectable(evidence) == {"air_drag": np.array([0.5]), "hem": np.array([0.5])}
    assert all(given is matrix for given in asked)
    assert len(asked) == 2


class Twice(Named):
    """A checkpoint whose first or last fit is the better one; the other ended with every stiffness a third off."""

    def __init__(self, best):
        super().__init__()
        self.best = best

    def recall(self, names, make):
        found = super().recall(names, make)
        poor = dataclasses.replace(found[0], vector=1.3 * found[0].vector, residual=2.0 * found[0].residual)
        return [poor, found[0]] if self.best else [found[0], poor]


@pytest.mark.parametrize("best", [0, 1])
@pytest.mark.parametrize("held", [True, False])
def test_of_two_starts_the_cheaper_fit_is_judged(world, best, held, monkeypatch):
    """Held by the tracked edge, and on points before the camera's faults are corrected."""
    monkeypatch.setattr(world, "of", lambda recordings: world, raising=False)
    monkeypatch.setattr(from_raw, "raw_recordings", lambda takes: takes)
    end = world.base()
    left = float(world.in_mm(world.residuals(end.vector[None], world.off[None])[0]))
    if held:
        found = edge_driven.held_by_edge(world, world, end, Twice(best)).errors.squared_mm ** 0.5
    else:
        placed = [SimpleNamespace(camera=SimpleNamespace(is_placed=True))]
        found = from_raw.raw_error_mm(world, SimpleNamespace(recordings=placed), ["a"], [], end, Twice(best))
    assert found == pytest.approx(left, rel=0.01)


def test_the_closure_from_raw_points_is_that_of_the_named_model():
    """Of 400 - 25 mm^2 the named effect leaves 64 - 25, the base model 144 - 25."""
    gap = Gap(base_mm=Figure(value=12.0), floor_mm=Figure(value=5.0), with_effect_mm=Figure(value=8.0))
    assert from_raw.with_raw(gap, 20.0).closure_from_raw == pytest.approx((400 - 64) / 375)
    base = Gap(base_mm=Figure(value=12.0), floor_mm=Figure(value=5.0))
    assert from_raw.with_raw(base, 20.0).closure_from_raw == pytest.approx((400 - 144) / 375)


def test_each_take_gets_its_own_noise_once_more(monkeypatch):
    """Of takes with 1 and 3 mm of noise; the first is longer."""
    world = World()
    takes = [a_take("a", world, {}), a_take("b", world, {}, seconds=2.0, noise=3e-3, seed=1)]
    observer = observer_of(takes, world)
    monkeypatch.setattr(residuals, "Simulator", LinearCloth)
    monkeypatch.setattr(LinearCloth, "world", world)
    asked, of = [], observer.of
    monkeypatch.setattr(observer, "of", lambda recordings: asked.append(recordings) or of(recordings), raising=False)
    vector = SI.initial * np.exp(0.8 * BASE)
    residual = observer.residuals(vector[None], observer.off[None])[0]
    floor = noise_floor(observer, vector, observer.off, np.random.default_rng(0))
    assert len(asked) == NOISE_REPLICAS
    for recordings in asked:
        for noisy, recording, noise in zip(recordings, observer.recordings, measured_noise(observer, residual),
                                           strict=True):  # fmt: skip
            added = (noisy.points - recording.points).std((0, 2))
            assert np.median(added / noise) == pytest.approx(1.0, abs=0.1)
            assert not np.array_equal(noisy.held_seen, recording.held_seen)
    assert floor.stated_mm == pytest.approx(np.sqrt(3 * (60 + 9 * 40) / 100))
    assert floor.mm > floor.stated_mm


@pytest.mark.parametrize(("name", "function"), [("kind of points", "describe_contradiction"),
                                                ("clocks", "foreign_clock")])  # fmt: skip
def test_takes_held_out_are_looked_at_for_their_kind_of_points_and_clocks(name, function, monkeypatch):
    asked = []

    def found(*given):
        asked.append(given[-1])
        return "" if function == "describe_contradiction" else None

    monkeypatch.setattr(gates, function, found)
    training, held_out = recorded(), recorded()
    assert next(gate for gate in gates.data_gates([training], [held_out]) if gate.name == name).passed
    ((one, other),) = asked
    assert one is training
    assert other is held_out


def test_takes_are_predictable_beside_the_amplitudes_of_the_fit():
    observer = Chaotic(lambda hz: 0.5)
    asked = []
    answer = observer.residuals
    observer.residuals = lambda vectors, amplitudes: asked.append(amplitudes) or answer(vectors, amplitudes)
    row = observer.off + 0.3
    gates.predictability_gate(observer, SI.initial, row)
    np.testing.assert_array_equal(asked[0], [row, row])


def test_a_refit_begins_with_the_raw_signature_as_a_column_and_from_a_size_that_the_edge_knows(world, monkeypatch):
    """Base parameters move in the refit, so that their share stays in the effect's column."""
    base = world.base()
    screened = screen(world, base, ("air_drag", "time_offset"))
    (task,) = hypotheses.refits(world, base, screened, ["air_drag"])
    np.testing.assert_array_equal(task.jacobian[:, -1], screened["air_drag"].raw[0])
    assert not np.allclose(screened["air_drag"].raw, screened["air_drag"].projected, rtol=1e-3)
    columns, typical = world.columns["time_offset"], world.library["time_offset"].typical
    amplitudes, sd = world.off, np.full(len(world.off), np.inf)
    amplitudes[columns], sd[columns] = 1.7 * typical, 0.01 * typical
    monkeypatch.setattr(hypotheses, "beside_another", lambda *given: Pinned(amplitudes, sd, 3.0))
    (task,) = hypotheses.refits(world, base, screened, ["time_offset"])
    assert task.amplitudes[columns] == pytest.approx(1.7 * typical)
    assert task.pinned.trust == 3.0


def test_a_fit_has_the_limits_of_its_task(world, monkeypatch):
    given, search = [], fitting.search

    def searched(*words, **more):
        given.append(more)
        return search(*words, **more)

    monkeypatch.setattr(fitting, "search", searched)
    base = world.base()
    matrix = world.sensitivity.T
    tasks = [
        Task(base.vector, world.off, iterations=3, renewals=0, is_rough=True, known_cost=5.0, jacobian=matrix),
        Task(base.vector, world.off),
    ]
    fit(world, tasks)
    first, second = (more["settings"] for more in given)
    assert (first.max_iterations, first.renewals, first.is_exact, first.known_cost) == (3, 0, False, 5.0)
    assert (second.max_iterations, second.renewals, second.is_exact, second.known_cost) == (12, 2, True, np.inf)
    assert given[0]["jacobian"] is matrix
    assert given[1]["jacobian"] is None
    assert first.is_chord


@pytest.mark.parametrize(("kinds", "is_told"), [((False, False), True), ((True, False), False), ((True, True), False)])
def test_offsets_are_told_as_taken_out_where_no_take_has_material_points(kinds, is_told):
    recordings = [SimpleNamespace(has_material_points=kind) for kind in kinds]
    observer = SimpleNamespace(frequency=0.0, resolution=SimpleNamespace(spacing=0.05), recordings=recordings)
    said = notes(2, 1, observer, Floor(2.0, 0.1, 2.0, 2.0), is_predictable=True)
    assert any("mean offset was taken out" in note for note in said) == is_told


def test_subsets_are_weighed_by_raw_signatures_about_each_fit(world, monkeypatch):
    """`Linear` projects by itself; a projected row would be no column of a joint Jacobian."""
    given = []

    class Stopped(Exception):  # noqa: N818
        pass

    def search(*words):
        given.extend(words)
        raise Stopped

    monkeypatch.setattr(weighed, "Search", search)
    base = world.base()
    rounds = SimpleNamespace(
        observer=world, base=SimpleNamespace(fitted=base), tested=tuple(world.library), kept=Named()
    )
    with pytest.raises(Stopped):
        weighed.weigh(rounds, Floor(2.0, 0.1, 2.0, 2.0), SimpleNamespace(numerics_mm=0.5), ())
    rows, renew = given[3], given[-1]
    whole = screen(world, base, rounds.tested)
    for name, row in rows.items():
        np.testing.assert_allclose(row, whole[name].raw)
    about = dataclasses.replace(
        base, active=("air_drag",), jacobian=np.column_stack([base.jacobian, world.rows["air_drag"][0]])
    )
    renewed = renew(about)
    assert set(renewed) == set(world.library) - {"air_drag"}
    for name, row in renewed.items():
        np.testing.assert_allclose(row, whole[name].raw)


def test_the_components_of_an_effect_that_is_named_with_another_are_of_their_joint_fit(monkeypatch):
    """A draught alone is fitted at typical sizes of both components, beside a hem at half of them."""
    smallest = {e.name: np.full(len(e.components), 0.1) for e in LIBRARY}
    monkeypatch.setattr("fit.gap.findings.smallest_detectable", lambda evidence: smallest)
    evidence = evidence_of({**{e.name: 11.9 for e in LIBRARY if not e.in_base}, "draught": 9.0})
    base = dataclasses.replace(evidence.base, fitted=dataclasses.replace(evidence.base.fitted, residual=np.ones(3)))
    evidence = dataclasses.replace(evidence, base=base)
    together = hypothesis(("draught", "hem"), 5.5, sizes=0.5)
    for best, size in ((None, 0.3), (together, 0.15)):
        (found,) = [one for one in describe_effects(evidence, best, LIBRARY, SI) if one.id == "draught"]
        assert list(found.components.values()) == pytest.approx([size, size])


@pytest.mark.parametrize(("at", "is_taken"), [(1.5, True), (4.0, False)])
def test_a_probe_that_finds_another_amplitude_than_its_own_is_not_taken(world, monkeypatch, at, is_taken):
    """The takes hold one and a half typical sizes of the probe's signature, and nothing of the first secant's."""
    row, typical = world.rows["air_drag"], world.library["air_drag"].typical
    world.missed = world.noisy() - 1.5 * row[0]
    secants = [Secant(world.rows["hem"] / typical), Secant(row / typical, at=at * typical)]
    monkeypatch.setattr(screening, "secants_of", lambda observer, fitted, chosen: {"air_drag": secants})
    found = screen(world, world.base(), ("air_drag",))["air_drag"]
    assert (found.explained > 0.5) == is_taken
    assert (found.amplitude[0] == pytest.approx(1.5 * typical, rel=0.1)) == is_taken


def test_a_further_start_lies_between_the_two_fits_of_least_cost(world):
    """The middle is geometric for logarithms; fits come in the order of their starts."""
    base, factors, costs = world.base(), (1.5, 0.8, 1.0, 1.2), (9.0, 1.0, 5.0, 2.0)
    fits = [
        dataclasses.replace(base, vector=factor * SI.initial, residual=np.array([cost**0.5]))
        for factor, cost in zip(factors, costs, strict=True)
    ]
    assert SI.is_log.all()
    assert middle(world, fits) == pytest.approx(np.sqrt(0.8 * 1.2) * SI.initial)

"""Whole diagnoses by rules of takes whose truth is known, in a linear world without simulation.

What one step hands to the next is compared with what the takes and the world's own fields say.
"""

from __future__ import annotations

import dataclasses
import functools
import re
import tempfile
from pathlib import Path

import numpy as np
import pytest

from fit.gap import diagnosis as steps
from fit.gap.missing_force import find_missing_force
from fit.gap.next_experiment import MENU
from fit.observer.simulation_error import FREE_DIRECTIONS
from formats.diagnosis_records import Gate
from tests.fit.gap.linear_cloth import (
    EFFECTS,
    LinearCloth,
    World,
    diagnosed,
    misses_by,
    observer_of,
    points_of,
    three_takes,
)

HEM = 0.015  # kg/m, one and a half typical sizes
HELD_OUT = 1.5 * np.sqrt(3)  # mm, noise of the take judged on
FITTED = np.sqrt(3)  # mm, of the takes fitted to


@functools.cache
def of_a_hem():
    world = World()
    training, held_out = three_takes(world, {"hem": HEM})
    with tempfile.TemporaryDirectory() as folder:
        kept = Path(folder) / "fits"
        found = diagnosed(training, held_out, world, checkpoint=kept)
        names = sorted(path.stem for path in kept.glob("*.npz"))
    return world, held_out[0], found, names, LinearCloth.last_runs


@functools.cache
def of_nothing():
    world = World()
    training, held_out = three_takes(world, {})
    return diagnosed(training, held_out, world).diagnosis


@functools.cache
def of_two(apart=0.004):
    """Air drag and a hem, and strain stiffening that moves the cloth as air drag does but for 0.4 %."""
    world = World(alike={"strain_stiffening": "air_drag"}, apart=apart)
    training, held_out = three_takes(world, {"hem": HEM, "air_drag": 1.5})
    return world, held_out[0], diagnosed(training, held_out, world)


def finding(diagnosis, name):
    return next(one for one in diagnosis.effects if one.id == name)


def gate(diagnosis, name):
    return next(one for one in diagnosis.gates if one.name == name)


def test_a_hem_is_named_with_its_size_and_judged_on_the_held_out_take_alone():
    world, take, found, _, _ = of_a_hem()
    d = found.diagnosis
    assert (d.verdict, d.named, d.alternatives) == ("effect", ["hem"], {})
    assert (d.take_ids, d.held_out_ids) == (["a", "b"], ["c"])
    assert [state.take_id for state in d.take_states] == ["a", "b", "c"]
    assert d.take_contents == found.takes.contents
    assert len(d.take_contents) == 2
    assert [one.name for one in d.gates] == [
        "calibration", "length", "motion", "cloth motion", "repeated frames", "impossible points", "clocks",
        "kind of points", "predictability", "base fit", "mesh and step",
    ]  # fmt: skip
    assert "Not looked for, as asked: shear stiffness, " in d.sentence
    assert d.gap.is_held_out
    hem = finding(d, "hem")
    assert hem.amplitude == pytest.approx(HEM, rel=0.05)
    assert hem.amplitude_interval[0] < HEM < hem.amplitude_interval[1]
    # The base fit ends elsewhere than the truth, and is judged where it ends.
    assert d.gap.base_mm.value == pytest.approx(misses_by(take, points_of(take, world, found.base.vector)), rel=1e-6)
    without, size = found.best.vector, found.best.amplitudes[LinearCloth.columns_of("hem")]
    with_hem = misses_by(take, points_of(take, world, without, {"hem": size}))
    assert d.gap.with_effect_mm.value == pytest.approx(with_hem, rel=1e-6)
    assert with_hem == pytest.approx(HELD_OUT, rel=0.05)
    assert HELD_OUT < d.gap.floor_mm.value < 1.15 * HELD_OUT
    whole, left, floor = d.gap.base_mm.value**2, with_hem**2, d.gap.floor_mm.value**2
    assert d.gap.closure.value == hem.closure.value == pytest.approx((whole - left) / (whole - floor), rel=1e-9)
    assert d.gap.held_by_edge_mm is None
    assert f"misses by {d.gap.base_mm.value:.1f} mm on motion not used for fitting" in d.sentence


def test_the_location_and_the_force_are_of_the_take_judged_on_and_of_the_base_model():
    world, take, found, _, _ = of_a_hem()
    d = found.diagnosis
    squares = [one.value_mm**2 for one in d.where.vertices]
    assert np.mean(squares) ** 0.5 == pytest.approx(d.gap.base_mm.value, rel=1e-6)
    judge = observer_of([take], world)
    assert d.missing_force == find_missing_force(judge, found.base.vector)


def test_the_error_of_mesh_and_solver_is_of_the_take_judged_on():
    """The mesh's own field, on the mesh as it is, and 1.5 % of the points' motion."""
    world, take, found, _, _ = of_a_hem()
    d = found.diagnosis
    (recording,) = observer_of([take], world).recordings
    without = points_of(take, dataclasses.replace(world, mesh=0.0), found.base.vector)
    fields = points_of(take, world, found.base.vector) - without, recording.points - recording.points.mean(0)
    sizes = [float(np.sqrt((one[:, recording.judged] ** 2).sum(2).mean())) for one in fields]
    assert d.gap.numerics_mm == pytest.approx(1e3 * np.hypot(sizes[0], 0.015 * sizes[1]), rel=0.02)
    assert f"{d.gap.numerics_mm:.1f} mm" in gate(d, "mesh and step").sentence


def test_starts_of_the_base_fit_may_differ_by_half_the_log_cost_that_the_best_effect_saves():
    _, _, found, names, _ = of_a_hem()
    bases = [name for name in names if name.startswith("base")]
    limit = 100 * ((found.base.cost / found.best.cost) ** 0.5 - 1)
    assert gate(found.diagnosis, "base fit").limit == pytest.approx(limit, rel=1e-3)
    assert f"Of {len(bases)} starts of" in gate(found.diagnosis, "base fit").sentence


def test_where_one_effect_leaves_only_noise_no_two_are_fitted_and_every_simulation_is_counted():
    _, _, found, names, runs = of_a_hem()
    assert "hem" in names
    assert not [name for name in names if "+" in name]
    # The location of the gap is simulated after the count.
    assert found.diagnosis.cost.simulations == runs - 1


def test_the_next_recording_separates_the_named_effect_from_another_or_from_none():
    d = of_a_hem()[2].diagnosis
    assert d.next_experiment.id in [motion.id for motion in MENU]
    assert d.next_experiment.separates[0] == "hem"
    assert d.next_experiment.sigmas_next > d.next_experiment.sigmas_now + 1.0


def test_notes_say_what_the_figures_rest_on():
    d = of_a_hem()[2].diagnosis
    pull, points, probabilities, base, noise = d.notes
    assert pull == "Free rollouts, predictable as they are; mesh of 100 mm."
    assert points.startswith("Errors are root mean square distances")
    assert probabilities.startswith("Probabilities follow from the share of draws")
    assert base.startswith("The base model is fitted by a search of the diagnosis' own")
    assert "One of its starts is the best refit with an effect." in base
    assert noise.startswith("The sensor's noise in this diagnosis is a distance in space")


def test_without_a_gap_nothing_is_refitted_and_the_floor_is_of_the_take_judged_on():
    d = of_nothing()
    assert (d.verdict, d.named, d.next_experiment) == ("none", [], None)
    assert all(one.fitted_share is None and one.closure is None for one in d.effects)
    assert HELD_OUT < d.gap.floor_mm.value < 1.15 * HELD_OUT
    assert d.gap.base_mm.value == pytest.approx(HELD_OUT, rel=0.05)
    assert gate(d, "mesh and step").sentence.startswith("There is hardly a gap")
    assert not any("refit with an effect" in note for note in d.notes)
    assert not any("too little" in one.note for one in d.effects)  # without a gap, however much an effect explains


def test_two_effects_are_named_with_the_twin_of_one_of_them():
    """The cloth cannot tell air drag from strain stiffening, so that the named one may be either."""
    world, take, found = of_two()
    d = found.diagnosis
    assert d.verdict == "several"
    assert "hem" in d.named
    (other,) = set(d.named) - {"hem"}
    (twin,) = {"air_drag", "strain_stiffening"} - {other}
    assert d.alternatives == {other: [twin]}
    assert f"{next(e.title for e in EFFECTS if e.name == twin)}: these takes cannot tell" in d.sentence
    hem, one, two = (finding(d, name) for name in ("hem", other, twin))
    assert hem.note.startswith("size beside ")
    assert hem.amplitude == pytest.approx(HEM, rel=0.05)
    assert hem.probability == pytest.approx(one.probability + two.probability, abs=0.01)
    assert min(one.probability, two.probability) > 0.05
    said = int(re.search(r"with a probability of (?:at least |more than )?(\d+) %", d.sentence)[1])
    assert said >= 99
    sizes = {name: finding(d, name).amplitude for name in d.named}
    columns = LinearCloth.columns_of
    assert all(found.best.amplitudes[columns(k)][0] == pytest.approx(size) for k, size in sizes.items())
    together = misses_by(take, points_of(take, world, found.best.vector, sizes))
    assert d.gap.with_effect_mm.value == pytest.approx(together, rel=1e-4)


def test_a_small_effect_is_named_beside_one_that_would_suffice_alone():
    """Beside a hem, whose sound laws would leave as much, a third of typical drag leaves nothing but noise."""
    world = World()
    training, held_out = three_takes(world, {"hem": HEM, "air_drag": 0.5})
    d = diagnosed(training, held_out, world).diagnosis
    assert (d.verdict, d.named) == ("several", ["hem", "air_drag"]), d.sentence
    assert finding(d, "air_drag").amplitude == pytest.approx(0.5, abs=0.05)
    assert finding(d, "hem").amplitude == pytest.approx(HEM, rel=0.05)


def test_collinear_effects_are_ambiguous_and_a_note_says_that_no_motion_separates_them():
    """Strain stiffening moves this cloth as air drag does but for a ten-thousandth."""
    world = World(alike={"strain_stiffening": "air_drag"}, apart=1e-4)
    training, held_out = three_takes(world, {"air_drag": 1.5})
    d = diagnosed(training, held_out, world).diagnosis
    assert d.verdict == "ambiguous"
    assert set(d.named) == {"air_drag", "strain_stiffening"}
    best, other = (finding(d, name) for name in d.named)
    assert best.closure.value >= other.closure.value
    assert best.group == other.group
    assert best.probability + other.probability > 0.95
    for one in (best, other):
        assert 0.2 < one.probability < 0.8
        assert f"(probability {100 * one.probability:.0f} %)" in d.sentence
    assert d.next_experiment is None
    assert [note for note in d.notes if note.startswith("No motion of the menu would separate")] == [d.notes[-1]]


def test_an_effect_that_moves_the_held_edge_alone_is_looked_for_though_the_cloth_shows_no_gap():
    world = World(on_edge=("clock_drift",))
    training, held_out = three_takes(world, {"clock_drift": 0.005})
    d = diagnosed(training, held_out, world).diagnosis
    assert (d.verdict, d.named) == ("effect", ["clock_drift"]), d.sentence
    found = finding(d, "clock_drift")
    assert found.amplitude == pytest.approx(0.005, rel=0.1)
    assert found.p_value is None  # the edge showed it, and no test of its closure
    assert d.gap.edge_with_effect_mm < 0.6 * d.gap.edge_mm
    assert "The held edge shows this effect" in d.sentence


def test_of_two_effects_that_move_the_held_edge_alone_the_nearer_one_is_stated_and_none_is_named():
    """Either effect leaves what the other one moves, so that no single one puts the edge where it was tracked."""
    world = World(on_edge=("clock_drift", "time_offset"))
    training, held_out = three_takes(world, {"clock_drift": 0.003, "time_offset": 0.012})
    d = diagnosed(training, held_out, world).diagnosis
    assert (d.verdict, d.named) == ("none", []), d.sentence
    assert d.sentence.startswith("No gap in the cloth below its held edge: ")
    said = re.search(
        r"The base model puts the held edge (\S+) mm off, beyond noise\. With (.*) it is (\S+) mm off, "
        r"which this effect alone does not explain\.",
        d.sentence,
    )
    assert said is not None, d.sentence
    assert float(said[1]) == pytest.approx(d.gap.edge_mm, abs=0.05)
    assert 1.4 < float(said[3]) < float(said[1])
    assert said[2] in {effect.title for effect in EFFECTS if effect.name in world.on_edge}


def test_two_effects_that_move_the_held_edge_alone_are_named_once_the_cloth_exceeds_the_noise():
    """They move the cloth to 3.2 mm beside 2.6 mm of noise."""
    world = World(on_edge=("clock_drift", "time_offset"))
    training, held_out = three_takes(world, {"clock_drift": 0.005, "time_offset": 0.02})
    d = diagnosed(training, held_out, world).diagnosis
    assert (d.verdict, sorted(d.named)) == ("several", ["clock_drift", "time_offset"]), d.sentence
    assert d.gap.floor_mm.value == pytest.approx(HELD_OUT, rel=0.06)
    assert finding(d, "clock_drift").amplitude == pytest.approx(0.005, rel=0.1)
    assert finding(d, "time_offset").amplitude == pytest.approx(0.02, rel=0.1)


def test_an_edge_that_leaves_the_hangers_path_is_simulated_from_where_it_was_tracked():
    """The whole cloth follows an edge that moves 5 mm beside the hanger's path, as no effect does."""
    world = World()
    training, held_out = three_takes(world, {}, off=5e-3)
    d = diagnosed(training, held_out, world).diagnosis
    assert (d.verdict, d.named) == ("unknown", [])
    assert d.gap.held_by_edge_mm.value == pytest.approx(HELD_OUT, rel=0.1)
    assert d.gap.closure_held_by_edge.value > 0.9
    assert "lies between hanger and edge." in d.sentence


def test_a_size_that_edge_and_cloth_dispute_is_weighed_by_the_error_of_mesh_and_solver():
    """At the edge the offset is 20 ms; the cloth below moves as with 30.

    The edge's estimate is a prior, sharper by the trust in it, the factor 1 + N e^2 / (FREE_DIRECTIONS s^2).
    """
    world = World()
    training, held_out = three_takes(world, {"time_offset": 0.02}, more={"time_offset": 0.01})
    d = diagnosed(training, held_out, world).diagnosis
    assert d.named == ["time_offset"]
    observer = observer_of(training, world)
    typical, column = 0.02, LinearCloth.columns_of("time_offset")
    layout = observer.layout
    row = np.zeros(len(observer.off))
    row[column] = typical
    zero = observer.off
    start = observer.parameterisation.initial
    first = observer.residuals(start[None], zero[None])[0]
    own = observer.residuals(start[None], row[None])[0] - first
    base = np.stack([observer.residuals((start * np.exp(1e-3 * unit))[None], zero[None])[0] - first
                     for unit in np.eye(len(start))]) / 1e-3  # fmt: skip
    trust = 1 + layout.is_judged.sum() * (1e-3 * d.gap.numerics_mm) ** 2 / 3 / (FREE_DIRECTIONS * 1e-6)
    on_edge, still = layout.is_edge, layout.frame < 0
    weights = np.where(still, 0.5, 0.25)[on_edge]
    seen = own[on_edge]
    known = float(weights @ seen**2)
    edge = -float(weights @ (seen * first[on_edge])) / known
    assert edge == pytest.approx(1.0, abs=0.05)
    rows = np.concatenate([base, own[None]])
    prior = np.diag([*np.full(len(start), 1.5**-2), trust * known])
    right = rows @ first - prior @ np.array([*np.zeros(len(start)), edge])
    expected = -np.linalg.solve(rows @ rows.T + prior, right)[-1]
    assert 1.05 < expected < 1.45
    assert finding(d, "time_offset").amplitude / typical == pytest.approx(expected, abs=0.02)


def test_without_held_out_takes_the_closure_is_said_to_flatter():
    world = World()
    training, _ = three_takes(world, {"hem": HEM})
    found = diagnosed(training, [], world)
    d = found.diagnosis
    assert (d.verdict, d.named, d.gap.is_held_out) == ("effect", ["hem"], False)
    assert [note.split(":")[0] for note in d.notes[5:]] == ["No held-out take", "One or two takes"]
    assert "on the motion it was fitted to (no held-out take)" in d.sentence
    assert FITTED < d.gap.floor_mm.value < 1.25 * FITTED
    # The family of a p-value is every effect that was screened, as the takes chose which are refitted.
    assert finding(d, "hem").p_value < 0.05


CHAOTIC = Gate(name="predictability", passed=False, figure=9.0, limit=1.0, unit="mm", sentence="chaotic")


def test_a_parameter_at_its_bound_and_an_incomplete_or_unpredictable_take_are_told(monkeypatch):
    world = World()
    fitted = steps.fit_base
    monkeypatch.setattr(steps, "fit_base", lambda *given: (*fitted(*given)[:2], CHAOTIC))
    monkeypatch.setattr(steps.Rounds, "predictability", lambda self: CHAOTIC)
    training, (held_out,) = three_takes(world, {}, base=8.0)
    cut = dataclasses.replace(held_out, is_complete=False)
    d = diagnosed(training, [cut], world).diagnosis
    assert not gate(d, "predictability").passed
    assert d.notes[0].startswith("Free rollouts, which no pull makes predictable; ")
    assert "velocity damping (range from 0.02 per s)" in d.sentence
    assert "are at their bounds" in d.sentence
    assert [state.is_complete for state in d.take_states] == [True, True, False]
    (note,) = [note for note in d.notes[3:] if "incomplete" in note]
    assert re.search(r"\bc\b", note), note


def test_takes_that_only_the_best_model_predicts_are_predictable_and_raw_points_are_counted_in(monkeypatch):
    """The base fit's end is said to be unpredictable; the camera's faults would have left 20 mm on raw points."""
    world = World()
    training, held_out = three_takes(world, {"hem": HEM})
    asked, looked_at = [], []
    fitted = steps.fit_base

    def raw(observer, judge, *takes):
        asked.append((len(observer.recordings), len(judge.recordings), *takes[:3]))
        return 20.0

    monkeypatch.setattr(steps, "fit_base", lambda *given: (*fitted(*given)[:2], CHAOTIC))
    monkeypatch.setattr(steps.from_raw, "raw_error_mm", raw)
    monkeypatch.setattr(steps, "describe_camera", lambda recordings: looked_at.extend(recordings) or [])
    found = diagnosed(training, held_out, world)
    d = found.diagnosis
    assert (d.verdict, d.named) == ("effect", ["hem"])
    assert gate(d, "predictability").passed
    assert d.notes[0].startswith("Free rollouts, predictable as they are")
    ((fitted_to, judged_on, first, second, base),) = asked
    assert (fitted_to, judged_on, first, second) == (2, 1, training, held_out)
    assert base is found.base
    assert [one.take_id for one in looked_at] == ["a", "b", "c"]
    floor, left = d.gap.floor_mm.value**2, d.gap.with_effect_mm.value**2
    assert d.gap.closure_from_raw == pytest.approx(min((400 - left) / (400 - floor), 1.0))
    assert "From the points as tracked, which the base model misses by 20.0 mm" in d.sentence

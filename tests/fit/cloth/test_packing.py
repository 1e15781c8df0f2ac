"""Candidates in SIMD lanes: bitwise independent of each other, and packed with few empty lanes."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from fit import runtime
from fit.cloth import packing
from fit.cloth.launch import _stacked
from fit.cloth.model import Resolution
from fit.cloth.simulator import Simulator, run_together
from fit.effects import find_effects
from fit.effects.air_drag import AirDrag
from fit.recordings.recording import Windows, prepare
from tests.fit.scenes import hung, material, sheet, swing, take_of


def test_results_do_not_depend_on_batch_lanes_or_threads():
    garment = sheet()
    time = np.arange(0, 2, 1 / 30)
    recording = prepare(take_of(garment, time, swing(time), hung(garment, time)))
    rows = np.concatenate([material(garment, velocity_damping=d) for d in np.linspace(0.5, 2, 11)])
    together = Simulator(recording).run(rows).points
    alone = Simulator(recording).run(rows[4:5]).points
    assert np.array_equal(together[4], alone[0])


# These take long to compile in every width.
EVERYTHING = pytest.param(["air_drag", "bending_hysteresis", "added_mass", "stretch_viscosity"], marks=pytest.mark.slow)
CONTACT_TOO = pytest.param(["self_contact"], marks=pytest.mark.slow)


@pytest.mark.parametrize(
    "names", [["hem"], EVERYTHING, CONTACT_TOO],
    ids=["plain", "everything", "contact"],
)  # fmt: skip
def test_kernels_of_all_widths_round_alike(names, monkeypatch):
    """Sixteen candidates at most go side by side, in vectors of every width that this processor is trusted with."""
    garment, time = sheet(grid=5), np.arange(0, 1.5, 1 / 30)
    path = swing(time, amplitude=0.05, hz=0.7, start=0.1, sideways=0.02)
    recording = prepare(take_of(garment, time, path, hung(garment, time)))
    chosen = find_effects(names)
    simulator = Simulator(recording, chosen, resolution=Resolution(spacing=0.07))
    rows = np.repeat(material(garment, velocity_damping=1.0), 3, 0)
    typical = np.concatenate([np.full(len(effect.components), effect.typical) for effect in chosen])
    found = []
    for width in runtime.lane_widths():
        with monkeypatch.context() as patch:
            patch.setattr(runtime, "lane_widths", lambda width=width: (width,))
            found.append(simulator.run(rows, np.tile(typical, (3, 1))).points)
    assert np.isfinite(found[0]).all()
    assert np.abs(found[0] - hung(garment, time)).max() > 0.01
    assert all(np.array_equal(one, found[0]) for one in found)


def test_targets_of_takes_of_different_lengths_lie_one_behind_the_other():
    """Takes of 2 and 4 samples share a task of two lanes, and one of 3 has its own: it begins at 4."""

    def target(samples, value):
        return np.full((samples, 1, 6, 1), value), np.full((samples, 1), value / 10), 1

    courses = [SimpleNamespace(targets=[target(2, 1.0), target(4, 2.0)]), SimpleNamespace(targets=[target(3, 3.0)])]
    targets, trust, firsts = _stacked(courses, 2)
    assert firsts.tolist() == [0, 4]
    assert targets[:, 0, 5].tolist() == [[1, 2], [1, 2], [0, 2], [0, 2], [3, 0], [3, 0], [3, 0]]
    assert trust[:, 0] == pytest.approx(targets[:, 0, 0] / 10)


# `test_contact.py` has a quicker test of candidates side by side with contact.
CONTACT = pytest.param("self_contact", marks=pytest.mark.slow)
VISCOUS = pytest.param("stretch_viscosity", marks=pytest.mark.slow)


@pytest.mark.parametrize("effect", [CONTACT, "hanger_compliance", VISCOUS, "filter_lag"])
def test_effects_of_every_kind_do_not_depend_on_other_recordings_in_their_lanes(effect):
    """Contact, a driven path, viscosity and a filter of what is seen; one recording counts in windows, under a pull."""
    chosen, garment, recordings = find_effects([effect]), sheet(), []
    for length, rate, reach in ((1.2, 30, 0.08), (0.9, 45, 0.05)):
        time = np.arange(0, length, 1 / rate)
        recordings.append(prepare(take_of(garment, time, swing(time, amplitude=reach), hung(garment, time))))
    recordings[0] = dataclasses.replace(recordings[0], windows=Windows(free=0.4, caught=0.2))
    simulators = [Simulator(r, chosen, resolution=Resolution(spacing=0.07)) for r in recordings]
    rows = np.concatenate([material(garment, stretch_stiffness=k) for k in (200.0, 300.0)])
    sizes = np.full((2, simulators[0].columns[-1].stop), chosen[0].typical) * [[1.0], [0.5]]
    together = run_together(simulators, [rows] * 2, [sizes] * 2, observer_hz=1.0)
    for simulator, found in zip(simulators, together, strict=True):
        assert np.array_equal(found.points, simulator.run(rows, sizes, observer_hz=1.0).points)


@pytest.mark.parametrize(
    ("second", "observer_hz"),
    [
        pytest.param(sheet(), 0.0, id="one garment-0.0"),
        pytest.param(sheet(), 1.0, id="one garment-1.0", marks=pytest.mark.slow),
        pytest.param(sheet(width=0.3), 0.0, id="two garments-0.0", marks=pytest.mark.slow),
        pytest.param(sheet(width=0.3), 1.0, id="two garments-1.0"),
    ],
)
def test_recordings_side_by_side_are_what_each_is_alone(second, observer_hz):
    """Of other lengths, paths, rates, steps and targets, with effects and without, in lanes that they share."""
    simulators, candidates, amplitudes = [], [], []
    effects = (AirDrag(),)
    for garment, length, rate, reach in ((sheet(), 0.9, 30, 0.08), (second, 0.7, 45, 0.05)):
        time = np.arange(0, length, 1 / rate)
        recording = prepare(take_of(garment, time, swing(time, amplitude=reach), hung(garment, time)))
        simulators.append(Simulator(recording, effects, resolution=Resolution(spacing=0.07)))
        candidates.append(np.concatenate([material(garment, stretch_stiffness=k) for k in (50.0, 300.0, 300.0)]))
        amplitudes.append(np.array([[0.0], [0.0], [1.0]]))
    kept = run_together(simulators, candidates, amplitudes, observer_hz=observer_hz, shapes=True)
    together = run_together(simulators, candidates, amplitudes, observer_hz=observer_hz)
    for simulator, rows, sizes, found, whole in zip(simulators, candidates, amplitudes, together, kept, strict=True):
        alone = simulator.run(rows, sizes, observer_hz=observer_hz, shapes=True)
        assert np.isfinite(found.points).all()
        assert np.array_equal(found.points, alone.points)
        assert np.array_equal(whole.points, alone.points)
        assert np.array_equal(whole.shapes, alone.shapes)
        assert np.array_equal(whole.forces, alone.forces)


def test_candidates_of_several_recordings_share_the_lanes_of_a_task():
    """Three recordings with three candidates each fill one task of nine lanes, or three of four with three left."""
    garment, time = sheet(), np.arange(30) / 30
    simulators = [Simulator(prepare(take_of(garment, time, np.zeros((30, 3))))) for _ in range(3)]
    rows = np.repeat(material(garment), 3, axis=0)
    groups = [g for s in simulators for g in s.groups(rows, None, shapes=False)[1]]
    assert [[len(part.members) for part in task.parts] for task in packing.pack(groups, 16)] == [[3, 3, 3]]
    assert [[len(part.members) for part in task.parts] for task in packing.pack(groups, 4)] == [[3, 1], [2, 2], [1]]
    assert [len(k) for _, k in packing.pack(groups, 16)[0].filled(16)] == [3, 3, 10]
    kept = [g for s in simulators for g in s.groups(rows, None, shapes=True)[1]]
    assert len(packing.pack(kept, 16)) == 3


def test_calls_are_cut_and_lanes_are_fewer_where_memory_would_run_short(monkeypatch):
    """Five tasks of eight candidates in one call, in three of two, one for each processor, or in forty of one lane."""
    garment, time = sheet(), np.arange(30) / 30
    simulator = Simulator(prepare(take_of(garment, time, np.zeros((30, 3)), hung(garment, time))))
    groups = simulator.groups(np.repeat(material(garment), 40, axis=0), None, shapes=False)[1]

    def planned(most, is_pulled=True):
        monkeypatch.setattr(packing, "MOST_NUMBERS_OF_CALL", most)
        lanes, calls = packing.plan(groups, 2, (1, 8), is_pulled=is_pulled)
        return lanes, [len(tasks) for tasks in calls]

    pulled = packing.pack(groups, 8)[0].numbers(is_pulled=True)
    free = packing.pack(groups, 8)[0].numbers(is_pulled=False)
    assert pulled > free > 0
    assert planned(5 * 8 * pulled * 2) == (8, [5])
    assert planned(2 * 8 * pulled) == (8, [2, 2, 1])
    assert planned(8 * pulled) == (1, [8, 8, 8, 8, 8])
    assert planned(1) == (1, [2] * 20)
    assert planned(4 * 8 * free, is_pulled=False) == (8, [4, 1])

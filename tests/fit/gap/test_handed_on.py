"""Data passed between the steps of a diagnosis: hypotheses, evidence, checkpoint keys, observers."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest

from fit.errors import FitError
from fit.gap import edge_driven, next_experiment
from fit.gap.diagnosis import _key
from fit.gap.edge_driven import driven_by_edge, held_by_edge
from fit.gap.fitting import Problem
from fit.gap.floor import Floor, row_off_mm
from fit.gap.from_raw import raw_recordings
from fit.gap.next_experiment import JACOBIAN_STEP, MENU, _imagined
from fit.gap.rounds import Rounds
from fit.methods import SI
from fit.provenance import physics_version
from fit.recordings.camera import Camera
from fit.recordings.ready import ready
from fit.recordings.recording import prepare
from fit.recordings.selection import content_of
from tests.fit.gap.linear_takes import LinearTakes
from tests.fit.gap.named_fits import Named
from tests.fit.gap.test_diagnosis_parts import a_take
from tests.fit.gap.verdict_scene import hypothesis
from tests.fit.scenes import hung, sheet, swing, take_of


def test_the_held_rows_error_is_the_root_mean_square_over_the_frames_that_count():
    """3 mm in 30 frames and 1 mm in 10 are sqrt((9 x 30 + 1 x 10) / 40) mm."""
    recordings = [
        SimpleNamespace(camera=SimpleNamespace(row_off=off), counted=np.arange(50) < frames)
        for off, frames in ((0.003, 30), (0.001, 10))
    ]
    assert row_off_mm(SimpleNamespace(recordings=recordings)) == pytest.approx(np.sqrt(7.0), rel=1e-12)


@pytest.mark.parametrize(
    ("verdict", "named", "chosen", "weights"),
    [
        ("effect", ["hem"], ["hem", "draught"], [0.6, 0.3]),
        ("unknown", [], ["draught", "hem"], [0.3, 0.6]),
        ("ambiguous", ["air_drag", "hem", "draught"], ["draught", "hem", "air_drag"], [0.3, 0.6, 0.1]),
        ("none", ["hem"], [], []),
        ("several", ["hem", "draught"], [], []),
    ],
)
def test_a_further_recording_separates_what_is_named_and_the_next_best(verdict, named, chosen, weights):
    """By held-out error the order is draught, hem, air drag; nothing weighs less than a tenth."""
    singles = {name: hypothesis((name,), mm) for name, mm in (("air_drag", 6.0), ("hem", 5.0), ("draught", 4.0))}
    evidence = SimpleNamespace(win_shares=lambda: {"air_drag": 0.02, "hem": 0.6, "draught": 0.3})
    alive, shares = Rounds.alive(
        SimpleNamespace(singles=singles), evidence, SimpleNamespace(verdict=verdict, named=named)
    )
    assert [one.effects for one in alive] == [(name,) for name in chosen]
    assert shares == weights


def test_the_evidence_is_all_that_the_rounds_found():
    parts = ("observer", "judge", "screened", "base", "singles", "joint", "instead")
    search = SimpleNamespace(**{name: object() for name in parts})
    refined = SimpleNamespace(numerics_mm=0.7, mesh_mm=0.4)
    resampling, gates = object(), [object()]
    found = Rounds.evidence(search, Floor(2.0, 0.1, 1.9, 1.8), refined, resampling, gates, is_held_out=True)
    assert all(getattr(found, name) is getattr(search, name) for name in parts)
    assert (found.floor_mm, found.floor_error_mm, found.numerics_mm, found.mesh_mm) == (2.0, 0.1, 0.7, 0.4)
    assert found.resampling is resampling
    assert found.gates is gates
    assert found.is_held_out


def test_kept_fits_are_of_everything_that_decides_what_they_are():
    observer = SimpleNamespace(
        parameterisation=SI, effects=[SimpleNamespace(name="hem")], resolution=SimpleNamespace(spacing=0.03)
    )
    takes = SimpleNamespace(contents=["a"], held_out_contents=["b"])
    assert _key(takes, ("draught",), observer, 5, "evidence") == {
        "takes": ["a"], "held_out": ["b"], "model": "si", "added": ["draught"], "effects": ["hem"], "seed": 5,
        "by": "evidence", "spacing": 0.03, "physics": physics_version(),
    }  # fmt: skip
    assert _key(takes, (), observer, 5)["by"] == "rules"


@pytest.fixture
def world(monkeypatch):
    """Linear takes, and what they become of recordings: linear takes of their own."""
    made = LinearTakes(3)
    made.missed, made.asked = made.noisy() + made.moved(4e-3), []

    def of(recordings):
        made.asked.append(recordings)
        other = LinearTakes(6 + len(made.asked))
        other.missed = other.noisy() + other.moved(4e-3)
        made.others.append(other)
        return other

    made.others = []
    monkeypatch.setattr(made, "of", of, raising=False)
    return made


def test_the_model_that_is_held_by_the_edge_is_fitted_to_and_judged_on_takes_held_so(world):
    kept = Named()
    found = held_by_edge(world, world, world.base(), kept)
    fitted, judge = world.others
    for driven in world.asked:
        assert len(driven) == len(world.recordings)
        for one, recording in zip(driven, world.recordings, strict=True):
            np.testing.assert_array_equal(one.held(one.time), driven_by_edge(recording).held(one.time))
    assert found.effects == ()
    assert found.fitted.vector == pytest.approx(fitted.base().vector, rel=0.05)
    residual = judge.residuals(found.fitted.vector[None], judge.off[None])[0]
    assert found.errors.squared_mm**0.5 == pytest.approx(float(judge.in_mm(residual)), rel=1e-6)


@pytest.mark.parametrize("lost", [0, 1])
def test_no_model_is_held_by_an_edge_that_one_of_the_takes_does_not_show(world, lost):
    recording = world.recordings[lost]
    garment = msgspec.structs.replace(recording.garment, held="corners")
    hidden = SimpleNamespace(recordings=[replace(recording, garment=garment), world.recordings[1 - lost]])
    assert held_by_edge(hidden, world, world.base(), Named()) is None
    assert held_by_edge(world, hidden, world.base(), Named()) is None
    assert edge_driven._all_driven([]) == []


def test_an_imagined_recording_says_what_each_parameter_and_each_effect_would_change(world, monkeypatch):
    """The residual is linear: the Jacobian is its matrix, a change its row times the amplitude as it is there."""
    problem = Problem(world)
    unit = problem.space.to_unit(np.array(SI.initial))
    unit[0] = 1 - JACOBIAN_STEP / 2  # beside its bound, from which the step leads back
    base = replace(world.base(), vector=problem.space.from_unit(unit))
    rng = np.random.default_rng(1)
    matrix, rows = rng.normal(size=(7, len(SI.initial))), rng.normal(size=(7, len(world.off)))
    asked = []

    def linear(given):
        asked.extend(given)
        return [
            1.0 + (problem.space.to_unit(v) * problem.space.scale) @ matrix.T + (a - world.off) @ rows.T
            for _, v, a in given
        ]

    monkeypatch.setattr(next_experiment, "residuals_together", linear)
    monkeypatch.setattr(next_experiment, "MENU", MENU[7:9])
    alive = []
    for name in ("gravity_tilt", "draught"):
        amplitudes = world.off.copy()
        amplitudes[world.columns[name]] = 0.3
        alive.append(replace(hypothesis((name,), 4.0), fitted=replace(base, amplitudes=amplitudes)))
    found = _imagined(world, ["one", "other"], base, alive)
    assert world.asked == [["one"], ["other"]]
    assert [one for one, *_ in asked] == world.others
    for motion, (jacobian, changes) in zip(MENU[7:9], found, strict=True):
        np.testing.assert_allclose(jacobian, matrix, rtol=1e-5, atol=1e-7)
        assert len(changes) == len(alive)
        for one, change in zip(alive, changes, strict=True):
            (name,) = one.effects
            factors = np.asarray(motion.turned.get(name, 1.0))
            expected = rows[:, world.columns[name]] @ np.broadcast_to(0.3 * factors, 2)
            np.testing.assert_allclose(change, expected, atol=1e-9)


def test_raw_recordings_are_of_material_points_from_which_no_camera_was_taken_out():
    take = a_take()
    sliding = replace(take, garment=msgspec.structs.replace(
        take.garment, format="hangtime-garment/2", points_are="silhouette", kind="skirt"))  # fmt: skip
    (raw,) = raw_recordings([sliding])
    assert raw.garment.point_kind == "material"
    assert not raw.camera.is_placed
    np.testing.assert_array_equal(raw.points, raw_recordings([take])[0].points)
    time, garment = np.arange(0, 12, 1 / 30), sheet(grid=5)
    points = hung(garment, time) + swing(time - 0.06, hz=0.9, stop=10.0)[:, None]  # stamped 60 ms late
    late = take_of(garment, time, swing(time, hz=0.9, stop=10.0), points)
    assert prepare(late).camera.timing.latency == pytest.approx(0.06, abs=0.001)
    assert raw_recordings([late])[0].camera == Camera()


def test_takes_are_ready_in_one_order_with_what_they_hold():
    takes = [replace(a_take(seed=seed), take_id=f"take{seed}") for seed in range(3)]
    found = ready(takes[:2], takes[2:])
    assert [one.take_id for one in found.training] == ["take0", "take1"]
    assert [one.take_id for one in found.held_out] == ["take2"]
    assert [*found.contents, *found.held_out_contents] == [content_of(take) for take in takes]
    assert len(found.contents) == 2
    turned = ready(takes[1::-1], takes[2:])
    assert [one.take_id for one in turned.training] == ["take0", "take1"]
    assert turned.contents == found.contents
    assert [[one.take_id for one in part] for part in turned.in_order(takes[1::-1], takes[2:])] == [
        ["take0", "take1"], ["take2"],
    ]  # fmt: skip
    alike = [replace(takes[0], take_id="take1", source=take.source, points=take.points) for take in takes[:2]]
    assert ready(alike, []).contents == ready(alike[::-1], []).contents
    wide = replace(takes[2], points=takes[2].points + 2.0)
    with pytest.raises(FitError, match=r"^take2: the point .* mm from the left held end, on the flat garment"):
        ready(takes[:2], [wide])
    with pytest.raises(FitError, match=r"^take2: the point "):
        ready([wide], takes[:1])

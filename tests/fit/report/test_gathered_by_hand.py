"""What a report simulates: which takes, materials, amplitudes and pull, and which runs it shows of them."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from msgspec.structs import replace

from fit.cloth import material as mat
from fit.effects import find_effects
from fit.methods import KINECT_SKIRT, SI
from fit.recordings.recording import prepare
from fit.report import gather
from tests.fit.export.exported import a_fit
from tests.fit.report.report_scene import diagnosis
from tests.fit.scenes import hung, sheet, swing, take_of

EFFECTS = find_effects(["hem", "air_drag"])


class Asked:
    """Stands in for the simulator: each candidate's points are off by as many millimetres as its number."""

    def __init__(self, recording, effects, resolution):
        self.mesh = SimpleNamespace(area=0.25, triangles=np.array([[0, 1, 2]]))
        self._recording = recording
        Asked.made.append((recording.take_id, [e.name for e in effects], resolution))

    def run(self, materials, amplitudes, **more):
        Asked.runs.append((materials, amplitudes.tolist(), more))
        points = np.stack([self._recording.points + 1e-3 * k for k in range(len(materials))])
        points[list(Asked.broken)] = np.nan
        return SimpleNamespace(points=points, shapes=np.ones((len(materials), len(points[0]), 4, 3), np.float32))


@pytest.fixture(autouse=True)
def asked(monkeypatch):
    Asked.made, Asked.runs, Asked.broken = [], [], ()
    written = []
    monkeypatch.setattr(gather, "Simulator", Asked)
    monkeypatch.setattr(gather, "_written", lambda path, fitted, findings, motions, origin: written.append(
        (path, fitted, findings, origin)) or motions)  # fmt: skip
    monkeypatch.setattr(gather, "origin_of", lambda takes, first, command: ("origin", first, command))
    return written


def a_recording(name):
    garment, time = sheet(mass=0.05), np.arange(0, 2, 1 / 30)
    return prepare(take_of(garment, time, swing(time), hung(garment, time) + swing(time)[:, None], name=name))


TAKES = SimpleNamespace(training=[a_recording("a")], held_out=[a_recording("b")])


def found(named, best=True):
    """Findings of a diagnosis whose named fit has half of the stretch stiffness and a hem."""
    vector = SI.initial * [0.5, 1, 1, 1, 1]
    fit = SimpleNamespace(vector=vector, amplitudes=np.array([0.01, 0.0]), active=("hem",)) if best else None
    base = SimpleNamespace(vector=SI.initial, amplitudes=np.zeros(2), active=())
    return SimpleNamespace(
        effects=EFFECTS, best=fit, diagnosis=diagnosis(named=named), takes=TAKES, resolution="mesh", model=SI,
        base=base, frequency=1.5,
    )  # fmt: skip


def test_a_diagnosis_shows_base_named_and_fitted_cloth_of_every_take_under_its_pull(asked):
    fit = a_fit(effects={"air_drag": 1.3})
    held_out, training = gather.write_diagnosis_report("page", found(["hem"]), fit, "first", "command")
    assert Asked.made == [(name, ["hem", "air_drag"], "mesh") for name in ("b", "a")]
    for materials, amplitudes, more in Asked.runs:
        assert materials[:, mat.STRETCH] == pytest.approx([SI.initial[0], SI.initial[0] / 2, 100.0])
        assert materials[:, mat.DENSITY] == pytest.approx(0.2)
        assert amplitudes == [[0.0, 0.0], [0.01, 0.0], [0.0, 1.3]]
        assert more == {"observer_hz": 1.5, "shapes": True}
    assert (held_out.take_id, held_out.is_held_out) == ("b", True)
    assert (training.take_id, training.is_held_out) == ("a", False)
    assert (held_out.shown, held_out.pull_hz) == (("base", "with_effect", "fit"), 1.5)
    for k, run in enumerate(("base", "with_effect", "fit")):
        assert held_out.runs[run].points == pytest.approx(held_out.real + 1e-3 * k)
        assert held_out.runs[run].mesh.shape == (60, 4, 3)
    recording = TAKES.held_out[0]
    assert held_out.held == pytest.approx(recording.held(recording.time).reshape(-1, 2, 3))
    assert held_out.free.tolist() == recording.judged.tolist()
    assert held_out.outline == pytest.approx(np.array(sheet().outline_m))
    assert held_out.point_names == tuple(p.name for p in sheet().points)
    assert asked[0][3] == ("origin", "first", "command")


@pytest.mark.parametrize(("named", "best"), [([], True), (["hem"], False)])
def test_without_a_named_effect_or_its_fit_only_the_base_model_is_shown(named, best):
    for motion in gather.write_diagnosis_report("page", found(named, best), None):
        assert motion.shown == ("base",)


def test_a_fit_of_another_simulator_is_not_shown_beside_a_diagnosis():
    other = a_fit("kinect-skirt", engine="blender")
    assert gather.write_diagnosis_report("page", found([]), other)[0].shown == ("base",)


def test_a_fit_shows_the_cloth_before_and_after_it_freely_and_no_run_that_blew_up():
    fit = a_fit(effects={"hem": 0.012})
    request = SimpleNamespace(method=SI, engine="own", effects=EFFECTS[:1], resolution="mesh")
    held_out, training = gather.write_fit_report("page", fit, TAKES, request)
    materials, amplitudes, more = Asked.runs[0]
    assert materials[:, mat.STRETCH] == pytest.approx([SI.initial[0], 100.0])
    assert (amplitudes, more) == ([[0.0], [0.012]], {"shapes": True})
    assert (held_out.shown, held_out.pull_hz, training.is_held_out) == (("before", "after"), 0.0, False)
    assert held_out.triangles.tolist() == [[0, 1, 2]]
    Asked.broken = (0,)
    assert gather.write_fit_report("page", fit, TAKES, request)[0].shown == ("after",)


def test_a_fit_of_another_simulator_shows_its_points_and_no_cloth(monkeypatch):
    def maker(recording, method, effects, resolution):
        assert (method, effects, resolution.spacing) == (KINECT_SKIRT, (), 0.1)
        return SimpleNamespace(points=lambda vectors: np.stack([recording.points + v[0] for v in vectors]))

    monkeypatch.setattr(gather, "find_engine", lambda name: maker)
    fit = a_fit("kinect-skirt", engine="blender", values={"mass": 3.0})
    request = SimpleNamespace(
        method=KINECT_SKIRT, engine="blender", effects=(), resolution=SimpleNamespace(spacing=0.1)
    )  # fmt: skip
    shown = gather.write_fit_report("page", fit, TAKES, request)[0]
    assert shown.runs["before"].points == pytest.approx(shown.real + KINECT_SKIRT.initial[0])
    assert shown.runs["after"].points == pytest.approx(shown.real + 3.0)
    assert shown.runs["after"].mesh is None
    assert not Asked.runs


@pytest.mark.parametrize(
    ("named", "has_held_out", "title"),
    [(["hem"], True, "b, hem"), ([], True, "b, base model"), (["hem"], False, "a, hem")],
)
def test_residuals_are_drawn_of_the_named_model_on_the_first_take_that_is_judged(
    monkeypatch, named, has_held_out, title
):
    drawn = []
    monkeypatch.setattr(
        "fit.report.residual_picture.draw_residuals",
        lambda recording, points, path, title, overwrite: drawn.append((recording.take_id, title, overwrite)),
    )
    findings = found(named)
    if not has_held_out:
        findings.takes = SimpleNamespace(training=TAKES.training, held_out=[])
    gather.draw_left("left.png", findings, overwrite=True)
    assert drawn == [(title[0], title, True)]
    materials, amplitudes, more = Asked.runs[0]
    assert materials[0, mat.STRETCH] == pytest.approx(SI.initial[0] / (2 if named else 1))
    assert (amplitudes, more) == ([[0.01 if named else 0.0, 0.0]], {"observer_hz": 1.5})
    gather.draw_left("left.png", found(["hem"], best=False))
    assert drawn[-1][1:] == ("b, base model", False)


@pytest.mark.parametrize(("points_are", "left"), [("material", 0.003), ("silhouette", 0.0)])
def test_a_picture_of_residuals_has_the_error_of_the_report_without_the_mean_offset_of_a_silhouette(
    monkeypatch, points_are, left
):
    time, drawn = np.arange(0, 2, 1 / 30), []
    garment = replace(sheet(mass=0.05), format="hangtime-garment/2", points_are=points_are)
    recording = prepare(take_of(garment, time, swing(time), hung(garment, time) + swing(time)[:, None]))

    def run(self, materials, amplitudes, **more):
        return SimpleNamespace(points=(recording.points + np.array([0.0, 0.003, 0.0]))[None])

    monkeypatch.setattr(Asked, "run", run)
    monkeypatch.setattr(
        "fit.report.residual_picture.draw_residuals", lambda recording, points, *_, **more: drawn.append(points)
    )
    findings = found(["hem"])
    findings.takes = SimpleNamespace(training=[], held_out=[recording])
    gather.draw_left("left.png", findings)
    apart = np.linalg.norm(drawn[0] - recording.points, axis=2)[recording.counted]
    assert np.sqrt(np.mean(apart**2)) == pytest.approx(left, abs=1e-12)

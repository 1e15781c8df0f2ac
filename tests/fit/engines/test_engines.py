"""The engines fulfil one contract: our own, and Blender if bpy is installed."""

from __future__ import annotations

import numpy as np
import pytest

from fit.cloth.model import Resolution
from fit.engines import BlenderEngine, OwnEngine, find_engine
from fit.engines.blender import blender_settings
from fit.errors import FitError
from fit.foreign.process import BLENDER
from fit.identification.calibrate import Model, calibrate
from fit.identification.request import request_of
from fit.methods import KINECT_SKIRT, SI
from fit.recordings.recording import prepare
from tests.fit.scenes import hung, material, sheet, simulate_take, swing, take_of

COARSE = Resolution(spacing=0.05)


needs_blender = pytest.mark.skipif(
    "not BLENDER.is_installed()", reason=f"bpy is in neither this Python nor the one {BLENDER.variable} names"
)


def still(seconds=1.0):
    time = np.arange(0, seconds, 1 / 30)
    return prepare(take_of(sheet(), time, np.zeros((len(time), 3)), hung(sheet(), time)))


def test_the_own_engine_is_the_simulator_with_the_methods_map():
    recording = still()
    engine = OwnEngine(recording, SI, (), COARSE)
    direct = engine.simulator.run(SI.to_materials(SI.initial[None], sheet().areal_density)).points
    assert np.abs(engine.points(SI.initial[None]) - direct).max() < 1e-6


def test_blenders_numbers_by_hand():
    """Mass 1, Air 5, Velocity 0.95: 0.05 + 25 x 0.051293 = 1.3323 /s, 13 times Blender's most; all else shrinks too."""
    mass, tension, bending, damping, air, shear = blender_settings(KINECT_SKIRT.initial[None])[0]
    assert air == pytest.approx(10.0)
    assert 0.01 * air / mass == pytest.approx(1.33233, rel=1e-5)
    assert tension / mass == pytest.approx(30.0)
    assert bending / mass == pytest.approx(20.0)
    assert damping / mass == pytest.approx(3.0)
    assert shear / tension == pytest.approx(0.1)


def test_gentle_drag_is_handed_on_as_it_is():
    """Velocity 1 and Air 4 at Mass 2 stay within Blender's range: nothing shrinks."""
    row = blender_settings(np.array([[2.0, 30.0, 20.0, 3.0, 4.0, 1.0]]))[0]
    assert row == pytest.approx([2.0, 30.0, 20.0, 3.0, 4.0, 3.0])


def test_blender_takes_its_own_parameters_and_no_effects():
    from fit.effects import find_effects

    with pytest.raises(FitError, match="Blender has no si parameters"):
        BlenderEngine(still(), SI, (), COARSE)
    with pytest.raises(FitError, match="cannot be given effects"):
        BlenderEngine(still(), KINECT_SKIRT, find_effects(["hem"]), COARSE)


def test_a_python_without_bpy_is_named(monkeypatch, tmp_path):
    python = tmp_path / "python"
    python.write_text("#!/bin/sh\nexit 1\n")
    python.chmod(0o755)
    monkeypatch.setenv(BLENDER.variable, str(python))
    with pytest.raises(FitError, match=r"bpy cannot be started; in Hangtime's checkout: pip install -e '.\[blender\]'"):
        BlenderEngine(still(), KINECT_SKIRT, (), COARSE)


def test_a_python_that_is_not_there_is_named(monkeypatch, tmp_path):
    monkeypatch.setenv(BLENDER.variable, str(tmp_path / "nowhere"))
    with pytest.raises(FitError, match="bpy cannot be started"):
        BlenderEngine(still(), KINECT_SKIRT, (), COARSE)


def test_an_unknown_engine_is_refused_before_any_take_is_read():
    with pytest.raises(FitError, match="there is no engine named 'maya'; known engines: own, blender"):
        request_of(KINECT_SKIRT, [], iterations=1, seed=0, spacing=0.1, engine="maya")
    assert find_engine("own") is OwnEngine


@needs_blender
def test_blenders_sheet_swings_at_the_frequency_of_a_hanging_chain():
    """1.2024 sqrt(g / L) / (2 pi) = 0.893 Hz at 0.45 m, without drag."""
    time = np.arange(0, 8, 1 / 30)
    nudge = swing(time, amplitude=0.008, hz=0.9, stop=2.0)
    recording = prepare(take_of(sheet(), time, nudge, hung(sheet(), time)))
    vector = np.array([[0.5, 30.0, 0.1, 0.0, 1.0, 1.0]])
    bottom = BlenderEngine(recording, KINECT_SKIRT, (), COARSE).points(vector)[0, time > 2.6, 2, 1]
    crossings = np.flatnonzero(np.diff(np.sign(bottom - bottom.mean())))
    hertz = (len(crossings) - 1) / 2 / ((crossings[-1] - crossings[0]) / 30)
    assert hertz == pytest.approx(1.2024 * np.sqrt(9.80665 / 0.45) / (2 * np.pi), rel=0.02)


@needs_blender
def test_blenders_held_edge_follows_the_hanger():
    time = np.arange(0, 2, 1 / 30)
    recording = prepare(take_of(sheet(), time, swing(time), hung(sheet(), time)))
    found = BlenderEngine(recording, KINECT_SKIRT, (), COARSE).points(KINECT_SKIRT.initial[None])[0]
    assert np.abs(found[:, :2] - recording.held(time).reshape(-1, 2, 3)).max() < 2e-3


@pytest.mark.slow
@needs_blender
def test_a_fit_with_blender_lowers_the_error_of_a_take_that_our_cloth_made():
    """Twelve iterations on a two-second take; no SI material is claimed."""
    time = np.arange(0, 2, 1 / 30)
    take = simulate_take(sheet(), time, swing(time, hz=1.2), material(sheet(), velocity_damping=0.5))
    request = request_of(KINECT_SKIRT, [], iterations=12, seed=1, spacing=0.1, engine="blender")
    result = calibrate([take], [], request)
    assert result.error.train_after.mean_m < result.error.train_before.mean_m
    assert result.material == {}
    assert result.combinations == []
    assert "Simulated by blender" in " ".join(result.notes)
    assert np.isfinite(Model([prepare(take)], request).points(KINECT_SKIRT.initial[None])[0]).all()

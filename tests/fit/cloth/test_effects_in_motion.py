"""Effects within the solver's step: their components, and the kernel that they need."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from fit.cloth.model import Resolution
from fit.cloth.simulator import Simulator
from fit.cloth.support import hanger
from fit.effects import find_effects
from fit.recordings.recording import prepare
from tests.fit.scenes import hung, material, sheet, swing, take_of


def test_a_wind_pushes_along_its_own_axis_and_tiny_effects_leave_bending_as_it_is():
    """Hung in the plane of x and z: a wind along y pushes the hem that way, and one along x passes by.

    Stiff cloth follows its bar, in the kernel without effects and in the one with next to no rest curvature.
    """
    garment, time = sheet(grid=3), np.arange(20) / 60
    path = swing(time, start=0.0, amplitude=0.05, hz=3.0)
    recording = prepare(take_of(garment, time, path, hung(garment, time) + path[:, None]))
    options = {
        "resolution": Resolution(spacing=0.2),
        "support": lambda mesh: dataclasses.replace(hanger(recording)(mesh), settle_time=0.0),
    }
    stiff = material(garment, bending_stiffness=5e-3, bending_damping_time=0.02)
    plain = Simulator(recording, **options).run(stiff).points[0]
    chosen = find_effects(["draught", "rest_curvature"])
    winds = np.array([[0.0, 0.0, 1e-9, 0.0], [0.3, 0.0, 0.0, 0.0], [0.0, 0.3, 0.0, 0.0]])
    still, along, across = Simulator(recording, chosen, **options).run(np.repeat(stiff, 3, 0), winds).points
    assert plain[-1, 7, 1] > 5e-3  # limp cloth would stay behind, at -0.5 mm
    assert still == pytest.approx(plain, abs=1e-5)  # 3e-8 m are a rounding of 0.45 m in single precision
    by_wind = np.stack([along, across])[:, -1, 7, 1] - still[-1, 7, 1]
    assert abs(by_wind[0]) < 2e-3
    assert by_wind[1] > 1e-2

"""The range, the typical size and the flags of every effect: the figures that its file derives or cites."""

from __future__ import annotations

import numpy as np
import pytest

from fit.effects import LIBRARY
from formats.nature import AIR_DENSITY

# Each row: the least, the typical and the largest size in the effect's unit, then the spread of sound laws.
RANGES = {
    "shear_stiffness": (0.0, 20.0, 220.0, 0.08),
    "bending_hysteresis": (0.0, 2e-4, 2e-3, 0.15),
    "rest_curvature": (-40.0, 5.0, 40.0, 0.25),
    "hem": (0.0, 0.01, 0.05, 0.12),
    "anisotropy": (-3.0, 0.7, 3.0, 0.08),
    "strain_stiffening": (0.0, 40.0, 200.0, 0.08),
    "bending_viscosity": (0.0, 1e-6, 2e-5, 0.08),
    "stretch_viscosity": (0.0, 1e-3, 3e-3, 0.08),
    "mass_distribution": (-0.8, 0.3, 0.8, 0.08),
    "self_contact": (0.0, 0.005, 0.02, 0.08),
    "hanger_compliance": (0.0, 7e-4, 4e-3, 0.2),
    "hanger_rotation": (-0.3, 0.03, 0.3, 0.08),
    "attachment_offset": (-0.05, 0.01, 0.05, 0.03),
    "clip_slip": (-0.002, 0.005, 0.05, 0.2),
    "clip_slack": (-0.03, 0.008, 0.03, 0.08),
    "air_drag": (0.0, 1.2, 3.0, 0.1),
    "added_mass": (0.0, 0.1, 0.6, 0.08),
    "draught": (-1.0, 0.3, 1.0, 0.2),
    "air_lift": (0.0, 2.0, 8.0, 0.4),
    "time_offset": (-0.1, 0.02, 0.1, 0.0),
    "gravity_tilt": (-0.1, 0.03, 0.1, 0.0),
    "depth_scale": (-0.06, 0.01, 0.06, 0.08),
    "filter_lag": (0.0, 0.02, 0.2, 0.08),
    "corner_erosion": (-0.005, 0.008, 0.04, 0.2),
    "clock_drift": (-0.03, 0.005, 0.03, 0.0),
    "tracker_smoothing": (0.0, 0.4, 1.5, 0.3),
    "sliding_points": (0.0, 0.5, 1.5, 0.2),
    "eroded_outline": (-0.15, 0.03, 0.15, 0.2),
    "frame_timing": (-0.5, 0.5, 1.5, 0.1),
}
BY_NAME = {one.name: one for one in LIBRARY}


def test_every_effect_is_searched_over_the_range_that_its_file_states():
    found = {one.name: (one.low, one.typical, one.high, one.law_spread) for one in LIBRARY}
    assert found == RANGES


def test_only_these_effects_need_more_of_the_simulator_or_differ_by_it():
    flags = {
        flag: [one.name for one in LIBRARY if getattr(one, flag)]
        for flag in ("adds_mass", "bends", "touches", "goes_beyond_base", "differs_by_solver")
    }
    assert flags == {
        "adds_mass": ["added_mass"], "bends": ["bending_hysteresis", "rest_curvature"], "touches": ["self_contact"],
        "goes_beyond_base": ["bending_viscosity"], "differs_by_solver": ["anisotropy", "stretch_viscosity"],
    }  # fmt: skip


def test_a_size_of_nothing_and_the_typical_size_are_within_the_range_of_every_effect():
    for one in LIBRARY:
        assert one.low <= 0.0 < one.typical < one.high, one.name


@pytest.mark.parametrize(
    ("name", "end", "derived"),
    [
        ("corner_erosion", "low", -2 * 1.6 / 576),  # m: pixels at 1.6 m, of a focal length of 576 px
        ("corner_erosion", "typical", 3 * 1.6 / 576),
        ("corner_erosion", "high", 14 * 1.6 / 576),
        ("depth_scale", "high", 2 * 0.03),
        ("clock_drift", "high", 60 * 500e-6),
        ("clock_drift", "typical", 10 * 500e-6),
        ("filter_lag", "high", 6 / 30),  # s, frames
        ("gravity_tilt", "high", 2 * np.radians(3)),
        ("hanger_rotation", "high", np.radians(17)),
        ("hanger_rotation", "typical", np.radians(1.7)),
        ("hanger_compliance", "high", (2 * np.pi * 2.5) ** -2),  # s^2, of a frequency in Hz
        ("hanger_compliance", "typical", (2 * np.pi * 6) ** -2),
        ("anisotropy", "high", np.log(20)),
        ("anisotropy", "typical", np.log(2)),
        ("bending_viscosity", "high", 1.4 * 1.4e-5),
        ("bending_viscosity", "typical", 0.07 * 1.4e-5),
        ("added_mass", "high", AIR_DENSITY * np.pi / 4 * 0.63),  # kg/m^2, of a strip's width in m
        ("added_mass", "typical", AIR_DENSITY * np.pi / 4 * 0.1),
    ],
)
def test_a_size_is_the_figure_that_it_was_derived_from_to_one_unit_of_its_first_digit(name, end, derived):
    unit = 10 ** np.floor(np.log10(abs(derived)))
    assert getattr(BY_NAME[name], end) == pytest.approx(derived, abs=unit)

"""The cloth against closed forms, as `benchmarks/validation.py` prints them: at 50 mm, or 33 mm where that misses."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.validation import CARD, CASES, bending_damping_error, bending_modes, ring
from benchmarks.validation_clamped import bias_extension_error, elastica
from benchmarks.validation_energy import energy_drift
from fit.cloth.model import Resolution


def test_the_reference_goes_from_a_chain_to_a_rigid_plate():
    """1.2024 sqrt(g / L) without bending; sqrt(3 g / (2 L)) where nothing bends."""
    assert bending_modes(1e-8)[0] == pytest.approx(1.2024 * np.sqrt(9.80665 / 0.45), rel=1e-4)
    assert bending_modes(100.0)[0] == pytest.approx(np.sqrt(1.5 * 9.80665 / 0.45), rel=2e-3)


def test_cloth_without_bending_is_far_from_how_card_swings():
    """The second mode depends on stiffness: a case that limp cloth met as well would check nothing."""
    limp, _ = ring(Resolution(spacing=0.05), 2, seconds=5.0, amplitude=0.0005)
    assert limp == pytest.approx(0.583 * bending_modes(CARD)[1], rel=0.01)


@pytest.mark.slow
def test_short_steps_far_from_the_origin_lose_nothing_by_rounding():
    """In a step of 16 us the ring-down of card moves by hardly more than positions 1.5 m away can be resolved."""
    assert abs(bending_damping_error(Resolution(spacing=0.05, step_share=0.25))) < 0.005


def test_the_elastica_goes_from_a_beam_to_a_rope():
    """Short: it drops by L^4 / (8 c^3). Long: it bends down within sqrt(c^3 / L), 11 mm, and hangs straight."""
    assert elastica(0.1, 0.3)[1] == pytest.approx(0.1**4 / (8 * 0.3**3), rel=1e-3)
    reach, drop = elastica(1.0, 0.05)
    assert 0.005 < reach < 0.03
    assert 0.97 < drop < 1.0


def test_peirces_formula_is_two_percent_above_the_elastica():
    """At an overhang of twice the bending length the tip hangs at 41.5 degrees, as fabric testers tilt their plate."""
    reach, drop = elastica(2.0, 1.0)
    angle = np.arctan2(drop, reach)
    assert np.degrees(angle) == pytest.approx(41.5, abs=0.05)
    assert 2.0 * np.cbrt(np.cos(angle / 2) / (8 * np.tan(angle))) == pytest.approx(1.0188, abs=2e-4)


@pytest.mark.slow
def test_a_sample_cut_on_the_bias_is_pulled_as_a_net_of_threads_says():
    """Threads 200 times as stiff as the shear: softer than a net of inextensible ones by about sqrt(1 / 200) = 7 %.

    2000 times: by about 2 %. Elements of 0.3 m, six along the sample, which they cross slantwise, do not lock: they are
    softer by 2 % more, where they were harder by 17 % as long as threads had twelve samples to an element.
    """
    soft = bias_extension_error(Resolution(spacing=0.05), 200.0)
    assert -0.09 < soft < -0.083
    coarse, fine = (bias_extension_error(Resolution(spacing=s), 2000.0) for s in (0.1, 0.05))
    assert -0.05 < fine < -0.02
    assert abs(coarse - fine) < 0.03


@pytest.mark.slow
def test_energy_is_lost_as_fast_as_damping_says():
    """At c it goes as e^(-c t): 1 - e^(-0.5) in ten seconds at 0.05 1/s."""
    lost = energy_drift(Resolution(spacing=0.05), damping=0.05)
    assert lost == pytest.approx(np.expm1(-0.5), rel=0.02)


NEEDS_FINER = ("swung swatch, mesh doubled and step halved",)  # than 50 mm


# `test_cloth.py` has a quicker test of meshes that converge, `test_patterns.py` of a sheet on the bias.
SLOW = (
    "second swing",
    "force of a load beside its own weight",
    "swung swatch, mesh doubled and step halved",
    "force of a bias extension",
    "energy over 10 s, no damping",
    "its decay at a bending damping time of 5 ms",
)


@pytest.mark.parametrize(
    "name", [pytest.param(case.name, marks=[pytest.mark.slow] if case.name in SLOW else []) for case in CASES]
)
def test_a_mesh_keeps_to_the_closed_form(name):
    case = next(c for c in CASES if c.name == name)
    assert abs(case.error(Resolution(spacing=0.033 if name in NEEDS_FINER else 0.05))) < case.allowed

"""The cloth against closed forms, as `benchmarks/validation.py` prints them, at one mesh each."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.validation import CASES, bending_reference
from fit.cloth.simulator import Resolution


def test_the_reference_goes_from_a_chain_to_a_rigid_plate():
    """1.2024 sqrt(g / L) without bending; sqrt(3 g / (2 L)) where nothing bends."""
    assert bending_reference(1e-8) == pytest.approx(1.2024 * np.sqrt(9.80665 / 0.45), rel=1e-4)
    assert bending_reference(100.0) == pytest.approx(np.sqrt(1.5 * 9.80665 / 0.45), rel=2e-3)


@pytest.mark.parametrize(
    "name", ["first swing", "second swing", "first swing with bending 0.01 N m", "stretch under its own weight"]
)
def test_a_mesh_of_50_mm_keeps_to_the_closed_form(name):
    case = next(c for c in CASES if c.name == name)
    assert abs(case.error(Resolution(spacing=0.05))) < case.allowed

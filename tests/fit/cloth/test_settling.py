"""The settling benchmark measures the stated quantity."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.settling import ASIDE, SHOWN, Hung, Scene, fabrics, measure, shown_by


@pytest.mark.slow  # that cloth shown swung aside hangs straight down is tested in `test_cloth.py`, quickly
def test_taut_cloth_held_at_an_edge_finds_its_rest_whatever_its_points_show():
    """It has one; after 0.5 s of settling in place of 1.6 a swung sheet is still a centimetre from it."""
    scene, rows = Scene(0.45, "edge", None, 0.0), fabrics(2, 5)
    found = measure(scene, rows)
    assert max(found[what].max() for what in SHOWN) < 0.3
    assert measure(scene, rows, 0.5)[SHOWN[2]].min() > 5.0


def test_the_rest_that_the_points_show():
    """Two fabrics: their own rests, each other's, and a rest swung aside by 60 mm at the bottom."""
    rests = [Hung(np.array([[0.0, 0.0, 0.0], [0.0, y, -0.4]]), np.zeros((0, 3))) for y in (0.01, -0.02)]
    assert shown_by(SHOWN[0], rests, 1)[1, 1] == -0.02
    assert shown_by(SHOWN[1], rests, 1)[1, 1] == 0.01
    assert shown_by(SHOWN[2], rests, 1)[:, 1] == pytest.approx([0.0, ASIDE - 0.02])

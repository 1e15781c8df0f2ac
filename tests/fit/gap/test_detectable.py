"""The sizes that could not have been seen, in words."""

from __future__ import annotations

import numpy as np
import pytest

from fit.gap.detectable import in_words, mesh_share, resolvable, unseen
from tests.fit.gap.verdict_scene import KINDS, evidence_of


def test_components_whose_typical_size_would_not_show_are_told_the_nearest_to_it_first():
    smallest = {
        "gravity_tilt": np.array([0.056, 0.02]), "air_drag": np.array([1.3]), "hem": np.array([0.0099]),
        "draught": np.array([np.inf, np.inf]),
    }  # fmt: skip
    assert unseen(KINDS, smallest) == ["air drag below 1.3", "tilted gravity (x) below 3.2 degrees"]


def test_sizes_have_their_units():
    assert (in_words(0.0561, "rad"), in_words(0.0123, "m"), in_words(1.25, "1")) == ("3.2 degrees", "0.012 m", "1.2")


@pytest.mark.parametrize(
    ("name", "numerics", "floor", "size"),
    [
        # 0.5 x 4^2 = 8 mm^2 of mesh and solver beside 0.2 x 5^2 = 5 of noise; 0.001 moves the points by 2 mm.
        ("air_drag", 4.0, 5.0, np.sqrt(8.0) * 0.0005),
        ("air_drag", 3.0, 5.0, np.sqrt(5.0) * 0.0005),
        ("anisotropy", 4.0, 5.0, np.sqrt(48.0) * 0.0005),
    ],
)
def test_an_effect_moves_the_points_by_as_much_as_the_verdict_asks_for(name, numerics, floor, size):
    evidence = evidence_of({name: 6.0}, floor=floor)
    object.__setattr__(evidence, "numerics_mm", numerics)
    assert resolvable(evidence, name) == pytest.approx(size)
    assert mesh_share(KINDS[name]) == (3.0 if name == "anisotropy" else 0.5)

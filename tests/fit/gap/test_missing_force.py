"""What the missing force looks like, in words and of forces that are known."""

from __future__ import annotations

import pytest

from fit.gap.missing_force import find_missing_force, sentence_of
from fit.methods import SI
from fit.observer.residuals import Observer
from fit.recordings.recording import prepare
from tests.fit.gap.test_diagnosis_parts import COARSE, a_take, truth_vector


@pytest.mark.parametrize(
    ("normal", "words"),
    [(0.8, "mostly along the cloth's normal (80 %)"), (0.3, "in all directions, also along the cloth's normal (30 %)"),
     (0.08, "within the cloth and hardly along the cloth's normal (8 %)")],
)  # fmt: skip
def test_the_missing_forces_direction_is_told_in_words(normal, words):
    said = sentence_of(normal, 0.03, 0.6, None, {"top": 0.1, "bottom": 0.9}, power=-1.0)
    assert words in said
    assert "acts like inertia or a constant load" in said
    assert "the bottom third" in said


@pytest.mark.parametrize(("damping", "words"), [(0.3, "opposes motion"), (5.0, "drives motion")])
def test_what_the_base_model_damps_too_little_opposes_motion_and_too_much_drives_it(damping, words):
    """The cloth is damped by 1.5 1/s: the missing force is -(1.5 - damping) v, along the velocity."""
    recording = prepare(a_take(noise=1e-4))
    observer = Observer([recording], SI, (), frequency=0.0, resolution=COARSE)
    vector = truth_vector()
    vector[[p.name for p in SI.parameters].index("velocity_damping")] = damping
    found = find_missing_force(observer, vector)
    assert words in found.sentence
    assert found.power == pytest.approx(-abs(found.power) if damping < 1.5 else abs(found.power))
    assert found.odd_share > 0.6
    assert found.amplitude_exponent == pytest.approx(1.0, abs=0.5)


def test_struck_drag_is_along_the_normal_and_grows_with_the_square_of_speed():
    recording = prepare(a_take("a", "air_drag", 2.5, noise=1e-4))
    observer = Observer([recording], SI, (), frequency=0.0, resolution=COARSE)
    found = find_missing_force(observer, truth_vector())
    assert found.power < 0
    assert found.odd_share > 2 * found.even_share
    assert found.normal_share > 0.8
    assert found.amplitude_exponent == pytest.approx(2.0, abs=0.3)


def test_the_missing_force_is_seen_in_the_top_third_as_well():
    """Of 25 points the 5 on the edge cannot be pulled; the top third has 5 more."""
    recording = prepare(a_take())
    observer = Observer([recording], SI, (), frequency=0.0, resolution=COARSE)
    found = find_missing_force(observer, truth_vector())
    assert found.spatial_share["top"] > 0.0
    assert len(found.places) == 20

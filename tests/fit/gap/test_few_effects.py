"""Diagnoses whose library holds one effect, or none that the base model lacks."""

from __future__ import annotations

import pytest

from fit.cloth.model import Resolution
from fit.effects import find_effects
from fit.errors import FitError
from fit.gap.diagnosis import diagnose
from tests.fit.gap.test_diagnosis_parts import a_take

MESH = Resolution(spacing=0.2)


def test_a_fit_with_every_effect_of_the_library_is_weighed_and_its_mass_is_the_effects_probability():
    """A hem of twice its typical size; no rule tests it by its closure, so that it has no p-value."""
    takes = [a_take("a", "hem", 0.02), a_take("b", "hem", 0.02, hz=1.0, seed=1)]
    found = diagnose(takes[:1], takes[1:], effects=find_effects(["hem"]), resolution=MESH, by="evidence").diagnosis
    assert (found.verdict, found.named) == ("effect", ["hem"]), found.sentence
    (hem,) = found.effects
    assert hem.tested
    assert hem.probability > 0.999
    assert hem.p_value is None
    assert hem.amplitude_interval[0] < 0.02 < hem.amplitude_interval[1]


@pytest.mark.parametrize("by", ["rules", "evidence"])
def test_a_library_of_parameters_of_the_base_model_is_refused_before_anything_is_simulated(by):
    begun = []
    with pytest.raises(FitError) as caught:
        diagnose(
            [a_take()], [], effects=find_effects(["shear_stiffness", "bending_viscosity"]), resolution=MESH, by=by,
            begun=lambda: begun.append(by),
        )  # fmt: skip
    assert str(caught.value.what) == "no effect is left to test: the base model contains each of them"
    assert caught.value.where == "--without"
    assert begun == []

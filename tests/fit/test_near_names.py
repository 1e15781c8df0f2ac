"""A misspelt name is answered with the names that it probably means, wherever names are chosen."""

from __future__ import annotations

import re
from typing import get_type_hints

import pytest

from fit.api.takes import library_of
from fit.blind.foreign.engines import find_generator
from fit.blind.plants import PLANTS, choose_plants
from fit.cli import diagnose_command
from fit.effects import LIBRARY, find_effects, library_without
from fit.engines import find_engine
from fit.errors import FitError
from fit.gap.diagnosis import deciding
from fit.identification.request import Plan, request_of
from fit.methods import BASE_MODELS, METHODS, SI, find_base_model, find_method
from fit.methods.fabrics import find_fabric
from fit.recordings.selection import split_by_motion
from fit.search.choice import SEARCHES, check_search
from formats.near_names import near_names

EFFECTS = sorted(effect.name for effect in LIBRARY)
PARAMETERS = [parameter.name for parameter in SI.parameters]


def bounded(name):
    return request_of(SI, [], iterations=1, seed=0, spacing=0.1, bounds=[f"{name}=1:2"])


@pytest.mark.parametrize(
    ("name", "known", "meant"),
    [
        ("drag", EFFECTS, ["air_drag"]),
        ("Air drag", EFFECTS, ["air_drag"]),
        ("tilt", EFFECTS, ["gravity_tilt"]),
        ("air", EFFECTS, ["air_drag", "air_lift"]),
        ("hemm", EFFECTS, ["hem"]),
        ("stretch_viscosty", EFFECTS, ["stretch_viscosity"]),
        (7, EFFECTS, []),
        ("gremlins", EFFECTS, []),
        ("", EFFECTS, []),
        ("squares", list(SEARCHES), ["least-squares"]),
        ("strech", PARAMETERS, ["stretch_stiffness"]),
        ("bendng", PARAMETERS, ["bending_stiffness", "bending_damping_time"]),
        ("drg", EFFECTS, ["air_drag"]),
        ("drag_air", EFFECTS, ["air_drag"]),
        ("Drag-air", EFFECTS, ["air_drag"]),
        ("drag_ar", EFFECTS, ["air_drag"]),
        ("offset_tim", EFFECTS, ["time_offset"]),
        ("squares-least", list(SEARCHES), ["least-squares"]),
        ("skirt-kinect", list(BASE_MODELS), ["kinect-skirt"]),
    ],
)
def test_a_wrong_name_means_those_that_have_it_as_a_word_or_else_similar_ones(name, known, meant):
    assert near_names(name, known) == meant


@pytest.mark.parametrize(
    ("asked", "name", "meant"),
    [
        (lambda name: find_effects([name]), "drag", "air_drag"),
        (find_method, "kinect_skirt", "kinect-skirt"),
        (find_fabric, "coton", "cotton"),
        (find_fabric, "satn", "silk"),
        (find_fabric, "jeans", "denim"),
        (find_fabric, "rayon-polyester", "polyester-rayon"),
        (lambda name: find_effects([name]), "drag_air", "air_drag"),
        (lambda name: find_effects([name]), "wind", "draught"),
        (check_search, "levenberg", "least-squares"),
        (find_engine, "blendr", "blender"),
        (find_generator, "mujco", "mujoco"),
        (check_search, "lest-squares", "least-squares"),
        (deciding, "evidnce", "evidence"),
        (bounded, "velocity_dampng", "velocity_damping"),
        (lambda name: split_by_motion([], [name]), "twst", "twist"),
        (lambda name: choose_plants([name], [plant.id for plant in PLANTS], "here"), "tilt", "gravity_tilt"),
    ],
)
def test_each_choice_of_a_name_asks_whether_the_nearest_was_meant(asked, name, meant):
    with pytest.raises(FitError, match=f"did you mean {meant}( or [a-z_-]+)?\\? The others: ") as refused:
        asked(name)
    assert repr(name) in str(refused.value) or f"{name} is no way" in str(refused.value)


@pytest.mark.parametrize(("name", "meant"), [
    ("frcition", ["bending_hysteresis"]), ("silhouete", ["corner_erosion"]), ("wrinkls", ["tracker_smoothing"]),
])  # fmt: skip
def test_a_wrong_name_of_an_effect_may_be_a_word_of_its_title(name, meant):
    assert near_names(name, EFFECTS) == []
    assert near_names(name, EFFECTS, {effect.name: effect.title for effect in LIBRARY}) == meant
    with pytest.raises(FitError, match=f"^--without: there is no effect named '{name}'; did you mean {meant[0]}\\?"):
        library_without([name])


@pytest.mark.parametrize(
    ("option", "asked"),
    [
        ("--method", lambda: Plan(method="ci")),
        ("--effect", lambda: Plan(effects=("air_darg",)).request()),
        ("--fabric", lambda: Plan(fabric="cottn").request()),
        ("--engine", lambda: Plan(engine="blendr", search="annealing").request()),
        ("--search", lambda: check_search("anealing")),
        ("--model", lambda: find_base_model("ci")),
        ("--add", lambda: library_of(["hemm"], [])),
        ("--without", lambda: library_of([], ["hemm"])),
        ("--held-out-motion", lambda: split_by_motion([], ["sidewas"])),
        ("--bounds", lambda: bounded("strech")),
        ("--generator", lambda: find_generator("mujco", "--generator")),
    ],
)
def test_each_error_of_a_name_names_the_option_that_gave_it(option, asked):
    with pytest.raises(FitError, match=f"^{option}: there is no "):
        asked()


@pytest.mark.parametrize("name", sorted(METHODS))
def test_a_diagnosis_takes_the_base_models_that_its_help_names(name):
    if name in BASE_MODELS:
        assert find_base_model(name) is METHODS[name]
        return
    with pytest.raises(FitError, match=f"^--model: there is no base model named '{name}'; did you mean|known base"):
        find_base_model(name)


def test_the_help_of_a_diagnosis_names_every_base_model():
    (model,) = get_type_hints(diagnose_command, include_extras=True)["model"].__metadata__
    assert all(re.search(rf"(?<![\w-]){name}(?![\w-])", model.help) for name in BASE_MODELS)


def test_of_two_names_the_nearest_is_asked_for_and_the_rest_is_still_listed():
    with pytest.raises(FitError) as refused:
        find_effects(["drag"])
    assert str(refused.value).startswith("there is no effect named 'drag'; did you mean air_drag? The others: added_ma")
    _, _, others = str(refused.value).partition("The others: ")
    assert others.split(", ") == [name for name in EFFECTS if name != "air_drag"]

"""Defaults and checks of the options of `hangtime fit`."""

from __future__ import annotations

import numpy as np
import pytest

from fit.errors import FitError
from fit.identification.request import MOST_ITERATIONS, Plan, Request, check_count, request_of
from fit.methods import KINECT_SKIRT, MOCAP_SWATCH, SI


@pytest.mark.parametrize(
    ("method", "search"),
    [
        ("si", "least-squares"), ("si-sewn", "least-squares"), ("lean", "least-squares"),
        ("kinect-skirt", "annealing"), ("kinect-skirt-weighed", "annealing"),
        ("mocap-swatch", "annealing"), ("mocap-swatch-weighed", "annealing"),
    ],
)  # fmt: skip
def test_a_published_method_is_searched_as_its_paper_does_and_others_by_least_squares(method, search):
    assert Plan(method=method).search == search
    assert Plan(method=method).request().search == search
    assert Plan(method=method, search="cma-es").request().search == "cma-es"


def test_the_default_is_physical_units_by_least_squares_however_it_is_said():
    assert (Plan().method, Plan().search) == ("si", "least-squares")
    assert Plan() == Plan(method="si", search="least-squares")


def test_blenders_cloth_is_annealed_and_has_the_papers_parameters():
    assert Plan(method="kinect-skirt", engine="blender").search == "annealing"
    with pytest.raises(FitError, match="there is no method named 'guess'"):
        Plan(method="guess")


def test_a_search_draws_from_seed_0_unless_another_is_given():
    assert (Plan().seed, Plan().request().seed, Request(method=SI).seed) == (0, 0, 0)
    assert Plan(seed=7).request().seed == 7


def test_sixteen_candidates_share_a_batch_of_our_own_cloth_and_none_one_of_another_simulator():
    assert Plan().request().width == Request(method=SI).width == 16
    assert Plan(method="kinect-skirt", engine="blender").request().width == 1


def asked(**changes):
    given = {"method": SI, "effects": [], "iterations": 5, "seed": 0, "spacing": 0.1}
    given |= changes
    return request_of(given.pop("method"), given.pop("effects"), **given)


def test_an_effect_brings_a_parameter_of_each_component_from_nothing_within_its_range():
    """They follow the method's own; a step of annealing is the typical size."""
    request = asked(effects=["air_drag", "clip_slip"])
    *own, drag, left, right = request.parameters
    assert tuple(own) == SI.parameters
    assert [p.name for p in (drag, left, right)] == ["air_drag", "clip_slip.left", "clip_slip.right"]
    assert (drag.unit, drag.initial, drag.minimum, drag.maximum, drag.interval) == ("1", 0.0, 0.0, 3.0, 1.2)
    assert (left.unit, left.initial, left.minimum, left.maximum, left.interval) == ("m", 0.0, -0.002, 0.05, 0.005)
    assert request.space.maximum[-3:].tolist() == [3.0, 0.05, 0.05]
    assert request.space.minimum[-3:].tolist() == [0.0, -0.002, -0.002]
    assert request.space.is_log.tolist() == [*(p.is_log for p in SI.parameters), False, False, False]
    assert request.space.is_log.any()


def test_bounds_narrow_a_parameter_and_move_its_start_to_the_nearer_of_them():
    """Up to the whole of its range; of each parameter once."""
    stretch, shear, *_ = SI.parameters
    for low, high in ((stretch.initial * 1.1, stretch.initial * 2), (stretch.initial / 2, stretch.initial / 1.1)):
        narrowed, other, *_ = asked(bounds=[f"{stretch.name}={low!r}:{high!r}"]).parameters
        assert (narrowed.minimum, narrowed.maximum) == (low, high)
        assert narrowed.initial == pytest.approx(low if low > stretch.initial else high)
        assert other == shear
    whole = f"{stretch.name}={stretch.minimum!r}:{stretch.maximum!r}"
    assert asked(bounds=[whole]).parameters[0] == stretch
    for bounds, reason in (
        ([whole, whole], f"{stretch.name} is given twice"),
        (["weight=1:2"], "there is no parameter named 'weight'"),
        ([f"{stretch.name}=1"], "is not NAME=LOW:HIGH"),
        ([f"{stretch.name}=nan:100"], "has a bound that is no number"),
        ([f"{stretch.name}=100:nan"], "has a bound that is no number"),
        ([f"{stretch.name}=100:100"], "is not below its upper bound"),
        ([f"{stretch.name}={stretch.minimum * 0.99!r}:100"], "leaves the range"),
        ([f"{stretch.name}=100:{stretch.maximum * 1.01!r}"], "leaves the range"),
    ):
        with pytest.raises(FitError, match=reason):
            asked(bounds=bounds)


def test_requests_that_contradict_themselves_are_refused():
    for changes, reason in (
        ({"effects": ["hem", "hem"]}, "hem is named twice"),
        ({"effects": ["shear_stiffness"]}, "has shear_stiffness as a parameter already"),
        ({"gamma": 0.0}, "gamma is 0"),
        ({"gamma": float("inf")}, "gamma is inf"),
        ({"gamma": 1e300}, r"gamma is 1e\+300, at which .* worse; give 0\.001 to 1e\+12, for example"),
        ({"gamma": 1e-300}, "gamma is 1e-300, at which annealing takes every step"),
        ({"search": "least-squares", "engine": "blender"}, "simulates with our own cloth only"),
        ({"search": "tempering", "method": MOCAP_SWATCH}, "tempering draws by how likely distances are"),
        ({"iterations": 0}, "give a whole number from 1 to 1000000"),
        ({"iterations": MOST_ITERATIONS + 1}, "give a whole number from 1 to 1000000"),
        ({"seed": -1}, "give a whole number from 0 on"),
    ):
        with pytest.raises(FitError, match=reason):
            asked(**changes)
    assert asked(search="tempering", method=KINECT_SKIRT).search == "tempering"
    assert asked(effects=["bending_viscosity"]).effects  # goes beyond what the method has


def test_a_count_is_a_whole_number_from_its_least_to_its_most():
    for number in (1, 3, np.int64(2)):
        check_count(number, "walks", least=1, most=3)
    for number in (0, 4, 1.0, True, "2"):
        with pytest.raises(FitError, match=r"--walks: walks is .*; give a whole number from 1 to 3"):
            check_count(number, "walks", least=1, most=3)


def test_a_plan_hands_on_all_that_it_was_given():
    plan = Plan(method="kinect-skirt", bounds=("air=2:8",), iterations=40, gamma=5e4, spacing=0.07, seed=3)
    request = plan.request()
    assert (request.method, request.seed, request.resolution.spacing) == (KINECT_SKIRT, 3, 0.07)
    assert (request.settings.iterations, request.settings.gamma) == (40, 5e4)
    assert request.bounds == (("air", 2.0, 8.0),)
    plain = Plan(method="kinect-skirt").request()
    assert (plain.resolution.spacing, plain.settings.gamma) == (KINECT_SKIRT.spacing, KINECT_SKIRT.gamma)
    assert plain.settings.iterations == 350


@pytest.mark.parametrize("search", ["least-squares", "short-windows"])
def test_a_search_without_iterations_refuses_every_number_of_them_and_none_is_no_number(search):
    for count in (349, 350):
        with pytest.raises(FitError, match=rf"^--iterations: changes nothing here: {search} has no number of iterat"):
            Plan(search=search, iterations=count).request()
    assert Plan(search=search).request().search == search
    assert Plan(search="annealing") == Plan(search="annealing", iterations=350)
    with pytest.raises(FitError, match="give a whole number from 1 to 1000000"):
        Plan(search=search, iterations=0).request()


@pytest.mark.parametrize(
    ("search", "given", "told"),
    [
        (
            "least-squares",
            {"iterations": 1},
            ["--iterations changes nothing here: least-squares has no number of iterations."],
        ),
        ("cma-es", {"gamma": 1e5, "iterations": 9}, ["--gamma changes nothing here: cma-es does not use gamma."]),
        ("annealing", {"gamma": 1e5, "iterations": 9}, []),
    ],
)
def test_a_command_leaves_out_what_its_search_does_not_use_and_says_so(search, given, told):
    said = []
    plan = Plan(search=search, **given).without_unused(said.append)
    assert said == told
    unused = {words.split()[0].removeprefix("--") for words in told}
    assert plan == Plan(search=search, **{name: value for name, value in given.items() if name not in unused})
    assert plan.request().search == search


def test_what_a_search_does_not_use_is_still_refused_where_it_has_no_meaning():
    with pytest.raises(FitError, match="gamma is -1; give a number above 0"):
        Plan(gamma=-1.0).without_unused(print)

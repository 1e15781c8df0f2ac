"""Defaults and checks of the options of `hangtime fit`."""

from __future__ import annotations

import pytest

from fit.errors import FitError
from fit.identification.request import Plan, Request
from fit.methods import SI


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

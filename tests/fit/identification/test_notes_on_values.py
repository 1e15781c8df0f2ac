"""A result speaks of one parameter in the singular, and of several in the plural."""

from __future__ import annotations

import msgspec
import pytest

from fit.identification.notes_on_values import notes_on_values
from tests.fit.report.report_scene import fit_result

MASS, STRUCT, *_ = fit_result().parameters


def parameters(count, **state):
    return [msgspec.structs.replace(p, **state) for p in (MASS, STRUCT)[:count]]


@pytest.mark.parametrize(
    ("count", "says"),
    [(1, "Not identified: mass. Read the 90 % interval. The"),
     (2, "Not identified: mass, struct. Read the 90 % interval of each. The")],
)  # fmt: skip
def test_a_single_parameter_that_is_not_identified_has_one_interval(count, says):
    (note,) = notes_on_values(parameters(count, is_identified=False, is_at_bound=False))
    assert note.startswith(says)


@pytest.mark.parametrize(
    ("count", "says"),
    [(1, "At its bound: mass. Its range stopped the fit there, so the value says more of the range than"),
     (2, "At its bound: mass, struct. Their ranges stopped the fit there, so the values say more of the ranges than")],
)  # fmt: skip
def test_several_parameters_at_their_bounds_have_several_ranges(count, says):
    (note,) = notes_on_values(parameters(count, is_identified=False, is_at_bound=True))
    assert note.startswith(says)


def test_identified_parameters_have_no_note():
    assert notes_on_values(parameters(2, is_identified=True, is_at_bound=False)) == []

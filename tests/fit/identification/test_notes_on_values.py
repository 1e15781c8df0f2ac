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
    ("count", "is_at_bound", "says"),
    [(1, False, "Not identified: mass. Read the 90 % interval. The"),
     (2, False, "Not identified: mass, struct. Read the 90 % interval of each. The"),
     (1, True, "At its bound: mass. Its range stopped the fit there, so the value says more of the range than"),
     (2, True,
      "At its bound: mass, struct. Their ranges stopped the fit there, so the values say more of the ranges than")],
)  # fmt: skip
def test_one_parameter_has_one_interval_or_range_and_several_have_several(count, is_at_bound, says):
    (note,) = notes_on_values(parameters(count, is_identified=False, is_at_bound=is_at_bound))
    assert note.startswith(says)


def test_identified_parameters_have_no_note():
    assert notes_on_values(parameters(2, is_identified=True, is_at_bound=False)) == []

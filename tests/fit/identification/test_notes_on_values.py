"""A result speaks of one parameter in the singular, and of several in the plural."""

from __future__ import annotations

import dataclasses

import msgspec
import numpy as np
import pytest

from fit.identification.calibrate import calibrate
from fit.identification.notes_on_values import LOWERED_FIGURE, note_on_start, notes_on_values
from fit.identification.request import Plan
from fit.search.choice import OBSERVED, SEARCHES
from formats.fit_records import ErrorFigure, FitError
from tests.fit.report.report_scene import fit_result
from tests.fit.test_command_line import a_swung_take

MASS, STRUCT, *_ = fit_result().parameters


def parameters(count, **state):
    return [msgspec.structs.replace(p, **state) for p in (MASS, STRUCT)[:count]]


@pytest.mark.parametrize(
    ("count", "is_at_bound", "says"),
    [(1, False, "Not identified: mass. Read the 90 % interval. Many"),
     (2, False, "Not identified: mass, struct. Read the 90 % interval of each. Many"),
     (1, True, "At its bound: mass. Its range stopped the fit there, so the value says more of the range than"),
     (2, True,
      "At its bound: mass, struct. Their ranges stopped the fit there, so the values say more of the ranges than")],
)  # fmt: skip
def test_one_parameter_has_one_interval_or_range_and_several_have_several(count, is_at_bound, says):
    (note,) = notes_on_values(parameters(count, is_identified=False, is_at_bound=is_at_bound))
    assert note.startswith(says)


def test_identified_parameters_have_no_note():
    assert notes_on_values(parameters(2, is_identified=True, is_at_bound=False)) == []


def error_of(*millimetres):
    """Mean errors before and after on the takes fitted to, and then on held-out ones, if there are any."""
    figures = [ErrorFigure(mean_m=1e-3 * mm, max_m=0.1, per_frame_m=[1e-3 * mm], time_s=[0.0]) for mm in millimetres]
    names = ("train_before", "train_after", "held_out_before", "held_out_after")
    return FitError(**dict(zip(names, figures, strict=False)))


@pytest.mark.parametrize(
    ("search", "millimetres", "says"),
    [
        ("short-windows", (27.0, 30.4), ["the takes it was fitted to", "30.4 mm instead of 27.0", "--search least-sq"]),
        ("least-squares", (9.0, 9.3, 20.0, 10.0), ["the takes it was fitted to", "9.3 mm instead of 9.0", "diagnose"]),
        (
            "least-squares",
            (9.0, 5.0, 10.0, 20.0),
            ["the held-out takes", "20.0 mm instead of 10.0", "this kind of moti"],
        ),
        ("annealing", (9.0, 5.0, 10.0, 10.1), ["the held-out takes", "method's objective on the takes it was fitted"]),
    ],
)
def test_a_fit_worse_than_its_start_says_on_which_takes_by_how_much_and_what_to_do(search, millimetres, says):
    note = note_on_start(error_of(*millimetres), search)
    assert note.startswith("Warning: the fit follows ")
    assert LOWERED_FIGURE.get(search, "method's objective") in note
    assert "on the takes it was fitted to" in note.partition("another figure")[2]
    for words in says:
        assert words in note


@pytest.mark.parametrize("millimetres", [(9.0, 9.0), (9.0, 5.0), (9.0, 5.0, 20.0, 20.0), (9.0, 5.0, 20.0, 10.0)])
def test_a_fit_no_worse_than_its_start_has_no_such_note(millimetres):
    assert note_on_start(error_of(*millimetres), "least-squares") == ""


@pytest.mark.parametrize("search", [name for name in SEARCHES if name not in OBSERVED])
def test_no_search_by_distance_ends_above_its_start(search):
    """The start is the truth, so that nearly every other candidate is worse."""
    take = a_swung_take(seconds=2.0, damping=1.0)
    found = calibrate([take], [], Plan(search=search, iterations=6, spacing=0.15).request())
    assert found.objective.after <= found.objective.before
    assert found.error.train_after.mean_m <= found.error.train_before.mean_m
    assert not [note for note in found.notes if "worse than its initial" in note]


@pytest.mark.slow
def test_short_windows_that_end_above_their_start_say_so():
    """Points two frames late, which the pull hides: free cloth follows them worse with the parameters found."""
    take = a_swung_take(seconds=3.0, damping=1.0, hz=1.1)
    late = dataclasses.replace(take, points=np.roll(take.points, 2, axis=0))
    found = calibrate([late], [], Plan(search="short-windows", spacing=0.15).request())
    assert found.error.train_after.mean_m > found.error.train_before.mean_m
    assert [
        note for note in found.notes if note.startswith("Warning: the fit follows the takes it was fitted to worse")
    ]

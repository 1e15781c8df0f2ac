"""The progress of a diagnosis rises from 0 to 100 %, the stages that few diagnoses reach included."""

from __future__ import annotations

import ast
import inspect
from itertools import pairwise

import numpy as np
import pytest

from fit.cloth.model import Resolution
from fit.effects import find_effects
from fit.errors import FitError
from fit.gap import base_fit, diagnosis, first_round
from tests.fit.scenes import hung, sheet, swing, take_of

TIME = np.arange(0, 2.0, 1 / 30)
SHEET = sheet(grid=4)
TAKE = take_of(SHEET, TIME, swing(TIME), hung(SHEET, TIME) + swing(TIME)[:, None])


def shares_of(module):
    """The shares that a module's calls of `progress` state as numbers, in the order of its lines."""
    calls = [node for node in ast.walk(ast.parse(inspect.getsource(module))) if isinstance(node, ast.Call)]
    calls = [call for call in calls if ast.unparse(call.func) in ("progress", "self.progress")]
    numbers = [call.args[1] for call in sorted(calls, key=lambda call: call.lineno)]
    return [number.value for number in numbers if isinstance(number, ast.Constant)]


@pytest.mark.unmutated
def test_the_stages_of_a_diagnosis_rise_from_0_to_100_percent():
    """The base fit and the rounds of effects run between stages of the diagnosis."""
    begin, noise, mesh, *rest = shares_of(diagnosis)
    assert len(rest) == 5
    stages = [begin, *shares_of(base_fit), noise, *shares_of(first_round), mesh, *rest]
    assert len(stages) == 12
    assert (stages[0], stages[-1]) == (0.0, 1.0)
    assert all(earlier < later for earlier, later in pairwise(stages))


def test_a_diagnosis_says_that_it_begins_after_the_checks_and_before_the_first_simulation(tmp_path, monkeypatch):
    """A folder of other fits is refused first, and then nothing is said to begin."""
    told = []

    def base_of(*given):
        told.append("base fit")
        raise InterruptedError

    monkeypatch.setattr(diagnosis, "fit_base", base_of)
    options = {
        "effects": find_effects(["hem"]), "resolution": Resolution(spacing=0.2), "checkpoint": tmp_path / "fits",
        "begun": lambda: told.append("begun"),
    }  # fmt: skip
    with pytest.raises(InterruptedError):
        diagnosis.diagnose([TAKE], [], **options)
    assert told == ["begun", "base fit"]
    with pytest.raises(FitError):
        diagnosis.diagnose([TAKE], [], seed=7, **options)
    assert told == ["begun", "base fit"]

"""The progress of a diagnosis rises from 0 to 100 %, the stages that few diagnoses reach included."""

from __future__ import annotations

import ast
import inspect
from itertools import pairwise

from fit.gap import base_fit, diagnosis, rounds


def shares_of(module):
    """The shares that a module's calls of `progress` state as numbers, in the order of its lines."""
    calls = [node for node in ast.walk(ast.parse(inspect.getsource(module))) if isinstance(node, ast.Call)]
    calls = [call for call in calls if ast.unparse(call.func) in ("progress", "self.progress")]
    numbers = [call.args[1] for call in sorted(calls, key=lambda call: call.lineno)]
    return [number.value for number in numbers if isinstance(number, ast.Constant)]


def test_the_stages_of_a_diagnosis_rise_from_0_to_100_percent():
    """The base fit and the rounds of effects run between stages of the diagnosis."""
    begin, noise, mesh, *rest = shares_of(diagnosis)
    assert len(rest) == 5
    stages = [begin, *shares_of(base_fit), noise, *shares_of(rounds), mesh, *rest]
    assert len(stages) == 12
    assert (stages[0], stages[-1]) == (0.0, 1.0)
    assert all(earlier < later for earlier, later in pairwise(stages))

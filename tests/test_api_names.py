"""The names of the package: its calls take every option, and importing it is quick."""

from __future__ import annotations

import ast
import dataclasses
import subprocess
import sys
from pathlib import Path

import hangtime
from fit.api.arguments import PlanOptions
from fit.identification.request import Plan
from tests.repository import ROOT


def test_every_option_of_a_plan_is_an_argument():
    assert list(PlanOptions.__annotations__) == [field.name for field in dataclasses.fields(Plan)]


def test_the_package_holds_names_only():
    """Its statements are imports, a docstring and `__all__`."""
    for node in ast.parse(Path(hangtime.__file__).read_text()).body:
        assert isinstance(node, ast.ImportFrom | ast.Expr | ast.Assign)
    assert sorted(hangtime.__all__) == [name for name in sorted(hangtime.__all__) if hasattr(hangtime, name)]


def test_importing_it_loads_neither_taichi_nor_scipy():
    """It starts as quickly as a script that only reads takes."""
    code = "import sys, hangtime; print(sorted({'taichi', 'scipy'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.strip() == "[]"

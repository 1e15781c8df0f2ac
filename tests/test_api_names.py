"""The names of the package: its calls take every option, and importing it is quick."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import pydoc
import re
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest

import hangtime
from fit.api.arguments import PLAN_DEFAULTS, PlanOptions
from fit.identification.request import Plan
from fit.recordings.ready import ready
from formats.templating import environment
from tests.fit.report.report_scene import diagnosis, fit_result
from tests.fit.test_command_line import a_swung_take
from tests.formats.test_archive import a_take
from tests.repository import ROOT


def test_every_option_of_a_plan_is_an_argument():
    assert list(PlanOptions.__annotations__) == [field.name for field in dataclasses.fields(Plan)]


def test_the_defaults_that_help_shows_are_those_of_a_plan():
    own = {field.name: field.default for field in dataclasses.fields(Plan)}
    assert own == dict(PLAN_DEFAULTS)


@pytest.mark.parametrize("call", [hangtime.fit, hangtime.diagnose, hangtime.simulate])
def test_help_shows_each_option_and_no_function_without_a_name(call):
    shown = pydoc.plain(pydoc.render_doc(call))
    assert "lambda" not in shown
    assert "**options" not in shown
    assert "spacing: float | None = " in shown


def test_the_help_of_a_simulation_shows_no_option_of_a_search():
    own = inspect.signature(hangtime.simulate).parameters
    assert PLAN_DEFAULTS.keys() - own.keys() == {"search", "iterations", "gamma", "seed"}


def test_help_shows_the_default_of_each_option_of_a_fit():
    shown = inspect.signature(hangtime.fit).parameters
    assert {name: shown[name].default for name in PLAN_DEFAULTS} == dict(PLAN_DEFAULTS)


def test_an_object_of_the_interface_has_a_repr_of_one_short_line():
    """A garment of 400 points and a take of 150 frames had 36,000 characters in 810 lines."""
    take = a_take(150)
    result = fit_result()
    many = [take, take.garment, take.rig, result, result.error, result.parameters[0], diagnosis()]
    many += ready([a_swung_take()], []).training
    for one in many:
        assert "\n" not in repr(one)
        assert len(repr(one)) < 400, repr(one)[:500]
    assert "150 frames" in repr(take)
    assert take.garment.name in repr(take)
    assert f"array of shape {take.points.shape}" in take._repr_html_()


def test_the_names_in_a_takes_table_are_no_markup():
    garment = msgspec.structs.replace(a_take(4).garment, name="<b>")
    assert "<b>" not in dataclasses.replace(a_take(4), take_id="<b>", garment=garment)._repr_html_()


def test_a_take_has_a_row_for_each_fact_and_array_in_a_notebook():
    rows = re.findall(r"<tr><th>(.*?)</th><td>(.*?)</td></tr>", a_take(4)._repr_html_())
    assert [name for name, _ in rows][:6] == ["take", "length", "garment", "points", "state", "created"]
    assert ("time", "array of shape (4,)") in rows


def test_a_notebook_without_jinja2_shows_a_take_as_text(monkeypatch):
    monkeypatch.setitem(sys.modules, "jinja2", None)
    environment.cache_clear()
    assert a_take(4)._repr_html_() is None


def test_the_package_holds_names_only():
    """Its statements are imports, a docstring, `__all__`, and the search for a name where it is first used."""
    body = ast.parse(Path(hangtime.__file__).read_text()).body
    assert [node.name for node in body if isinstance(node, ast.FunctionDef)] == ["__getattr__", "__dir__"]
    for node in body:
        assert isinstance(node, ast.ImportFrom | ast.Expr | ast.Assign | ast.If | ast.FunctionDef)
    assert sorted(hangtime.__all__) == [name for name in sorted(hangtime.__all__) if hasattr(hangtime, name)]
    assert dir(hangtime) == sorted(hangtime.__all__)
    with pytest.raises(AttributeError, match="has no attribute 'fits'"):
        hangtime.fits  # noqa: B018


def test_a_type_checker_and_python_import_the_same_names():
    body = ast.parse(Path(hangtime.__file__).read_text()).body
    (checked,) = (node for node in body if isinstance(node, ast.If))
    assert {one.module: tuple(name.name for name in one.names) for one in checked.body} == hangtime._MODULES


@pytest.mark.parametrize(
    ("words", "libraries"), [("", {"numpy", "msgspec"}), ("hangtime.fit, hangtime.Take", {"taichi", "scipy"})]
)
def test_importing_it_loads_no_library_and_its_names_neither_taichi_nor_scipy(words, libraries):
    """Its command starts as quickly as any, and it starts as quickly as a script that only reads takes."""
    code = f"import sys, hangtime\n{words}\nprint(sorted({libraries} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.strip() == "[]"

"""Templates escape names, strip control codes, and load Jinja2 only when one is filled."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import pytest
from markupsafe import Markup

from formats import templating
from formats.templating import environment

BATCH = ("fit.batch", ".")


def test_a_name_becomes_no_markup_and_no_control_code() -> None:
    line = environment(*BATCH).from_string("{{ name }} {{ markup }} {{ count }}")
    shown = line.render(name="<b>\x1b[31m", markup=Markup("<i>\x1b</i>"), count=3)
    assert shown == "&lt;b&gt;\\x1b[31m <i>\\x1b</i> 3"


def test_a_misspelt_value_of_a_template_is_an_error() -> None:
    from jinja2 import UndefinedError

    with pytest.raises(UndefinedError, match="'nmae' is undefined"):
        environment(*BATCH).from_string("{{ nmae }}").render(name="skirt")


def test_the_module_loads_where_jinja2_is_not_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    for library in ("jinja2", "markupsafe"):
        monkeypatch.setitem(sys.modules, library, None)
    spec = importlib.util.spec_from_file_location("templating_alone", Path(templating.__file__))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    with pytest.raises(ImportError, match="jinja2"):
        module.environment(*BATCH)

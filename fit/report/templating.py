"""Rendering of the report's templates, as whole pages or as fragments."""

from __future__ import annotations

import re
from functools import cache
from typing import TYPE_CHECKING

from markupsafe import Markup, escape

from formats.templating import environment

if TYPE_CHECKING:
    from jinja2 import Environment

COMMAND_IN_TEXT = re.compile(r"`([^`]+)`")  # a command in a sentence, as a terminal shows it


def render(template: str, **values: object) -> str:
    """Return the HTML of a whole page."""
    return _environment().get_template(template).render(**values)


def piece(template: str, macro: str, *values: object) -> Markup:
    """Return the output of a template's macro for given values; plain text is escaped, markup stays."""
    return Markup(getattr(_environment().get_template(template).module, macro)(*values))


def coded(text: str) -> Markup:
    """Return escaped text in which what stands between backticks is set as code; markup stays."""
    return Markup(COMMAND_IN_TEXT.sub(r"<code>\1</code>", str(escape(text))))


@cache
def _environment() -> Environment:
    """Return the environment of the report's templates, with the filter `coded`."""
    found = environment("fit.report")
    found.filters["coded"] = coded
    return found


NOTHING = Markup("")

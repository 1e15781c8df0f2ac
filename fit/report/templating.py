"""The templates of the report: Jinja2 with autoescape, so that no name from outside becomes markup."""

from __future__ import annotations

from functools import cache

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup


@cache
def _environment() -> Environment:
    return Environment(loader=PackageLoader("fit.report"), autoescape=True, undefined=StrictUndefined)


def render(template: str, **values: object) -> str:
    """Return a whole page."""
    return _environment().get_template(template).render(**values)


def piece(template: str, macro: str, *values: object) -> Markup:
    """Return what a macro of a template makes of values; plain text is escaped, markup stays."""
    return Markup(getattr(_environment().get_template(template).module, macro)(*values))


NOTHING = Markup("")

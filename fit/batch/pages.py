"""The pages of a batch: Jinja2 templates with autoescape, so that no name of a take becomes markup."""

from __future__ import annotations

from functools import cache
from importlib import resources

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup


@cache
def _environment() -> Environment:
    loader = PackageLoader("fit.batch", ".")
    return Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)


def render_page(template: str, **values: object) -> str:
    """Return a whole page, in the style of the report."""
    style = Markup(resources.files("fit.report").joinpath("page.css").read_text(encoding="utf-8"))
    return _environment().get_template(template).render(style=style, **values)

"""Rendering of a batch's pages from their templates."""

from __future__ import annotations

from importlib import resources

from markupsafe import Markup

from formats.templating import environment


def render_page(template: str, **values: object) -> str:
    """Return a whole page, in the style of the report."""
    style = Markup(resources.files("fit.report").joinpath("page.css").read_text(encoding="utf-8"))
    return environment("fit.batch", ".", trims_lines=True).get_template(template).render(style=style, **values)

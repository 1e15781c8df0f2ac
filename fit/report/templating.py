"""Rendering of the report's templates, as whole pages or as fragments."""

from __future__ import annotations

from markupsafe import Markup

from formats.templating import environment


def render(template: str, **values: object) -> str:
    """Return the HTML of a whole page."""
    return environment("fit.report").get_template(template).render(**values)


def piece(template: str, macro: str, *values: object) -> Markup:
    """Return the output of a template's macro for given values; plain text is escaped, markup stays."""
    return Markup(getattr(environment("fit.report").get_template(template).module, macro)(*values))


NOTHING = Markup("")

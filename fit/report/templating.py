"""The templates of the report, as whole pages or as pieces of them."""

from __future__ import annotations

from markupsafe import Markup

from fit.templating import environment


def render(template: str, **values: object) -> str:
    """Return the HTML of a whole page."""
    return environment("fit.report").get_template(template).render(**values)


def piece(template: str, macro: str, *values: object) -> Markup:
    """Return what a macro of a template makes of values; plain text is escaped, markup stays."""
    return Markup(getattr(environment("fit.report").get_template(template).module, macro)(*values))


NOTHING = Markup("")

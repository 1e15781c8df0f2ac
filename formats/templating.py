"""Jinja2 environments with autoescape, so that no external name becomes markup.

Jinja2 comes with the extra `fit`; only a call loads the library, so that the appliance needs none.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

from formats.plain_text import without_codes

if TYPE_CHECKING:
    from jinja2 import Environment


@cache
def environment(package: str, folder: str = "templates", *, trims_lines: bool = False) -> Environment:
    """Return the environment of the templates in a folder of a package.

    trims_lines: whether lines of statements leave no blank lines
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    loader = PackageLoader(package, folder)
    return Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=trims_lines, lstrip_blocks=trims_lines,
        finalize=harmless,
    )  # fmt: skip


def harmless(value: object) -> object:
    """Return a template's value without control codes, so that no name of an old take affects line or terminal."""
    from markupsafe import Markup

    if isinstance(value, Markup):
        return Markup(without_codes(value))
    return without_codes(value) if isinstance(value, str) else value

"""How Sphinx builds these pages: MyST Markdown, the Furo theme, no network at build time or in the reader's browser.

Sphinx, not MkDocs: MkDocs 1 has had no release since 2024, and its Material theme takes security fixes only.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from importlib.metadata import version as version_of
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent.parent))

from docs.generator import commands, effects, equations

project = "Hangtime"
author = "the authors of Hangtime"
release = version = version_of("hangtime")
extensions = ["myst_parser"]
exclude_patterns = ["generator"]

myst_enable_extensions = ["deflist", "dollarmath"]
myst_heading_anchors = 4
nitpicky = True
smartquotes = False  # options begin with two hyphens, in sentences too

html_theme = "furo"
html_title = "Hangtime"
html_static_path = ["style"]
html_css_files = ["pages.css"]
html_copy_source = False
html_show_sphinx = False
html_show_copyright = False
html_math_renderer = "mathml"

# A page that holds one of these lines shows in its place what the program itself says.
GENERATED: dict[str, Callable[[], str]] = {
    "<!-- generated: commands -->": commands.commands_page,
    "<!-- generated: effects -->": effects.effects_page,
}


def fill_in(app: Any, docname: str, source: list[str]) -> None:
    """Put generated text into a page that asks for it."""
    for marker, make in GENERATED.items():
        if marker in source[0]:
            source[0] = source[0].replace(marker, make())


def setup(app: Any) -> dict[str, bool]:
    """Connect the generated pages and the equations."""
    app.connect("source-read", fill_in)
    app.add_html_math_renderer("mathml", (equations.visit_math, None), (equations.visit_math_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}

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

from docs.generator import appliance_states, commands, effects, equations
from docs.generator.shown import MARKER, with_shown_files

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
    "<!-- generated: appliance states -->": appliance_states.appliance_states_page,
    "<!-- generated: commands -->": commands.commands_page,
    "<!-- generated: effects -->": effects.effects_page,
}


def fill_in(app: Any, docname: str, source: list[str]) -> None:
    """Put generated text and files from beside `docs/` into a page that asks for them."""
    source[0] = whole_page(source[0], f"docs/{docname}.md")


def pages_of_other_files(app: Any, env: Any, *changes: set[str]) -> list[str]:
    """Name the pages that are read at every build: Sphinx sees no change of what `fill_in` puts into them."""
    pages = {name: Path(env.doc2path(name)).read_text() for name in env.found_docs}
    return [name for name, text in pages.items() if any(marker in text for marker in GENERATED) or MARKER.search(text)]


def whole_page(text: str, page: str) -> str:
    """Return the text of a page, given by its file from the root, with all that is put into it."""
    for marker, make in GENERATED.items():
        if marker in text:
            text = text.replace(marker, make())
    return with_shown_files(text, page)


def setup(app: Any) -> dict[str, bool]:
    """Connect the generated pages and the equations."""
    app.connect("source-read", fill_in)
    app.connect("env-get-outdated", pages_of_other_files)
    app.add_html_math_renderer("mathml", (equations.visit_math, None), (equations.visit_math_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}

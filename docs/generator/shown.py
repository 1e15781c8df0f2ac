"""Files beside `docs/` that a page shows whole, and links that lead to them or from them."""

from __future__ import annotations

import posixpath
import re
from pathlib import Path

ROOT = Path(__file__).parent.parent.parent

# file, from the root: the page that shows it, without `.md`
SHOWN = {
    "CHANGELOG.md": "docs/notebook/changes",
    "CONTRIBUTING.md": "docs/contributing",
    "README.md": "docs/index",
    "benchmarks/README.md": "docs/reference/benchmarks",
    "formats/SPEC.md": "docs/reference/take-archive",
    "formats/SPEC-1.md": "docs/reference/take-archive-1",
    "systemd/README.md": "docs/how-to/system-files",
}
MARKER = re.compile(r"<!-- shown: (\S+) -->")
LINK = re.compile(r"\]\(\s*(?![a-z]+:|#)([^)#\s]+)(#[^)\s]*)?\s*\)")


def with_shown_files(text: str, page: str) -> str:
    """Return a page's text with the file that it shows, and with links that hold where the page is.

    Args:
        text: Markdown of the page.
        page: The page's file, from the root.
    """
    marker = MARKER.search(text)
    source = page
    if marker:
        source = marker[1]
        text = text.replace(marker[0], (ROOT / source).read_text())
    return LINK.sub(lambda link: _link(link, posixpath.dirname(source), posixpath.dirname(page)), text)


def _link(link: re.Match[str], source: str, page: str) -> str:
    """Return a link of a file in the folder `source` as the page in the folder `page` needs it."""
    target = posixpath.normpath(posixpath.join(source, link[1]))
    if target in SHOWN:
        target = f"{SHOWN[target]}.md"
    return f"]({posixpath.relpath(target, page)}{link[2] or ''})"

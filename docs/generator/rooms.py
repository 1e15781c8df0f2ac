"""The drawing of the rooms on the architecture page, from the layers that import-linter enforces.

`python -m docs.generator.rooms` draws it anew into the page.
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parent.parent.parent
PAGE = ROOT / "docs/architecture.md"
PACKAGES = ("fit", "capture", "firmware_host")
DRAWING = re.compile(r"```text\n fit  .*?```", re.DOTALL)


def drawing() -> str:
    """Return the drawing: a column for each package, its layers from the top down."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    layers = {contract["id"]: contract.get("layers", []) for contract in contracts}
    columns = [[_drawn(layer) for layer in layers[package]] for package in PACKAGES]
    widths = [max(map(len, column)) for column in columns]
    rows = [list(PACKAGES), ["─" * width for width in widths]]
    rows += [[column[k] if k < len(column) else "" for column in columns] for k in range(max(map(len, columns)))]
    lines = ["   ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in rows]
    return "```text\n" + "\n".join(f" {line}".rstrip() for line in lines) + "\n```"


def _drawn(layer: str) -> str:
    """Return a layer without the brackets of rooms that need not be there yet."""
    return re.sub(r"[()]", "", layer).replace("|", "│")


if __name__ == "__main__":
    PAGE.write_text(DRAWING.sub(lambda _: drawing(), PAGE.read_text()))

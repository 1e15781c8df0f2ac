"""The drawing of the rooms on the architecture page, from the layers that import-linter enforces.

`python -m docs.generator.rooms` draws it anew into the page.
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parent.parent.parent
PAGE = ROOT / "docs/architecture.md"
ROWS = (("fit", "capture"), ("firmware_host",))  # packages side by side: as wide as a window of 1100 pixels shows
DRAWING = re.compile(r"```text\n fit  .*?```", re.DOTALL)


def drawing() -> str:
    """Return the drawing: a column for each package, its layers from the top down, in rows of packages."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    layers = {contract["id"]: contract.get("layers", []) for contract in contracts}
    drawn = "\n\n".join(_columns(packages, layers) for packages in ROWS)
    return f"```text\n{drawn}\n```"


def _columns(packages: tuple[str, ...], layers: dict[str, list[str]]) -> str:
    """Return the columns of some packages side by side, as lines of text."""
    columns = [[_drawn(layer) for layer in layers[package]] for package in packages]
    widths = [max(map(len, (package, *column))) for package, column in zip(packages, columns, strict=True)]
    rows = [list(packages), ["─" * width for width in widths]]
    rows += [[column[k] if k < len(column) else "" for column in columns] for k in range(max(map(len, columns)))]
    lines = ["   ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in rows]
    return "\n".join(f" {line}".rstrip() for line in lines)


def _drawn(layer: str) -> str:
    """Return a layer without the brackets of rooms that need not be there yet."""
    return re.sub(r"[()]", "", layer).replace("|", "│")


if __name__ == "__main__":
    PAGE.write_text(DRAWING.sub(lambda _: drawing(), PAGE.read_text()))

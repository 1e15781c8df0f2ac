"""The files of the repository: packages, scripts and texts."""

from __future__ import annotations

import ast
import functools
from pathlib import Path

ROOT = Path(__file__).parent.parent
PACKAGES = ("formats", "firmware_host", "capture", "fit", "hangtime")
MODULES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))
SCRIPTS = [*sorted((ROOT / "scripts").iterdir()), ROOT / ".ci/run"]
SUFFIXES = {"", ".md", ".toml", ".py", ".js", ".css", ".html", ".json", ".rules", ".conf"}
FOLDERS = (*PACKAGES, "docs", "benchmarks", "scripts", "systemd", "tests")


@functools.cache
def texts() -> list[Path]:
    """All files that hold text; to find them takes a tenth of a second."""
    found = [*ROOT.glob("*.*"), ROOT / ".ci/run", *(p for folder in FOLDERS for p in (ROOT / folder).rglob("*"))]
    return [
        path
        for path in found
        if path.suffix in SUFFIXES and path.name != ".git" and path.is_file()
        if not any(part == "__pycache__" or part.endswith("_cache") for part in path.parts)
    ]


@functools.cache
def tree_of(path: Path) -> ast.Module:
    """Return the syntax tree of a file, cached and shared: callers must not change it."""
    return ast.parse(path.read_text())


def name_of(path: Path) -> str:
    return str(path.relative_to(ROOT))

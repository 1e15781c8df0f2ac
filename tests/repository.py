"""The files of the repository: packages, scripts and texts."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).parent.parent
PACKAGES = ("formats", "firmware_host", "capture", "fit", "hangtime")
MODULES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))
SCRIPTS = [*sorted((ROOT / "scripts").iterdir()), ROOT / ".ci/run"]
SUFFIXES = {"", ".md", ".toml", ".py", ".js", ".css", ".html", ".json", ".rules", ".conf"}
FOLDERS = (*PACKAGES, "docs", "benchmarks", "scripts", "systemd", "tests")
TEXTS = [
    path
    for path in [*ROOT.glob("*.*"), ROOT / ".ci/run", *(p for folder in FOLDERS for p in (ROOT / folder).rglob("*"))]
    if path.is_file() and path.suffix in SUFFIXES and path.name != ".git"
    if not any(part == "__pycache__" or part.endswith("_cache") for part in path.parts)
]


def name_of(path: Path) -> str:
    return str(path.relative_to(ROOT))

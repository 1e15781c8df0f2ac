"""Find the mutants that no test notices and the type check of `scripts/check` refuses, such as `advice=None`."""

from __future__ import annotations

import ast
import json
import shutil
import subprocess
import sys
import textwrap
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory


@dataclass(frozen=True)
class Change:
    """A function that replaces another of its name.

    - `path`: the module, below the root; `function`: its name, behind that of its class and a point if it is a method
    - `text`: its source, at any indentation
    """

    path: str
    function: str
    text: str


def refused(root: Path, changes: Sequence[Change]) -> list[bool]:
    """Return of each change whether the type check finds an error in the changed function.

    root: holds the packages, without errors, and the type check's settings in pyproject.toml

    One check covers one change of each function, since an error stands in the function that causes it.
    """
    found, rounds, met = (
        [False] * len(changes),
        defaultdict[int, list[int]](list),
        defaultdict[tuple[str, str], int](int),
    )
    for number, change in enumerate(changes):
        rounds[met[change.path, change.function]].append(number)
        met[change.path, change.function] += 1
    packages = sorted({change.path.partition("/")[0] for change in changes})
    with TemporaryDirectory() as folder:
        copy = Path(folder)
        for path in (*root.glob("*/"), root / "pyproject.toml"):
            (copy / path.name).symlink_to(path.resolve())
        for package in packages:
            (copy / package).unlink()
            shutil.copytree(root / package, copy / package)
        for numbers in rounds.values():
            at = defaultdict[str, list[int]](list)
            for number in numbers:
                at[changes[number].path].append(number)
            for path, some in at.items():
                (copy / path).write_text(_changed((root / path).read_text(), [changes[number] for number in some]))
            lines = _lines_with_errors(copy, packages, (root / ".mypy_cache").resolve())
            for path, some in at.items():
                functions = _functions((copy / path).read_text())
                for number in some:
                    begin, end = _span(functions[changes[number].function])
                    found[number] = any(begin <= line <= end for line in lines[path])
                shutil.copy2(root / path, copy / path)
    return found


def _functions(text: str) -> dict[str, ast.FunctionDef]:
    """Return a module's functions and methods by name."""
    body = ast.parse(text).body
    of_classes = [(f"{one.name}.", one.body) for one in body if isinstance(one, ast.ClassDef)]
    return {
        before + one.name: one for before, part in [("", body), *of_classes] for one in part
        if isinstance(one, ast.FunctionDef)
    }  # fmt: skip


def _span(function: ast.FunctionDef) -> tuple[int, int]:
    """Return the first and last line of a function, without its decorators."""
    return function.lineno, function.end_lineno or function.lineno


def _changed(text: str, changes: Sequence[Change]) -> str:
    """Return a module with other functions of the same names; decorators stay."""
    lines, functions = text.splitlines(), _functions(text)
    for change in sorted(changes, key=lambda one: functions[one.function].lineno, reverse=True):
        begin, end = _span(functions[change.function])
        other = textwrap.dedent(change.text).strip("\n")
        first, last = _span(next(iter(_functions(other).values())))
        indent = " " * functions[change.function].col_offset
        lines[begin - 1 : end] = [indent + line for line in other.splitlines()[first - 1 : last]]
    return "\n".join(lines) + "\n"


def _lines_with_errors(folder: Path, packages: Sequence[str], cache: Path) -> dict[str, list[int]]:
    """Return the numbers of the lines with errors in packages, by module."""
    words = [word for package in packages for word in ("-p", package)]
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--cache-dir", cache, "--output", "json", *words],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode > 1:
        raise SystemExit(f"mutants: the type check ended with {done.returncode}: {done.stderr or done.stdout}")
    found = defaultdict[str, list[int]](list)
    for line in filter(None, done.stdout.splitlines()):
        error = json.loads(line)
        if error["severity"] == "error":
            found[error["file"]].append(error["line"])
    return found

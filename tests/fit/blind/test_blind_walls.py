"""Independence of generator and fitter: neither imports the other, directly or indirectly."""

from __future__ import annotations

import ast
import functools
import re
from pathlib import Path

import pytest

FIT = Path(__file__).resolve().parents[3] / "fit"
# What both stand on, none of it about cloth: errors, folders, other Pythons, Taichi's start.
SHARED = (
    "errors.py", "folders.py", "foreign/process.py", "kernel_cache/__init__.py", "kernel_cache/index.py",
    "kernel_cache/mending.py", "kernel_cache/notes.py", "kernel_cache/place.py",
    "kernel_cache/writers.py", "runtime.py",
)  # fmt: skip
LIBRARIES = ("cryptography", "formats", "msgspec", "numpy", "scipy", "taichi", "typer")
STANDARD = (
    "__future__", "collections", "concurrent", "contextlib", "dataclasses", "datetime", "fcntl", "hashlib",
    "itertools", "json", "multiprocessing", "os", "pathlib", "secrets", "shutil", "signal", "subprocess", "sys",
    "typing",
)  # fmt: skip
# What other people's engines import in a Python of their own.
IN_WORKERS = ("answering", "bpy", "every_take", "mujoco", "newton", "numpy", "outside_forces", "warp")


@functools.cache
def imported(path):
    """Names of everything a file imports, at any depth; relative imports are made absolute."""
    names, source = [], path.read_text()
    imports_by_name = re.search("import_module|__import__|exec|eval", source)
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                base = ".".join([*path.relative_to(FIT.parent).parts[: -node.level], *([base] if base else [])])
            names += [f"{base}.{alias.name}" for alias in node.names]
        elif imports_by_name and isinstance(node, ast.Call):
            called = ast.unparse(node.func)
            assert "import_module" not in called, path
            assert called not in {"__import__", "exec", "eval"}, path
    return names


def is_under(name, package):
    return name == package or name.startswith(package + ".")


def files_of(name):
    """Files of `fit` that run when a name is imported: packages on the way, the module itself."""
    parts = name.split(".")
    places = [FIT.parent.joinpath(*parts[:count]) for count in range(1, len(parts) + 1)] if parts[0] == "fit" else []
    return [file for place in places for file in (place / "__init__.py", place.with_suffix(".py")) if file.is_file()]


def reached(files):
    """Files of `fit` that run when these do, each with the one that imports it."""
    found, waiting = dict.fromkeys(files), list(files)
    while waiting:
        path = waiting.pop()
        for file in (file for name in imported(path) for file in files_of(name)):
            if file not in found:
                found[file] = path
                waiting.append(file)
    return found


def generator():
    return [path for path in sorted((FIT / "blind").rglob("*.py")) if path.parent.name != "workers"]


def trespasses():
    """Files of the tool that run when the generator does, as (file, the one that imports it)."""
    allowed = {*generator(), *(FIT / name for name in SHARED), FIT / "__init__.py", FIT / "foreign/__init__.py"}
    return [(str(p.relative_to(FIT)), str(by.relative_to(FIT))) for p, by in reached(generator()).items()
            if p not in allowed]  # fmt: skip


def test_the_generator_runs_nothing_of_the_tool_however_indirectly():
    assert len(generator()) > 15
    assert trespasses() == []
    for path in generator():
        for name in imported(path):
            assert any(is_under(name, one) for one in ("fit", *LIBRARIES, *STANDARD)), (path.name, name)


def test_programs_for_other_pythons_import_nothing_of_hangtime():
    files = sorted((FIT / "blind" / "foreign" / "workers").glob("*.py"))
    files += sorted((FIT / "foreign" / "workers").glob("*.py"))
    assert len(files) >= 4
    for path in files:
        for name in imported(path):
            assert any(is_under(name, a) for a in (*IN_WORKERS, *STANDARD, "struct", "tempfile", "time")), (
                path.name,
                name,
            )


def test_other_peoples_engines_are_neither_the_tools_nor_the_checks():
    files = list((FIT / "foreign").glob("*.py"))
    assert len(files) >= 2
    for path in files:
        for name in imported(path):
            assert is_under(name, "fit.foreign") or not is_under(name, "fit") or name == "fit.errors.FitError", name


def test_the_tool_imports_nothing_of_the_generator():
    """`fit/cli.py` gathers the commands of both; of the tool only another command line may import that."""
    files = [path for path in FIT.rglob("*.py") if not path.is_relative_to(FIT / "blind") and path != FIT / "cli.py"]
    assert len(files) > 100
    for path in files:
        names = imported(path)
        assert not any(is_under(name, "fit.blind") for name in names), path
        assert path.name == "cli.py" or not any(is_under(name, "fit.cli") for name in names), path
    assert [name for name in imported(FIT / "cli.py") if is_under(name, "fit.blind")] == ["fit.blind.cli.add_commands"]


@pytest.mark.parametrize(
    "statement",
    [
        "from fit import gap", "import fit.gap", "from fit.gap import floor", "from .. import gap",
        "from ..gap import x", "from ..gap.floor import x", "def late():\n    from fit import gap",
        "from fit import folders",
    ],
)  # fmt: skip
def test_the_wall_sees_each_way_to_import_something_of_the_tool(tmp_path, monkeypatch, statement):
    """Also through what both share: here fit.folders imports fit.gap."""
    monkeypatch.setitem(globals(), "FIT", tmp_path / "fit")
    files = {"__init__.py": "", "gap/__init__.py": "", "gap/floor.py": "x = 1", "folders.py": "from fit import gap"}
    for name, text in {**files, "blind/__init__.py": "", "blind/cases.py": statement}.items():
        (tmp_path / "fit" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "fit" / name).write_text(text)
    by = "folders.py" if "folders" in statement else "blind/cases.py"
    assert ("gap/__init__.py", by) in trespasses()


@pytest.mark.parametrize("statement", ["import importlib\nimportlib.import_module('fit.gap')", "__import__('fit.gap')"])
def test_the_wall_refuses_imports_that_cannot_be_read(tmp_path, statement):
    (tmp_path / "a.py").write_text(statement)
    with pytest.raises(AssertionError):
        imported(tmp_path / "a.py")

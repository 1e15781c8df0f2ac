"""The wall between the generator and the tool: neither imports the other, however indirectly."""

from __future__ import annotations

import ast
from pathlib import Path

FIT = Path(__file__).resolve().parents[2] / "fit"
ALLOWED = (
    "fit.blind",
    "fit.errors",
    "fit.folders",
    "fit.foreign",
    "fit.runtime",
    "formats",
    "numpy",
    "scipy",
    "taichi",
    "msgspec",
    "typer",
)
STANDARD = (
    "__future__", "collections", "concurrent", "contextlib", "dataclasses", "datetime", "fcntl", "hashlib", "hmac",
    "html", "itertools", "json", "multiprocessing", "os", "pathlib", "secrets", "shutil", "signal", "subprocess", "sys",
    "typing",
)  # fmt: skip
# What other people's engines import in a Python of their own.
IN_WORKERS = ("answering", "bpy", "every_take", "mujoco", "newton", "numpy", "outside_forces", "warp")
TOOL = ("cloth", "effects", "gap", "parameterisations", "search", "report")
TOOL_FILES = (
    "recording", "calibration", "combinations", "fabrics", "objective", "reporting", "runtime", "errors",
    "swatch_error", "takes",
)  # fmt: skip


def imported(path):
    """Names of everything a file imports, at any depth; relative imports are made absolute."""
    names = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                base = ".".join([*path.relative_to(FIT.parent).parts[: -node.level], *([base] if base else [])])
            names += [f"{base}.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Call):
            called = ast.unparse(node.func)
            assert "import_module" not in called, path
            assert called not in {"__import__", "exec", "eval"}, path
    return names


def is_under(name, package):
    return name == package or name.startswith(package + ".")


def test_the_generator_imports_nothing_of_the_tool():
    files = [path for path in sorted((FIT / "blind").rglob("*.py")) if path.parent.name != "workers"]
    assert len(files) > 15
    for path in files:
        for name in imported(path):
            assert any(is_under(name, a) for a in (*ALLOWED, *STANDARD)) or name in {"fit.runtime", "fit.errors"}, (
                path.name,
                name,
            )


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
    for path in (FIT / "foreign").glob("*.py"):
        for name in imported(path):
            assert is_under(name, "fit.foreign") or not is_under(name, "fit") or name == "fit.errors.FitError", name


def test_the_tool_imports_nothing_of_the_generator():
    files = [p for folder in TOOL for p in (FIT / folder).rglob("*.py")] + [FIT / f"{n}.py" for n in TOOL_FILES]
    assert len(files) > 50
    for path in files:
        assert not any(is_under(name, "fit.blind") for name in imported(path)), path


def test_the_wall_sees_through_from_fit_import_something():
    """`from fit import gap` names fit.gap, which is not allowed; `from fit import runtime` is."""
    tree = ast.parse("from fit import gap")
    node = tree.body[0]
    names = [f"{node.module}.{alias.name}" for alias in node.names]
    assert names == ["fit.gap"]
    assert not any(is_under("fit.gap", a) for a in ALLOWED)

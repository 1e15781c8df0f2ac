"""Rules of the repository as a whole: imports, texts, scripts."""

from __future__ import annotations

import ast
import importlib
import os
import re
import shutil
import subprocess
import sys
import textwrap
import tomllib
from pathlib import Path

import pytest

from tests.repository import MODULES, PACKAGES, ROOT, SCRIPTS, name_of, texts, tree_of

# package: the packages and large libraries that its modules may import
MAY_IMPORT = {
    "formats": {"formats"},
    "firmware_host": {"formats", "firmware_host", "openni", "usb"},
    "capture": {"formats", "firmware_host", "capture", "cv2"},
    "fit": {"formats", "fit", "scipy", "taichi"},
    "hangtime": {"formats", "fit", "hangtime"},
}
GUARDED = set().union(*MAY_IMPORT.values())


def imports(path: Path) -> set[str]:
    """First parts of the names that a module imports, at any depth of its code."""
    found = set()
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            found.add(node.module.split(".")[0])
    return found


def ruff_on(path: str, statement: str) -> str:
    """What ruff says of a module at this place that holds this statement."""
    ruff = [sys.executable, "-m", "ruff", "check", "--no-cache", "--select", "TID251", "--output-format", "concise"]
    code = f'"""A module."""\n\n{statement}\n'
    done = subprocess.run(
        [*ruff, "--stdin-filename", path, "-"], input=code, capture_output=True, text=True, cwd=ROOT, check=False
    )
    return done.stdout + done.stderr


# --- imports ------------------------------------------------------------------------------------


@pytest.mark.parametrize("package", PACKAGES)
def test_ruff_refuses_each_import_that_a_package_may_not_have(package: str) -> None:
    guarded = [*sorted(GUARDED - MAY_IMPORT[package]), "typer"]
    said = ruff_on(f"{package}/example.py", "\n".join(f"import {name}" for name in guarded)).splitlines()
    for line, name in enumerate(guarded, start=3):
        assert any(f":{line}:" in told and "TID251" in told for told in said), f"{package} may import {name}: {said}"
    foreign = (
        "from capture.hanger.fiducial_tracker import find_markers"
        if package in {"fit", "hangtime"}
        else "from fit.cloth import mesh"
    )
    assert "TID251" in ruff_on(f"{package}/deeper/example.py", foreign)


@pytest.mark.parametrize("package", PACKAGES)
def test_ruff_allows_each_import_that_a_package_needs(package: str) -> None:
    allowed = "\n".join(f"import {name}" for name in sorted(MAY_IMPORT[package]))
    assert "TID251" not in ruff_on(f"{package}/example.py", allowed)


def test_every_module_imports_only_what_its_package_may() -> None:
    """Ruff lets command-line modules off this rule because they import Typer; this does not."""
    of_commands = {"formats/anyway.py", "formats/command.py", "formats/command_groups.py", "formats/help_pages.py"}
    for module in MODULES:
        found, name = imports(module), name_of(module)
        foreign = (found & GUARDED) - MAY_IMPORT[name.split("/")[0]]
        assert not foreign, (name, foreign)
        assert "typer" not in found or name.endswith("cli.py") or name in of_commands, name


def lint_imports(folder: Path) -> subprocess.CompletedProcess[str]:
    """Run import-linter with the rules of pyproject.toml on the packages of a folder."""
    linter = Path(sys.executable).with_name("lint-imports")
    there = {**os.environ, "PYTHONPATH": str(folder)}
    return subprocess.run([linter, "--no-cache"], cwd=folder, env=there, capture_output=True, text=True, check=False)


def test_every_room_imports_only_from_rooms_below_it() -> None:
    done = lint_imports(ROOT)
    assert done.returncode == 0, done.stdout


def test_the_top_of_fit_holds_five_modules_and_rooms() -> None:
    """A sixth module belongs in a room, or in formats if other packages use it too."""
    top = {path.stem for path in (ROOT / "fit").glob("*.py")} - {"__init__"}
    assert top == {"cli", "errors", "runtime", "folders", "provenance"}


BLIND = "The blind check's generator knows nothing of the fitter"
# Rooms from which fit/blind may import: they start processes and guard folders, and know no cloth.
NO_FITTER = {"blind", "errors", "folders", "foreign", "kernel_cache", "runtime"}


def test_the_blind_check_may_import_from_no_room_of_the_fitter() -> None:
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    (forbidden,) = (one["forbidden_modules"] for one in contracts if one["name"] == BLIND)
    rooms = {path.stem for path in (ROOT / "fit").iterdir() if path.suffix == ".py" or (path / "__init__.py").exists()}
    assert set(forbidden) == {f"fit.{room}" for room in rooms - NO_FITTER - {"__init__"}} | {"hangtime"}


# One case plants several violations, each of another contract.
@pytest.mark.parametrize(
    "faults",
    [
        [
            ("fit/cloth/model.py", "from fit.gap import verdict", "Rooms of fit"),
            ("capture/hanger/pose.py", "from capture.recording import session", "Rooms of capture"),
            ("firmware_host/lamp.py", "from firmware_host import opening", "Rooms of firmware_host"),
            ("formats/importers/units.py", "from formats.exporters import by_library", "Layers of formats"),
            ("fit/blind/hands.py", "from fit.api import results", BLIND),
        ],
        [
            ("fit/observer/edge.py", "from fit.observer import residuals", "No circles between modules of one room"),
            ("fit/stray.py", "", "Rooms of fit"),
        ],
        [("fit/cloth/model.py", "from fit.cloth import launch", "A cloth's model never runs")],
    ],
    ids=["a room above", "a circle and a room of none", "a launch"],
)
def test_an_import_against_the_rules_of_the_rooms_is_refused(
    faults: list[tuple[str, str, str]], tmp_path: Path
) -> None:
    for package in PACKAGES:
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    for module, statement, _ in faults:
        path = tmp_path / module
        path.write_text((path.read_text() if path.exists() else '"""Stray."""\n') + f"\n{statement}\n")
    done = lint_imports(tmp_path)
    assert done.returncode == 1
    for *_, contract in faults:
        assert f"{contract} BROKEN" in done.stdout


def test_help_loads_none_of_the_four_heavy_libraries() -> None:
    code = """
        import sys
        sys.argv = ["hangtime", "--help"]
        from formats.command import main
        try:
            main()
        except SystemExit:
            pass
        print("loaded:", sorted({"cv2", "openni", "scipy", "taichi"} & set(sys.modules)))
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)], capture_output=True, text=True, cwd=ROOT, check=True
    )
    assert "diagnose" in done.stdout
    assert "loaded: []" in done.stdout


@pytest.mark.parametrize("benchmark", sorted((ROOT / "benchmarks").glob("*.py")), ids=name_of)
def test_every_import_of_a_benchmark_exists(benchmark: Path) -> None:
    wanted = [
        (node.module, alias.name)
        for node in ast.walk(tree_of(benchmark))
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] in {*PACKAGES, "tests"}
        for alias in node.names
    ]
    missing = []
    for module, name in wanted:
        if not hasattr(importlib.import_module(module), name):
            try:
                importlib.import_module(f"{module}.{name}")
            except ImportError:
                missing.append(f"{module}.{name}")
    assert missing == []


# --- modules and texts --------------------------------------------------------------------------


def test_every_module_says_what_it_is_for_and_stays_below_400_lines() -> None:
    for module in [*MODULES, *sorted((ROOT / "benchmarks").glob("*.py"))]:
        assert ast.get_docstring(tree_of(module)), name_of(module)
        assert module.read_text().count("\n") <= 400, name_of(module)
        assert not {"utils", "common", "helpers", "misc"} & set(module.with_suffix("").parts), name_of(module)


def test_no_text_names_a_folder_of_somebodys_own_machine_or_a_package_index() -> None:
    private = re.compile(r"(?<![\w.$}])/(?:home|root|work|Users)/\w|index-url|\bpypi\.\w+", re.IGNORECASE)
    parts = ("/home/", "/root/", "/work/", "/users/", "index-url", "pypi.")  # of what matches: to look takes a second
    read = {path: path.read_text() for path in texts() if path != Path(__file__)}
    found = [
        f"{name_of(path)}: {match.group()}"
        for path, text in read.items()
        if any(map(text.lower().__contains__, parts))
        for match in private.finditer(text)
    ]
    assert found == []


def test_every_link_to_a_file_leads_to_a_file() -> None:
    dead = [
        f"{name_of(path)}: {target}"
        for path in texts()
        if path.suffix == ".md"
        for target in re.findall(r"\]\(([^)#]+)[^)]*\)", path.read_text())
        if "://" not in target and not (path.parent / target).exists()
    ]
    assert dead == []


# --- scripts ------------------------------------------------------------------------------------


@pytest.mark.parametrize("script", SCRIPTS, ids=name_of)
def test_every_script_is_plain_posix_shell(script: Path) -> None:
    assert script.read_text().startswith("#!/bin/sh\n")
    assert os.access(script, os.X_OK)
    subprocess.run(["sh", "-n", script], check=True)
    if shutil.which("shellcheck"):
        subprocess.run(["shellcheck", script], check=True)


@pytest.mark.parametrize("script", sorted((ROOT / "scripts").iterdir()), ids=name_of)
def test_every_script_explains_itself_without_setting_anything_up(script: Path, tmp_path: Path) -> None:
    copy = tmp_path / "scripts" / script.name
    copy.parent.mkdir()
    shutil.copy(script, copy)
    done = subprocess.run([copy, "--help"], capture_output=True, text=True, check=True)
    assert f"Usage: scripts/{script.name}" in done.stdout
    assert sorted(tmp_path.rglob("*")) == [copy.parent, copy]


def run_setup(folder: Path, pythons: dict[str, str]) -> subprocess.CompletedProcess[str]:
    """Run scripts/setup where only these Pythons exist, with neither apt-get nor sudo."""
    programs = folder / "programs"
    programs.mkdir()
    for name in ("cat", "cksum", "cmp", "dirname", "env", "head", "id", "mkdir", "rm", "sleep", "uname"):
        found = shutil.which(name)
        assert found
        (programs / name).symlink_to(found)
    for name, text in pythons.items():
        (programs / name).write_text(f"#!/bin/sh\n{text}\n")
        (programs / name).chmod(0o755)
    (folder / "scripts").mkdir()
    shutil.copy(ROOT / "scripts/setup", folder / "scripts")
    shutil.copy(ROOT / "pyproject.toml", folder)
    return subprocess.run(
        ["/bin/sh", folder / "scripts/setup"], env={"PATH": str(programs)}, capture_output=True, text=True, check=False
    )


def test_setup_names_the_three_pythons_it_needs_when_there_is_none(tmp_path: Path) -> None:
    done = run_setup(tmp_path, {"python3": "exit 1"})
    assert done.returncode == 1
    assert "no Python 3.11, 3.12 or 3.13 on PATH" in done.stderr
    assert not (tmp_path / ".venv").exists()


def test_setup_names_the_one_debian_package_that_a_python_without_ensurepip_needs(tmp_path: Path) -> None:
    without = f'case "$*" in *ensurepip* | *"-m pip"*) exit 1 ;; esac\nexec {sys.executable} "$@"'
    done = run_setup(tmp_path, {"python3": without})
    assert done.returncode == 1
    assert f"sudo apt-get install python{sys.version_info[0]}.{sys.version_info[1]}-venv" in done.stderr
    assert not (tmp_path / ".venv").exists()


def test_systemd_folder_is_no_python_package() -> None:
    assert not list((ROOT / "systemd").rglob("*.py"))

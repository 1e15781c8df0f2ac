"""`scripts/setup --python`: the Python of a new environment if an environment already exists."""

from __future__ import annotations

import platform
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TOOLS = ("cat", "cksum", "cmp", "dirname", "env", "head", "id", "mkdir", "rm", "uname")
OTHER = "3.13" if sys.version_info[:2] < (3, 13) else "3.12"
# Reports another version, and cannot create an environment.
ANOTHER_PYTHON = f"""case "$*" in
    *%d.%d*) echo {OTHER} ;;
    *"-m venv"*) exit 3 ;;
esac"""


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A checkout that was set up with this Python, where only a few programs are on PATH, and no apt-get."""
    for folder in ("scripts", "programs", ".venv/bin"):
        (tmp_path / folder).mkdir(parents=True)
    for name in TOOLS:
        found = shutil.which(name)
        assert found
        (tmp_path / "programs" / name).symlink_to(found)
    shutil.copy(ROOT / "scripts/setup", tmp_path / "scripts")
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    programs = {
        ".venv/bin/python": f'exec {sys.executable} "$@"',
        "programs/python-old": "exit 1",
        "programs/python-other": ANOTHER_PYTHON,
    }
    for path, text in programs.items():
        (tmp_path / path).write_text(f"#!/bin/sh\n{text}\n")
        (tmp_path / path).chmod(0o755)
    setup = (ROOT / "scripts/setup").read_text()
    used, more, elsewhere = re.search(
        r"^used=(\S+)\nall=\$used(\S+)\n(?:.*\n)  +used=\S+ all=(\S+)$", setup, re.M
    ).groups()
    extras = used + more if platform.machine() == "x86_64" else elsewhere
    checksum = subprocess.run(
        ["cksum"], input=(tmp_path / "pyproject.toml").read_bytes(), capture_output=True, check=True
    ).stdout.decode()
    stamp = f"{tmp_path.resolve()}\n{extras}\n{sys.version}\n{checksum}"
    (tmp_path / ".venv/hangtime-setup").write_text(stamp)
    return tmp_path


def run_setup(checkout: Path, *options: str) -> subprocess.CompletedProcess[str]:
    command = ["/bin/sh", str(checkout / "scripts/setup"), *options]
    return subprocess.run(
        command, env={"PATH": str(checkout / "programs")}, capture_output=True, text=True, check=False
    )


def test_a_checkout_that_is_set_up_is_ready_at_once(checkout: Path) -> None:
    done = run_setup(checkout)
    assert (done.returncode, done.stdout.count("ready: .venv with Python")) == (0, 1), done.stderr


@pytest.mark.parametrize("name", ["python-that-is-not-there", "python-old"])
def test_a_python_that_cannot_be_is_refused_although_an_environment_is_there(checkout: Path, name: str) -> None:
    done = run_setup(checkout, "--python", name)
    assert done.returncode == 1
    assert done.stderr == (
        f"setup: {name} is not a Python 3.11, 3.12 or 3.13 that runs; give another one to --python\n"
    )
    assert done.stdout == ""
    assert (checkout / ".venv/hangtime-setup").exists()


def test_a_python_without_a_name_is_refused(checkout: Path) -> None:
    assert "--python needs the name of a program" in run_setup(checkout, "--python", "").stderr


def test_another_version_than_the_environments_makes_it_anew(checkout: Path) -> None:
    done = run_setup(checkout, "--python", "python-other")
    assert "setup: .venv has another Python than python-other; making it anew" in done.stdout
    assert f"setup: making .venv with Python {OTHER}" in done.stdout
    assert done.returncode == 3


@pytest.mark.parametrize("is_relative", [False, True])
def test_a_python_in_a_folder_with_a_space_is_taken_from_wherever_it_is_named(
    checkout: Path, *, is_relative: bool
) -> None:
    folder = checkout / "elsewhere" / "other pythons"
    folder.mkdir(parents=True)
    shutil.copy(checkout / "programs/python-other", folder / "python")
    name = "other pythons/python" if is_relative else str(folder / "python")
    command = ["/bin/sh", str(checkout / "scripts/setup"), "--python", name]
    done = subprocess.run(
        command,
        env={"PATH": str(checkout / "programs")},
        capture_output=True,
        text=True,
        check=False,
        cwd=folder.parent,
    )
    assert f"setup: making .venv with Python {OTHER} ({folder / 'python'})" in done.stdout, done.stderr
    assert done.returncode == 3

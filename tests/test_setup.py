"""`scripts/setup`: two parallel runs wait for each other. A slow stand-in installs the libraries."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

from tests.conftest import STILL

ROOT = Path(__file__).parents[1]
TOOLS = ("sh", "uname", "cksum", "head", "cmp", "rm", "mkdir", "sleep", "cat", "id", "cp", "dirname", "env")
PYTHON = """#!/bin/sh
# Stands for a Python: writes down when it makes an environment and when it installs.
case "$1 $2" in
"-m venv") echo "venv begins" >>LOG; sleep 0.3; mkdir -p "$3/bin"; cp "$0" "$3/bin/python"; echo "venv ends" >>LOG ;;
"-m pip") case "$*" in *install*) echo "pip begins" >>LOG; sleep 0.3; echo "pip ends" >>LOG ;; esac ;;
*) exec REAL "$@" ;;
esac
"""


@pytest.fixture(params=["flock", "mkdir"])
def checkout(request, tmp_path):
    """A checkout with the script, and a PATH that has no apt-get, and flock or not."""
    (tmp_path / "scripts").mkdir()
    shutil.copy(ROOT / "scripts/setup", tmp_path / "scripts/setup")
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    (tmp_path / "bin").mkdir()
    for tool in TOOLS + (("flock",) if request.param == "flock" else ()):
        found = shutil.which(tool)
        if found is None:
            pytest.skip(f"there is no {tool}")
        (tmp_path / "bin" / tool).symlink_to(found)
    python = tmp_path / "bin/python3.12"
    python.write_text(PYTHON.replace("REAL", sys.executable).replace("LOG", str(tmp_path / "log")))
    python.chmod(0o755)
    return tmp_path


def setting_up(checkout, *options):
    return subprocess.Popen(
        ["scripts/setup", *options], cwd=checkout, env={**os.environ, "PATH": str(checkout / "bin")}, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip


def test_two_set_ups_at_once_make_one_environment(checkout):
    both = [setting_up(checkout), setting_up(checkout)]
    said = [one.communicate(timeout=STILL)[0] for one in both]
    assert [one.returncode for one in both] == [0, 0], said
    assert (checkout / "log").read_text().split("\n")[:-1] == ["venv begins", "venv ends", "pip begins", "pip ends"]
    assert sum("another scripts/setup is at work here" in text for text in said) == 1
    assert not (checkout / ".setup.lock.d").exists()


def test_a_set_up_for_use_leaves_out_what_developers_need_and_a_later_one_adds_it(checkout):
    """The third run, for use again, finds all that it wants."""
    orders = (["--for-use"], [], ["--for-use"])
    said = [setting_up(checkout, *options).communicate(timeout=STILL)[0] for options in orders]
    lines = [[line for line in text.splitlines() if line.startswith("         ")] for text in said]
    listed = [[line.split(":")[0].strip() for line in each] for each in lines]
    assert "fit" in listed[0] or "capture" in listed[0]
    assert "dev" not in listed[0]
    assert "dev" in listed[1]
    assert listed[2] == []
    assert (checkout / "log").read_text().count("pip begins") == 2


def test_a_set_up_that_was_killed_is_named_or_forgotten(checkout):
    """The kernel's lock ends with its process; a folder stays, and the sentence says which."""
    first = setting_up(checkout)
    while not (checkout / "log").exists():
        time.sleep(0.02)
    first.send_signal(signal.SIGKILL)
    first.communicate()
    time.sleep(0.4)  # its child, which holds the kernel's lock too, ends by itself
    again = setting_up(checkout)
    said = again.communicate(timeout=STILL)[0]
    if (checkout / "bin/flock").exists():
        assert again.returncode == 0, said
    else:
        assert again.returncode == 1
        assert f"remove {checkout}/.setup.lock.d" in said


@pytest.mark.parametrize("script", ["setup", "demo"])
@pytest.mark.parametrize("checkout", ["flock"], indirect=True)
def test_a_checkout_of_somebody_else_is_named_in_one_line_and_nothing_is_removed(checkout, script):
    """As superuser the script runs as user `nobody`; other users get a read-only folder."""
    with tempfile.TemporaryDirectory() as place:
        copy = Path(place) / "hangtime"
        shutil.copytree(checkout, copy, symlinks=True)
        shutil.copy(ROOT / "scripts/demo", copy / "scripts/demo")
        (copy / ".venv").mkdir()
        (copy / ".venv/kept").touch()
        for folder in (copy / ".venv", copy):
            folder.chmod(0o555)
        Path(place).chmod(0o755)
        done = subprocess.run(
            [f"scripts/{script}"], cwd=copy, env={**os.environ, "PATH": str(copy / "bin")}, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, user=65534 if os.geteuid() == 0 else None,
        )  # fmt: skip
        is_kept = (copy / ".venv/kept").exists()
        for folder in (copy, copy / ".venv"):
            folder.chmod(0o755)
    lines = [line for line in done.stdout.splitlines() if "missing: " not in line]  # system libraries
    assert (done.returncode, is_kept) == (1, True), done.stdout
    assert lines == [f"{script}: {copy} belongs to somebody else or cannot be written; clone a checkout of your own "
                     "and run this there"]  # fmt: skip

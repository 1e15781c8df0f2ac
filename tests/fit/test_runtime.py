"""How Taichi is started."""

# No `from __future__ import annotations` here: Taichi reads the annotations of kernels.

import os
import subprocess
import sys
from pathlib import Path

import pytest
import taichi as ti

from fit import runtime


def test_an_error_in_a_kernel_still_names_its_file_and_line():
    runtime.start()

    @ti.func
    def broken(a):
        return a + missing  # noqa: F821

    @ti.kernel
    def asks() -> ti.i32:
        return broken(1)

    line = test_an_error_in_a_kernel_still_names_its_file_and_line.__code__.co_firstlineno + 5
    with pytest.raises(ti.TaichiNameError, match=rf'test_runtime.py", line {line}, in broken:(.|\n)*missing'):
        asks()


def test_nothing_but_the_program_itself_writes_to_its_output():
    asked = "from fit import runtime; runtime.start(1); print('ready')"
    done = subprocess.run([sys.executable, "-c", asked], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("ready\n", "")


SQUARES = """
import typer
from fit import cli, runtime
cli.add_commands(typer.Typer())
import taichi as ti
runtime.start(1)
@ti.kernel
def squares(n: ti.i32) -> ti.i32:
    total = 0
    for k in range(n):
        total += k * k
    return total
print(squares(4))
"""


@pytest.mark.parametrize("home", [None, "/dev/null"])
def test_without_a_home_kernels_run_all_the_same_and_nothing_is_left(tmp_path, home):
    """Taichi's import ends the process with 134 without HOME, and its end with 139 where HOME cannot be written."""
    left_out = ("HOME", "XDG_CACHE_HOME", runtime.CACHE)
    surroundings = {k: v for k, v in os.environ.items() if k not in left_out} | {"TMPDIR": str(tmp_path)}
    if home is not None:
        surroundings["HOME"] = home
    script = tmp_path / "squares.py"
    script.write_text(SQUARES)
    done = subprocess.run(
        [sys.executable, script], capture_output=True, text=True,
        env=surroundings | {"PYTHONPATH": str(Path(__file__).parents[2])},
    )  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (0, "14\n", "")
    assert list(tmp_path.iterdir()) == [script]

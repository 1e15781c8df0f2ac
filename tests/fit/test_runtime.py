"""How Taichi is started."""

# No `from __future__ import annotations` here: Taichi reads the annotations of kernels.

import subprocess
import sys

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

"""The start of Taichi, and the rounding error that a variable adds."""

# No `from __future__ import annotations` here: Taichi reads the annotations of kernels.

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import taichi as ti

from fit import runtime
from fit.errors import FitError


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


def test_jitter_moves_a_cloth_by_rounding_alone_and_every_candidate_alike(monkeypatch):
    """1e-7 of a diagonal of 5 m, in three directions of 1000 nodes: 0.5 um each, give or take 3 %."""
    nodes = np.random.default_rng(0).random((1000, 3)) * [3.0, 4.0, 0.0]
    nodes[:2] = [[0, 0, 0], [3, 4, 0]]
    places = np.stack([nodes, nodes + 1.0])
    monkeypatch.delenv(runtime.JITTER_VARIABLE, raising=False)
    assert runtime.jittered(places) is places
    monkeypatch.setenv(runtime.JITTER_VARIABLE, "7")
    moved = runtime.jittered(places) - places
    assert moved.std() == pytest.approx(5e-7, rel=0.06)  # four deviations
    assert moved[0] == pytest.approx(moved[1], abs=1e-14)
    assert np.array_equal(runtime.jittered(places), places + moved)
    monkeypatch.setenv(runtime.JITTER_VARIABLE, "8")
    assert not np.allclose(runtime.jittered(places) - places, moved, atol=1e-9)
    monkeypatch.setenv(runtime.JITTER_VARIABLE, "-1")
    with pytest.raises(FitError, match="HANGTIME_JITTER: '-1' is no whole number"):
        runtime.jittered(places)


@pytest.mark.parametrize("words", [["--jitter", "x"], ["--jitter"], ["--jitter", "-1", "--slow"]])
def test_the_test_script_refuses_what_is_no_seed(words):
    done = subprocess.run(
        ["scripts/test", *words], cwd=Path(__file__).parents[2], capture_output=True, text=True,
        env={k: v for k, v in os.environ.items() if k != runtime.JITTER_VARIABLE},
    )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr == "test: --jitter needs a seed, a whole number, for example --jitter 1\n"

"""The scalar C reference of the kernel's speed computes the same, and the speed benchmarks run."""

from __future__ import annotations

import dataclasses
import os
import re
import subprocess
import sys

import numpy as np
import pytest
from msgspec.structs import replace

from benchmarks import scalar, start
from fit import runtime
from fit.cloth import material as mat
from fit.cloth.model import Resolution
from fit.cloth.simulator import Simulator

NEAR = 5e-5  # m; single precision leaves 1e-6 to 4e-5 m, and each term of rollout.c moves this cloth by 6e-5 m or more
needs_gcc = pytest.mark.skipif(scalar.find_compiler() is None, reason="there is no gcc to compile the yardstick with")


@pytest.fixture
def gentle(monkeypatch):
    """Three seconds of a gentle swing on one thread, and a call's candidates of a cloth in which every term matters."""
    monkeypatch.setenv("HANGTIME_THREADS", "1")
    simulator, rows = scalar.scene(3.0)
    rows[:, [mat.STRETCH, mat.SHEAR, mat.STRETCH_RATIO, mat.BENDING_RATIO]] = 60.0, 5.0, 0.2, 1.0
    rows[:, [mat.MEMBRANE_TIME, mat.BENDING_TIME, mat.STIFFENING, mat.TILT_X]] = 2e-3, 2e-2, 20.0, 0.1
    return simulator, rows


@needs_gcc
@pytest.mark.slow
def test_c_with_the_kernels_lanes_goes_where_the_kernel_goes(gentle, tmp_path):
    """Candidates end up millimetres apart, so lanes that were mixed up would show."""
    simulator, rows = gentle
    call = scalar.only_call(lambda: simulator.run(rows))
    expected = call.seen
    assert np.abs(expected - expected[:1]).max() > 0.05
    assert np.abs(expected - expected[..., :1]).max() > 100 * NEAR
    scalar.InC(call, scalar.build(scalar.find_compiler(), tmp_path, scalar.LANES)).run()
    assert np.abs(call.seen - expected).max() < NEAR


@pytest.mark.slow
@needs_gcc
@pytest.mark.parametrize("candidate", [0, scalar.LANES - 1])
def test_scalar_c_goes_where_the_kernel_goes(gentle, tmp_path, candidate):
    """A candidate beside others, and the same one alone in the kernel, whose lanes are as few as may be then."""
    simulator, rows = gentle
    among = scalar.only_call(lambda: simulator.run(rows)).lane(candidate)
    alone = scalar.only_call(lambda: simulator.run(rows[candidate : candidate + 1]))
    assert alone.made_with.lanes == min(runtime.lane_widths())
    expected = among.seen
    scalar.InC(among, scalar.build(scalar.find_compiler(), tmp_path, 1)).run()
    assert np.abs(among.seen - expected).max() < NEAR
    assert np.abs(among.seen - alone.seen[..., :1]).max() < NEAR


@pytest.mark.slow
@needs_gcc
def test_the_c_program_works_for_other_meshes(gentle, tmp_path):
    """A single element, which has no bends across the side of another."""
    simulator, rows = gentle
    coarse = Simulator(simulator.recording, resolution=Resolution(spacing=0.1))
    call = scalar.only_call(lambda: coarse.run(rows))
    expected = call.seen
    scalar.InC(call, scalar.build(scalar.find_compiler(), tmp_path, scalar.LANES)).run()
    assert call.made_with.bend_lengths == (scalar.IN_LINES,)
    assert np.abs(call.seen - expected).max() < NEAR


@pytest.mark.slow
@needs_gcc
def test_the_c_program_refuses_effects_that_it_lacks(gentle, tmp_path):
    """An observer's pull, and threads that run askew to the mesh."""
    simulator, rows = gentle
    turned = replace(simulator.recording.garment, grain_degrees=20.0)
    askew = Simulator(dataclasses.replace(simulator.recording, garment=turned))
    library = scalar.build(scalar.find_compiler(), tmp_path, 1)
    for run in (lambda: simulator.run(rows[:1], observer_hz=0.5), lambda: askew.run(rows[:1])):
        with pytest.raises(ValueError, match="plain, held panels"):
            scalar.InC(scalar.only_call(run), library)


@pytest.mark.slow  # what the benchmark compares is compared above
@needs_gcc
def test_the_benchmark_prints_each_ratio_beside_its_target(monkeypatch, capsys):
    monkeypatch.setattr(scalar, "FURTHER", scalar.FURTHER[:2])  # compiling takes longest here
    scalar.main(["--seconds", "1", "--rounds", "1"])
    said = capsys.readouterr().out
    assert len(re.findall(r"target (?:6|0\.5|0\.8)\b", said)) == 6
    assert float(re.search(r"any C and the kernel: (\S+) mm", said)[1]) < 1e3 * NEAR


def test_without_a_compiler_the_benchmark_says_so_and_succeeds(tmp_path):
    done = subprocess.run(
        [sys.executable, scalar.__file__], env={**os.environ, "PATH": str(tmp_path)}, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert "no gcc" in done.stdout


@pytest.mark.slow  # eight processes, none of which does what no other test does
def test_the_start_of_a_fit_is_reported_in_time_and_imports(capsys):
    start.main(["--rounds", "1"])
    said = capsys.readouterr().out
    found = re.findall(r"progress with --iterations (\d+): (\S+) s .*?, (\S+) s of the processor", said)
    (one, clock, processor), (many, _, more) = ([float(number) for number in row] for row in found)
    assert (one, many) == start.ITERATIONS
    assert clock > 0
    assert 0 < float(re.search(r"first batch.*?: (\S+) s", said)[1]) < processor
    assert more < 60
    assert re.search(r"\d+ ms +taichi", said)

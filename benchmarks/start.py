"""Measure the time of `hangtime fit` until its first simulation ends, with Taichi's kernels cached by an earlier run.

Run: python benchmarks/start.py [--rounds 7]. A process starts as a user would start it, on a take of two seconds (a
sheet, five points, annealing). It runs from its start to its first line of progress and is then ended. This line comes
when the first batch has been simulated: the initial parameters and fifteen more. With `--iterations 1` the batch has
one more, the nearest to a single simulation. Both run in turns, after a turn that fills the kernels' cache. Figures are
medians on the clock and of the processor.

One more process runs with `--iterations 1` under `python -X importtime`, which slows imports a little. It gives the
imports' time on the clock, each library's own modules summed up. The time after the kernel's module, the last large
one, is the first batch: Taichi finds its kept kernel and runs it.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import psutil

sys.path.insert(0, str(Path(__file__).parents[1]))

from formats.archive import write_take
from tests.fit.scenes import material, sheet, simulate_take, swing

TARGET = 3.0  # s on the clock
ITERATIONS = (1, 350)  # values of --iterations whose first batches have 2 and 16 candidates
KERNEL = "fit.cloth.rollout"  # imported when the first batch is simulated
MOST = 12  # libraries that are listed
IMPORT = re.compile(r"import time:\s+(\d+) \|\s+\d+ \|\s+(\S+)")  # own time [us], cumulative, name


def small_take(folder: Path) -> Path:
    """Write a take of two seconds."""
    instants = np.arange(0, 2, 1 / 30)
    garment = sheet()
    take = simulate_take(garment, instants, swing(instants, amplitude=0.05), material(garment, velocity_damping=2.0))
    return write_take(folder / "small.mcap", take)


@contextmanager
def fitting(take: Path, iterations: int, *options: str) -> Iterator[subprocess.Popen[str]]:
    """`hangtime fit` on a take, ended when the block is left; options are the interpreter's."""
    out = tempfile.mkdtemp(dir=take.parent)  # a killed fit may leave a state from which the next one would continue
    words = ["fit", take.name, "--search", "annealing", "--iterations", str(iterations), "--out", out]
    command = [sys.executable, *options, "-m", "formats.command", *words]
    with subprocess.Popen(
        command, cwd=take.parent, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def until_progress(process: subprocess.Popen[str]) -> Iterator[str]:
    """Return the lines on stderr up to the first one of progress.

    Raises:
        RuntimeError: the process ends before that.
    """
    assert process.stderr is not None
    line = ""
    for line in process.stderr:
        yield line
        if line.startswith("annealing:"):
            return
    raise RuntimeError(f"hangtime fit ended without any progress: {line}")


def used(process: subprocess.Popen[str]) -> float:
    """Processor time [s] that a process has taken so far."""
    times = psutil.Process(process.pid).cpu_times()
    return float(times.user + times.system)


def first_progress(take: Path, iterations: int) -> tuple[float, float]:
    """Seconds until the first line of progress: on the clock, and of the processor."""
    start = time.perf_counter()
    with fitting(take, iterations) as process:
        for _ in until_progress(process):
            pass
        return time.perf_counter() - start, used(process)


def parts(take: Path) -> tuple[Counter[str], float]:
    """Time of each library's modules [us] on the clock, and processor time [s] of the first batch."""
    found: Counter[str] = Counter()
    before = float("nan")
    with fitting(take, 1, "-X", "importtime") as process:
        for line in until_progress(process):
            if match := IMPORT.match(line):
                found[match[2].split(".")[0]] += int(match[1])
                before = used(process) if match[2] == KERNEL else before
        return found, used(process) - before


def main(arguments: list[str] | None = None) -> None:
    """Print the medians beside the target, and the libraries whose import costs most."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=7, help="default %(default)s")
    rounds = parser.parse_args(arguments).rounds
    if rounds < 1:
        parser.error("at least one round is needed")
    with tempfile.TemporaryDirectory() as folder:
        take = small_take(Path(folder))
        turns = [[first_progress(take, iterations) for iterations in ITERATIONS] for _ in range(rounds + 1)]
        costs, batch = parts(take)
    for k, iterations in enumerate(ITERATIONS):
        clock, processor = np.percentile([turn[k] for turn in turns[1:]], [0, 50, 100], axis=0).T
        verdict = "" if clock[1] <= TARGET else ", missed"
        print(
            f"start to first progress with --iterations {iterations}: {clock[1]:.2f} s on the clock ({clock[0]:.2f} to "
            f"{clock[2]:.2f}; target {TARGET:g}{verdict}), {processor[1]:.2f} s of the processor "
            f"({processor[0]:.2f} to {processor[2]:.2f})"
        )
    print(f"of which the first batch, with --iterations 1: {batch:.2f} s of the processor")
    print(f"imports: {1e-3 * costs.total():.0f} ms, of which")
    for name, cost in costs.most_common(MOST):
        print(f"{1e-3 * cost:8.0f} ms   {name}")


if __name__ == "__main__":
    main()

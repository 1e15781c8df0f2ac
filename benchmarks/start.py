"""How long `hangtime fit` takes until its first simulation is done, with Taichi's kernels kept from an earlier run.

Run: python benchmarks/start.py [--rounds 7]. A process as a user starts it, on a take of two seconds (a sheet, five
points, annealing), from its start to its first line of progress, which comes when the initial parameters have been
simulated; then it is ended. A run before them warms the kernels' cache and the disk's; medians of the rest, on the
clock and of the processor. Then what its imports cost, each library's own modules summed up, as `python -X importtime`
tells, which makes imports a little slower.
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
MOST = 12  # libraries that are listed
IMPORT = re.compile(r"import time:\s+(\d+) \|\s+\d+ \|\s+(\S+)")  # own time [us], cumulative, name


def small_take(folder: Path) -> Path:
    """Write a take of two seconds."""
    instants = np.arange(0, 2, 1 / 30)
    garment = sheet()
    take = simulate_take(garment, instants, swing(instants, amplitude=0.05), material(garment, velocity_damping=2.0))
    return write_take(folder / "small.mcap", take)


@contextmanager
def fitting(take: Path, *options: str) -> Iterator[subprocess.Popen[str]]:
    """`hangtime fit` on a take, ended when the block is left; options are the interpreter's."""
    command = [sys.executable, *options, "-m", "formats.command", "fit", str(take), "--out", str(take.parent / "out")]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def until_progress(process: subprocess.Popen[str]) -> list[str]:
    """Lines on stderr up to the first one of progress.

    Raises:
        RuntimeError: the process ends before that.
    """
    lines: list[str] = []
    assert process.stderr is not None
    for line in process.stderr:
        lines.append(line)
        if line.startswith("annealing:"):
            return lines
    raise RuntimeError("hangtime fit ended without any progress: " + "".join(lines[-5:]))


def first_progress(take: Path) -> tuple[float, float]:
    """Seconds until the first line of progress: on the clock, and of the processor."""
    start = time.perf_counter()
    with fitting(take) as process:
        until_progress(process)
        clock = time.perf_counter() - start
        used = psutil.Process(process.pid).cpu_times()
    return clock, used.user + used.system


def imports(take: Path) -> Counter[str]:
    """Time of the modules [us] of each library until the first progress."""
    with fitting(take, "-X", "importtime") as process:
        lines = until_progress(process)
    found: Counter[str] = Counter()
    for own, name in (match.groups() for match in map(IMPORT.match, lines) if match):
        found[name.split(".")[0]] += int(own)
    return found


def main(arguments: list[str] | None = None) -> None:
    """Print the medians beside the target, and the libraries whose import costs most."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=7, help="default %(default)s")
    rounds = parser.parse_args(arguments).rounds
    if rounds < 1:
        parser.error("at least one round is needed")
    with tempfile.TemporaryDirectory() as folder:
        take = small_take(Path(folder))
        first_progress(take)
        clock, processor = np.percentile([first_progress(take) for _ in range(rounds)], [0, 50, 100], axis=0).T
        costs = imports(take)
    verdict = "" if clock[1] <= TARGET else ", missed"
    print(
        f"start to first progress: {clock[1]:.2f} s on the clock ({clock[0]:.2f} to {clock[2]:.2f}; target "
        f"{TARGET:g}{verdict}), {processor[1]:.2f} s of the processor ({processor[0]:.2f} to {processor[2]:.2f})"
    )
    print(f"imports: {1e-3 * costs.total():.0f} ms, of which")
    for name, cost in costs.most_common(MOST):
        print(f"{1e-3 * cost:8.0f} ms   {name}")


if __name__ == "__main__":
    main()

"""Measure the simulation's cost against the number of vertices and simulated seconds, and the gain of a second core.

Run: python benchmarks/cost.py. The sheet of 0.4 m x 0.4 m and 300 N/m is clamped, with eight candidates in the lanes of
one thread. The cost is processor time, which other work on the machine hardly changes: the least of five runs after one
that compiles. The step of an explicit scheme shrinks with the mesh. So cost per vertex and second grows if cost per
vertex and step does not.

For the second core, 32 candidates run on two meshes. One is like that of most fits. The arrays of the finer one outgrow
a core's own cache. Two processes, one with one thread and one with two, run in turns. The result is the median of the
pairs' ratios, on the clock and of processor time. The latter is 1 if a second thread costs nothing. Other work on the
machine lowers the clock's ratio, and so do virtual processors that share one core. So the gain of two separate
processes is measured in the same turns. The processor times of the second process's threads give the limit of the code:
    (serial + sum of the workers) / (serial + the longest of them)
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from benchmarks.clamps import Clamp, clamps, steps_of
from formats.arrays import Floats

sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmarks.validation_clamped import UPRIGHT, square, still
from fit.cloth.model import Resolution as Mesh
from fit.cloth.simulator import Simulator
from fit.recordings.recording import prepare
from tests.fit.scenes import material, take_of

SIDE = 0.4  # m
ELEMENTS = (4, 8, 16, 33)  # along a side: 13 x 13, 25 x 25, 49 x 49 and 100 x 100 vertices
STEPS = 2000  # of every size, so that each runs for as long as its step allows and packing the arrays counts little
SECONDS = (0.5, 1.0, 2.0)
REPEATS = 5


def runner(elements: int, seconds: float, candidates: int) -> tuple[Callable[[], object], int, float]:
    """Return a run, its vertices, and its step [s]."""
    garment = square(SIDE, SIDE)
    instants = np.linspace(0, seconds, 25)
    recording = prepare(take_of(garment, instants, np.zeros((len(instants), 3))))
    support = clamps(Clamp(lambda p: p[:, 1] > -1e-9, still(UPRIGHT)), start=UPRIGHT)
    simulator = Simulator(recording, resolution=Mesh(spacing=SIDE / (3 * elements)), support=support)
    rows = np.repeat(material(garment), candidates, axis=0)
    return lambda: simulator.run(rows), len(simulator.mesh.rest), steps_of(simulator, rows)[0]


def by_thread() -> dict[str, float]:
    """Processor time [s] of every thread of this process (proc(5), /proc/pid/schedstat)."""
    return {t.name: 1e-9 * int((t / "schedstat").read_text().split()[0]) for t in Path("/proc/self/task").iterdir()}


def allowed(run: Callable[[], object]) -> float:
    """Return the possible speed-up of two idle processors over one, from the run's split of work over threads."""
    before = by_thread()
    run()
    spent_by = {name: after - before.get(name, 0.0) for name, after in by_thread().items()}
    serial = spent_by.pop(str(os.getpid()))
    return (serial + sum(spent_by.values())) / (serial + max(spent_by.values()))


def spent(run: Callable[[], object]) -> tuple[float, float]:
    """Return the wall-clock time and the processor time [s] of a run."""
    clock, processor = time.perf_counter(), time.process_time()
    run()
    return time.perf_counter() - clock, time.process_time() - processor


def least(run: Callable[[], object]) -> float:
    """Processor time [s] of a run, the least of some after one that may compile."""
    run()
    return min(spent(run)[1] for _ in range(REPEATS))


def by_size() -> list[tuple[int, float, float, float]]:
    """Return vertices, step [s], and cost [s] per candidate and vertex, of a step and of a simulated second."""
    found = []
    for elements in ELEMENTS:
        step = runner(elements, 0.1, 8)[2]
        run, vertices, _ = runner(elements, STEPS * step, 8)
        cost = least(run) / (8 * vertices * STEPS)
        found.append((vertices, step, cost, cost / step))
    return found


def by_seconds() -> list[tuple[float, float]]:
    """Return simulated times [s], and the cost [s] per candidate and simulated second, with 25 x 25 vertices."""
    return [(seconds, least(runner(8, seconds, 8)[0]) / (8 * seconds)) for seconds in SECONDS]


_kept: dict[int, Callable[[], object]] = {}


def _prepare(threads: str) -> None:
    os.environ["HANGTIME_THREADS"] = threads


def _kept_run(elements: int) -> Callable[[], object]:
    """Set up 32 candidates and run them once, in a separate process."""
    if elements not in _kept:
        _kept[elements] = runner(elements, 2.0, 32)[0]
        _kept[elements]()
    return _kept[elements]


def _spent_here(elements: int) -> tuple[float, float]:
    return spent(_kept_run(elements))


def _allowed_here(elements: int) -> float:
    return allowed(_kept_run(elements))


def by_cores(elements: int, turns: int) -> tuple[Floats, float]:
    """Return the gain from a second core, (turns, 3), and the limit of the split.

    The first two are one thread's time over two threads', on the clock and of the processors. The third is the gain of
    two separate processes with one thread each over one of them alone.
    """
    spawn = get_context("spawn")
    with ExitStack() as stack:
        one, other, two = (
            stack.enter_context(ProcessPoolExecutor(1, mp_context=spawn, initializer=_prepare, initargs=(threads,)))
            for threads in ("1", "1", "2")
        )
        times = []
        for _ in range(turns + 1):
            alone, together = (np.array(pool.submit(_spent_here, elements).result()) for pool in (one, two))
            beside = [pool.submit(_spent_here, elements) for pool in (one, other)]
            apart = 2 * alone[0] / max(each.result()[0] for each in beside)
            times.append([*(alone / together), apart])
        most = float(np.median([two.submit(_allowed_here, elements).result() for _ in range(turns)]))
    return np.array(times[1:]), most  # the first turn compiled


def spread(values: list[float]) -> float:
    """Return the largest over the smallest value, minus one, in percent."""
    return 100 * (max(values) / min(values) - 1)


def linear(costs: list[float]) -> str:
    """Return as text the costs' deviation from a line through the origin, and from each other."""
    apart = spread(costs)
    about = 100 * (np.sqrt(1 + apart / 100) - 1)
    return f"within {about:.0f} % of one line; largest over smallest {apart:.0f} %"


def main() -> None:
    """Print the three tables."""
    os.environ["HANGTIME_THREADS"] = "1"
    print("vertices     step    per vertex and step    per vertex and second")
    sizes = by_size()
    for vertices, step, per_step, per_second in sizes:
        print(f"{vertices:8d} {1e6 * step:5.0f} us {1e9 * per_step:16.2f} ns {1e6 * per_second:22.1f} us")
    print(f"per step {linear([s[2] for s in sizes])}")
    lengths = by_seconds()
    for seconds, cost in lengths:
        print(f"{seconds:4.1f} s simulated: {1e3 * cost:6.1f} ms for each second")
    print(f"per second {linear([cost for _, cost in lengths])}")
    for elements, (vertices, *_) in list(zip(ELEMENTS, sizes, strict=True))[:2]:
        before = os.getloadavg()[0]
        ratios, most = by_cores(elements, 11)
        (low, clock, high), (_, processor, _), (_, apart, _) = np.percentile(ratios, [25, 50, 75], axis=0).T
        print(
            f"{vertices} vertices on two cores: {clock:.2f} x one on the clock (quartiles {low:.2f} to {high:.2f}), "
            f"{processor:.2f} x in processor time; two separate processes {apart:.2f} x; "
            f"{before:.1f} other processes were running; as the work is split, {most:.2f} x on idle cores"
        )


if __name__ == "__main__":
    main()

"""Cost of a simulated candidate: alone, in a batch on one thread's lanes, and on all threads.

Run: python benchmarks/speed.py. A clamped 0.4 m x 0.45 m sheet, 8 s of swing, mesh of 50 mm; medians of five, and the
ratio of one candidate alone to one of the batch, measured in one run.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from fit.cloth.simulator import Simulator
from fit.recording import prepare
from tests.fit.scenes import hung, material, sheet, swing, take_of


def main() -> None:
    """Print seconds per candidate for one, eight and sixteen candidates."""
    garment = sheet()
    instants = np.arange(0, 8, 1 / 30)
    recording = prepare(take_of(garment, instants, swing(instants), hung(garment, instants)))
    simulator = Simulator(recording)
    row = material(garment, velocity_damping=2.0)
    costs = {}
    for count in (1, 8, 16, 64):
        rows = np.repeat(row, count, axis=0)
        simulator.run(rows)
        spent = []
        for _ in range(5):
            start = time.perf_counter()
            simulator.run(rows)
            spent.append(time.perf_counter() - start)
        costs[count] = float(np.median(spent)) / count
        print(f"{count:>3} candidates: {1e3 * costs[count]:7.1f} ms each   {costs[1] / costs[count]:5.1f} x one alone")


if __name__ == "__main__":
    main()

"""Tracking against the synthetic world's truth: how far off, and how long a frame takes on one core.

Run: python benchmarks/tracking.py [--seconds 8]. Prints median and quartiles over motions and seeds.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

from capture.recording import record
from firmware_host.synthetic.scene import RIG, demo_garment
from firmware_host.synthetic.sensor import SyntheticSensor
from firmware_host.synthetic.world import FIRST_STAMP, make_world
from formats.archive import read_take

TARGETS = {
    "marker rms, still [mm]": 2.0,
    "marker rms, moving [mm]": 5.0,
    "corner median [mm]": 8.0,
    "centre mean [mm]": 9.0,
    "frame, tracking only [ms]": 8.0,
}


class Rendered(SyntheticSensor):
    """All frames rendered beforehand, so that only tracking is timed."""

    def __init__(self, world) -> None:
        super().__init__(world, "benchmark")
        self.all = list(iter(super().read, None))
        self.spent = 0.0

    def read(self, timeout_s=5.0):
        """Return the next frame that was rendered."""
        return self.all.pop(0) if self.all else None


def measure(motion: str, seed: int, seconds: float) -> dict[str, float]:
    """Errors and time of one recording."""
    world = make_world(motion=motion, effect="air_drag", amplitude=None, seconds=seconds, seed=seed)
    sensor = Rendered(world)
    with tempfile.TemporaryDirectory() as folder:
        start = time.process_time()
        record(sensor, RIG, demo_garment(), Path(folder) / "t.mcap", take_id="t", created="now")
        spent = time.process_time() - start
        take = read_take(Path(folder) / "t.mcap")
    frames = np.searchsorted(world.time + FIRST_STAMP, take.time - 1e-5)
    markers = 1e3 * np.linalg.norm(take.markers - world.hanger.markers[frames], axis=-1)
    points = 1e3 * np.linalg.norm(take.points - world.points[frames], axis=-1)
    still = take.time < 0.9
    return {
        "marker rms, still [mm]": float(np.sqrt(np.nanmean(markers[still] ** 2))),
        "marker rms, moving [mm]": float(np.sqrt(np.nanmean(markers[~still] ** 2))),
        "corner median [mm]": float(np.nanmedian(points[:, :4])),
        "centre mean [mm]": float(np.nanmean(points[:, 4])),
        "frame, tracking only [ms]": 1e3 * spent / len(take.time),
    }


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=6.0)
    seconds = parser.parse_args().seconds
    rows = [measure(motion, seed, seconds) for motion in ("swing", "mixed") for seed in (11, 12)]
    print(f"{'':<28}{'target':>8}{'median':>9}{'lowest':>9}{'highest':>9}")
    for name, target in TARGETS.items():
        values = [row[name] for row in rows]
        print(f"{name:<28}{target:>8.1f}{np.median(values):>9.2f}{min(values):>9.2f}{max(values):>9.2f}")


if __name__ == "__main__":
    main()

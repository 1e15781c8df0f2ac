"""Measure size and speed of take archives against their targets and the entropy of their content.

Run: python benchmarks/archive.py

One take has ten minutes at 30 frames a second, with five points, two held ends and 2 mm of noise. The other has one
minute at 100 frames a second, with 81 markers and 0.3 mm of noise. All swing by 0.1 m. Times are of the processor,
without the disk's.

PYTHONPATH=CHECKOUT measures the code of another checkout, for ratios of times:
`git worktree add CHECKOUT 4e6aed36^` has the last code of version 1. That code stops at the second take, as it keeps
steps of 0.1 mm alone.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).parents[1]))  # after PYTHONPATH, see above

from formats.archive import read_take, write_take
from formats.garment import Garment, TrackedPoint
from formats.rig import Rig
from formats.swatch import swatch
from formats.take import Take

CORNERS = ((-0.2, 0.0), (0.2, 0.0), (0.2, -0.4), (-0.2, -0.4))
FIVE = Garment(
    format="hangtime-garment/1", name="sheet", kind="swatch", mass_kg=0.03, outline_m=CORNERS, held="edge",
    points=tuple(TrackedPoint(name=f"p{k}", at_m=place) for k, place in enumerate((*CORNERS, (0.0, -0.2)))),
)  # fmt: skip


def a_swing(garment: Garment, frames: int, rate: float, noise: float) -> Take:
    """Return a synthetic take: every point swings sideways by up to 0.1 m, lower ones farther, with white noise."""
    rng = np.random.default_rng(0)
    clock = np.arange(frames) / rate
    flat = np.array([point.at_m for point in garment.points])
    places = np.concatenate([flat[[0, np.argmax(flat[:, 0] + flat[:, 1])]], flat])
    at = np.zeros((frames, len(places), 3))
    at[..., :2] = places * [1, -1]
    at[..., 0] += 0.1 * np.sin(3 * clock)[:, None] * (1 - places[:, 1] / 0.4)
    at[..., 2] = 1.5
    at += rng.normal(0, noise, at.shape)
    held, points = at[:, :2], at[:, 2:]
    if len(flat) > 5:
        held = points[:, [0, int(np.argmax(flat[:, 0] + flat[:, 1]))]]
    return Take(
        take_id="swing", created="2026-01-01T00:00:00Z", garment=garment, time=clock,
        rig=Rig(format="hangtime-rig/1", name="drawn", gravity=(0.0, 1.0, 0.0)),
        held=held, held_valid=np.ones((frames, 2), bool), held_sd=np.full((frames, 2, 3), noise), points=points,
        points_valid=np.ones(points.shape[:2], bool), points_sd=np.full(points.shape, noise),
        state=np.zeros(frames, np.uint16), markers=held,
    )  # fmt: skip


def entropy(whole: np.ndarray) -> float:
    """Return the entropy [bytes a row] of columns of whole numbers, from the frequencies of their values."""
    bits = 0.0
    for column in whole.T:
        share = np.unique(column, return_counts=True)[1] / len(column)
        bits -= float((share * np.log2(share)).sum())
    return bits / 8


def measured(take: Take, step: float) -> tuple[float, float, float, float]:
    """Return bytes a frame, the entropy of the second difference, microseconds to write and milliseconds to read."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.mcap"
        written, was_read = [], []
        for _ in range(3):
            start = time.process_time()
            write_take(path, take)
            written.append(time.process_time() - start)
            start = time.process_time()
            back = read_take(path)
            was_read.append(time.process_time() - start)
        size = path.stat().st_size
    frames = len(take.time)
    assert np.abs(back.points - take.points).max() <= step / 2 + 1e-12
    places = take.points if take.held is take.points else np.concatenate([take.held, take.points], 1)
    second = np.diff(np.rint(places / step).astype(int).reshape(frames, -1), 2, axis=0)
    return size / frames, entropy(second), 1e6 * min(written) / frames, 1e3 * min(was_read)


def main() -> None:
    """Print bytes and times beside their targets."""
    size, floor, write, read = measured(a_swing(FIVE, 18_000, 30.0, 2e-3), 1e-4)
    print(f"7 places, 10 min at 30 a second, 2 mm: {size:.1f} bytes a frame (target 30; second difference {floor:.1f})")
    print(f"  written in {write:.1f} us a frame (target 6), read in {read:.0f} ms (target 50)")
    size, _, write, read = measured(a_swing(swatch(0.05), 6000, 100.0, 3e-4), 2e-5)
    take = a_swing(swatch(0.05), 6000, 100.0, 3e-4)
    floor = entropy(np.diff(np.rint(take.points / 2e-5).astype(int).reshape(6000, -1), 2, axis=0))
    print(
        f"81 markers, 1 min at 100 a second, 0.3 mm: {size:.1f} bytes a frame, {size / floor:.2f} x the entropy of the"
    )
    print(f"  second difference at 0.02 mm (target 1.6); written in {write:.1f} us a frame, read in {read:.0f} ms")


if __name__ == "__main__":
    main()

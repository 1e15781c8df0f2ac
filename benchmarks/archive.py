"""Size and speed of take archives: 30 minutes of seven tracked places at 3 mm of noise.

Run: python benchmarks/archive.py
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from formats.archive import read_take, write_take
from tests.formats.test_archive import a_take


def main() -> None:
    """Print bytes and microseconds per frame beside their targets."""
    take = a_take(frames=30 * 1800)
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        path = write_take(Path(folder) / "a.mcap", take)
        written = time.perf_counter() - start
        start = time.perf_counter()
        back = read_take(path)
        was_read = time.perf_counter() - start
        size = path.stat().st_size
    frames = len(take.time)
    assert np.array_equal(back.points_valid, take.points_valid)
    print(f"size   {size / frames:6.1f} bytes a frame   (target 45)")
    print(f"write  {1e6 * written / frames:6.1f} us a frame, every second synced to disk   (target 100)")
    print(f"read   {1e6 * was_read / frames:6.1f} us a frame")


if __name__ == "__main__":
    main()

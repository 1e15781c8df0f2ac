"""Rates of located and decoded fiducial markers, and their errors, under motion blur and behind a finger.

Drawn markers of 60 mm at 1.6 m, swung sideways; colour is averaged over the exposure. Both rates count both
markers, of which a finger covers the left one only. Errors are rms over all axes.

Run: python benchmarks/blur_and_cover.py
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from tests.capture.hanger.test_following import READ, tracked

FRAMES = 16
SWINGS = [(speed, exposure) for exposure in (0.008, 0.016, 0.033) for speed in (0.5, 1.0, 1.5, 2.0)]
FINGERS = {
    "left third covered": ((-0.02, 0.0, -0.03), (0.03, 0.09)),
    "left half covered": ((-0.015, 0.0, -0.03), (0.03, 0.09)),
    "lower third covered": ((0.0, 0.03, -0.03), (0.09, 0.03)),
    "a pencil across": ((0.01, 0.0, -0.03), (0.01, 0.09)),
    "covered wholly": ((0.0, 0.0, -0.05), (0.12, 0.12)),
}


def show(name: str, speed: float, exposure: float, cover: object = None) -> None:
    """Track one scene and print its line."""
    errors, deviations, read = tracked(speed, exposure, cover, frames=READ + FRAMES)
    placed = np.isfinite(errors[..., 0])
    rms = 1e3 * float(np.sqrt(np.nanmean(errors[placed] ** 2)))
    ratio = float(np.sqrt(np.mean((errors[placed] / deviations[placed]) ** 2)))
    share = 100 * placed.mean()
    print(f"{name:<32}{share:9.0f} %{100 * read / placed.size:9.0f} %{rms:10.1f}{ratio:12.1f}", flush=True)


def main() -> None:
    """Print the table."""
    print(f"{'':<32}{'placed':>11}{'id read':>11}{'rms [mm]':>10}{'rms/own sd':>12}")
    for speed, exposure in SWINGS:
        show(f"{speed:.1f} m/s, exposure {1e3 * exposure:.0f} ms", speed, exposure)
    for name, cover in FINGERS.items():
        show(f"0.3 m/s, {name}", 0.3, 0.008, cover)


if __name__ == "__main__":
    main()
